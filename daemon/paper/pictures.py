"""Figures 3 to 7 of the paper, from the experiments on one stage, and the inverse's tracking."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.paper.experiments import Result
from dehyst.daemon.report.plotting import (
    BEFORE,
    MEASURED,
    MODEL,
    Draw,
    add_legend,
    draw_trace,
    thin_rows,
)

END_S = 0.15  # three periods of 20 Hz


def figures(results: Sequence[Result]) -> dict[str, list[Draw]]:
    """Return the panels of each figure by its number. results: all experiments of one stage."""
    of = {name: [r for r in results if r.experiment.figure == name] for name in "34567"}
    out: dict[str, list[Draw]] = {}
    for name in "345":
        (one,) = of[name]
        out[name] = [partial(draw_time, [one]), partial(draw_drive_loop, one)]
    out["6"] = [partial(draw_time, of["6"]), partial(draw_errors, of["6"])]
    out["7"] = [
        partial(draw_time, of["7"]),
        partial(draw_end, of["7"][0]),
        partial(draw_errors, of["7"]),
    ]
    return out


def draw_time(results: Sequence[Result], axes: Axes) -> str:
    """Draw the measured displacement, and the predictions of one or two models."""
    first = results[0]
    draw_trace(axes, first.t_s, first.measured, MEASURED, "measured")
    for one in results:
        draw_trace(axes, one.t_s, one.predicted, _color(one), _label(one))
    add_legend(axes, 0.25)
    axes.set(xlabel="time, s", ylabel="displacement, um", title=f"{first.stage}: over time")
    return f"Displacement over time on the stage of {first.stage}: {first.experiment.name}."


def draw_end(one: Result, axes: Axes) -> str:
    """Draw the last periods of a sweep, as in the insets of the paper's Figure 7."""
    end = one.t_s > one.t_s[-1] - END_S
    axes.plot(one.t_s[end], one.measured[end], ".", color=MEASURED, ms=3, label="measured")
    axes.plot(one.t_s[end], one.predicted[end], color=_color(one), lw=1.0, label=_label(one))
    add_legend(axes, 0.25)
    axes.set(xlabel="time, s", ylabel="displacement, um", title=f"{one.stage}: its end")
    return f"The last {END_S:g} s on the stage of {one.stage}: {one.experiment.name}."


def draw_drive_loop(one: Result, axes: Axes) -> str:
    """Draw displacement over drive."""
    u, y, m = thin_rows(one.drive, one.measured, one.predicted)
    axes.plot(u, y, ".", color=MEASURED, ms=1.5, label="measured")
    axes.plot(u, m, color=_color(one), lw=1.0, label=_label(one))
    add_legend(axes, 0.18)
    axes.set(xlabel="drive, V", ylabel="displacement, um", title=f"{one.stage}: hysteresis")
    return f"Displacement over drive on the stage of {one.stage}: {one.experiment.name}."


def draw_errors(results: Sequence[Result], axes: Axes) -> str:
    """Draw model minus measured for one or two models."""
    for one in results:
        error = 1e3 * (one.predicted - one.measured)
        draw_trace(axes, one.t_s, error, _color(one), _label(one))
    add_legend(axes)
    axes.set(xlabel="time, s", ylabel="model - measured, nm", title=f"{results[0].stage}: error")
    return "Error over time: " + "; ".join(
        f"{_label(r)} {r.mean:.1f} +- {r.std:.1f} nm" for r in results
    )


def draw_tracking(results: Sequence[Result], axes: Axes) -> str:
    """Draw the rms of target minus displacement of each signal under the inverse's drive as
    bars."""
    at = np.arange(len(results))
    colors = [_color(r) for r in results]
    axes.barh(at, [r.tracking_rms for r in results], color=colors)
    axes.set_yticks(at, [r.experiment.name for r in results])
    axes.invert_yaxis()
    title = f"{results[0].stage}: inverse"
    axes.set(xlabel="target - displacement, nm rms", title=title)
    return "Tracking error: " + "; ".join(
        f"{r.experiment.name} {r.tracking_rms:.0f} nm rms" for r in results
    )


def _color(one: Result) -> str:
    return MODEL if one.experiment.rate else BEFORE


def _label(one: Result) -> str:
    return "rate-dependent" if one.experiment.rate else "static model"
