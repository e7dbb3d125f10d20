"""The validation report: models compared on recordings that were not used to fit them."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.page import Page
from dehyst.daemon.report.plotting import (
    MEASURED,
    MODEL,
    add_legend,
    draw_trace,
    limit_to,
    thin_rows,
)
from dehyst.models.identify.validation import CLAIM, Validation
from dehyst.models.recording import Recording
from dehyst.models.units import how_many, spell_unit

LEAST_SHOWN = 0.0005  # share of the rows; a smaller one would print as 0.0 %


def say_validation(model: str, v: Validation) -> str:
    """State in one line how well a model predicts a recording, and add notes on rows outside its
    validity, on late samples and on repeated readings."""
    unit = spell_unit(v.unit)
    claim = "no claimed error" if v.claim is None else f"the model claims {v.claim:.4g}"
    noise = f"{v.noise:.4g}" if math.isfinite(v.noise) else "not known"
    verdict = "WORSE than it claims" if v.worse else "as good as it claims"
    text = (
        f"{model} on {v.name}: {v.rms:.4g} {unit} rms, {say_share(v)}, {claim}"
        + (f": {verdict}" if v.claim is not None else "")
        + f"; offset {v.offset:.4g} {unit}, noise {noise}; the residual is "
        + ("white" if v.white else "not white")
        + f", correlation with the drive {v.tied_to_drive:.2g} (chance {v.chance:.2g})"
        + say_within(v)
        + (f"; this band is {v.interval_is}" if v.interval_is else "")
        + f"; start {v.start}"
    )
    if v.has_interval and v.unstated >= LEAST_SHOWN:
        text += (
            f"\nnote: {v.unstated:.1%} of the rows have no 95 % band: the drive leaves the model's "
            "validity or is slower than in its recordings; record such a drive"
        )
    left = math.sqrt(max(0.0, v.rms**2 - v.noisier**2))
    if v.claim is not None and v.rms > CLAIM * v.claim and not v.worse:
        text += (
            f"\nnote: the gauge is noisier than that of the model's recordings: {v.noisier:.3g} "
            f"{unit} rms of its noise are not counted as error, which leaves {left:.3g}"
        )
    if v.late:
        late = how_many(v.late, "row at a late sample is", "rows at late samples are")
        text += f"\nnote: {late} not judged"
    if v.repeats:
        before = "the previous reading and"
        repeats = how_many(v.repeats, f"row repeats {before} is", f"rows repeat {before} are")
        text += f"\nnote: {repeats} not judged: the gauge was polled faster than it updates"
    if v.stuck:
        same = "exactly the same reading while the drive moves and"
        stuck = how_many(v.stuck, f"row has {same} is", f"rows have {same} are")
        text += f"\nnote: {stuck} not judged: the gauge is stuck or at its limit there"
    if v.outside >= LEAST_SHOWN:
        text += f"\nnote: {v.outside:.1%} of the rows are outside the model's validity"
    return text


def say_within(v: Validation) -> str:
    """Return the share of the rows that the 95 % band and the gauge's noise explain, "" if the band
    applies to too few."""
    if not v.has_interval:
        return "; the model states no 95 % band"
    if v.within is None:
        return ""
    return f"; {v.within:.1%} of the rows within its 95 % band and the noise"


def say_share(v: Validation) -> str:
    """Return the error as a share of the span, or why there is none."""
    if not math.isfinite(v.share):
        return "no share of the span (the reading is constant)"
    return f"{v.share:.3%} of the span"


def say_judgement() -> str:
    """State what makes a model worse than it claims, and how the gauge's noise enters."""
    return (
        f"A model is worse than it claims if its error is more than {CLAIM:g} times the claimed "
        "one; where the gauge is noisier than that of the model's own recordings, the power of the "
        "additional noise is first subtracted from that of the error."
    )


def report_validation(rows: Sequence[tuple[str, Recording, Validation]]) -> str:
    """Return the whole page as HTML text. rows: model name, recording, result."""
    out = Page("Validation")
    out.add_bullets([say_validation(model, result) for model, _, result in rows])
    out.add_text(say_judgement())
    for model, recording, result in rows:
        out.add_heading(f"{model} on {recording.name}")
        out.add_pictures(
            partial(draw_over_time, recording, result),
            partial(draw_left, recording, result),
            partial(draw_correlations, result),
        )
    return out.to_html()


def draw_over_time(recording: Recording, result: Validation, axes: Axes) -> str:
    """Draw measured and predicted displacement over time."""
    assert recording.displacement is not None
    t, y, m = thin_rows(recording.t_s, recording.displacement, result.predicted + result.offset)
    axes.plot(t, y, ".", color=MEASURED, ms=2.5, label="measured")
    axes.plot(t, m, color=MODEL, lw=1.2, label="predicted")
    add_legend(axes, 0.18)
    axes.set(
        xlabel="time, s", ylabel=f"displacement, {result.unit}", title="measured and predicted"
    )
    return "Measured and predicted displacement over time."


def draw_left(recording: Recording, result: Validation, axes: Axes) -> str:
    """Draw the residual over time."""
    assert recording.displacement is not None
    error = recording.displacement - result.predicted - result.offset
    draw_trace(axes, recording.t_s, error, MODEL, "left")
    limit_to(axes, error)
    axes.set(xlabel="time, s", ylabel=f"measured - model, {result.unit}", title="residual")
    return f"Residual of the model over time: {result.rms:.3g} {result.unit} rms."


def draw_correlations(result: Validation, axes: Axes) -> str:
    """Draw the correlations of the residual with itself and with the drive."""
    at = np.arange(result.with_drive.size)
    axes.plot(at[1:], result.autocorrelation, ".-", color=MODEL, label="with itself")
    axes.plot(at, result.with_drive, ".-", color=MEASURED, label="with the drive")
    axes.axhspan(-result.chance, result.chance, color=MEASURED, alpha=0.15, lw=0)
    add_legend(axes, 0.18)
    axes.set(xlabel="rows before", ylabel="correlation", ylim=(-1, 1), title="correlation")
    return "Correlation of the residual with itself and with the drive; the band is chance."
