"""Pictures of learning: the error of each pass, and the first pass compared with the newest."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.plotting import BEFORE, MODEL, UNUSED, add_legend, draw_side_by_side
from dehyst.models.learning.passes import Outcome
from dehyst.models.recording import Floats
from dehyst.models.units import how_many


def draw_by_pass(outcomes: Sequence[Outcome], unit: str, axes: Axes) -> str:
    """Draw the rms error of each pass, noise subtracted."""
    for learned, color, name in (
        (True, MODEL, "learned from"),
        (False, UNUSED, "not learned from"),
    ):
        of = [one for one in outcomes if one.learned is learned]
        numbers, rms = [one.number for one in of], [one.rms for one in of]
        axes.plot(numbers, rms, "o", color=color, label=name, ms=4)
    axes.set(xlabel="pass", ylabel=f"error, {unit} rms", title="error by pass, without the noise")
    axes.set_ylim(bottom=0.0)
    add_legend(axes)
    return f"Error of {how_many(len(outcomes), 'pass', 'passes')}."


def draw_before_and_after(
    first: Floats, last: Floats, period_s: float, unit: str, axes: Axes
) -> str:
    """Draw the measured error of the first and of the newest pass."""
    t_s = period_s * np.arange(first.size)
    axes.plot(t_s, first, color=BEFORE, lw=0.8, label="first pass")
    axes.plot(t_s, last, color=MODEL, lw=0.8, label="newest pass")
    axes.set(xlabel="time, s", ylabel=f"measured error, {unit}", title="before and after")
    add_legend(axes, 0.2)
    return "Measured error over a pass, the first and the newest."


def learning_picture(
    outcomes: Sequence[Outcome], errors: Sequence[Floats], period_s: float, unit: str
) -> bytes:
    """Return both pictures as a PNG. errors: (n,) of the first pass and of the newest."""
    return draw_side_by_side(
        (
            lambda axes: draw_by_pass(outcomes, unit, axes),
            lambda axes: draw_before_and_after(errors[0], errors[-1], period_s, unit, axes),
        ),
        (1.0, 1.4),
    )
