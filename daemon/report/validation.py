"""The report of a validation: models side by side on recordings that they have not seen."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.page import Page
from dehyst.daemon.report.plotting import MEASURED, MODEL, add_legend, draw_trace, thin_rows
from dehyst.models.identify.validation import Validation
from dehyst.models.recording import Recording


def report_validation(
    rows: Sequence[tuple[str, Recording, Validation]], words: Sequence[str]
) -> str:
    """The whole page as HTML text. rows: model name, recording, result; words: one line each."""
    out = Page("Validation")
    out.add_bullets(list(words))
    for model, recording, result in rows:
        out.add_heading(f"{model} on {recording.name}")
        out.add_pictures(
            partial(_draw_over_time, recording, result),
            partial(_draw_left, recording, result),
            partial(_draw_correlations, result),
        )
    return out.to_html()


def _draw_over_time(recording: Recording, result: Validation, axes: Axes) -> str:
    """Measured and foretold."""
    assert recording.displacement is not None
    t, y, m = thin_rows(recording.t_s, recording.displacement, result.predicted + result.offset)
    axes.plot(t, y, ".", color=MEASURED, ms=2.5, label="measured")
    axes.plot(t, m, color=MODEL, lw=1.2, label="foretold")
    add_legend(axes, 0.18)
    axes.set(xlabel="time, s", ylabel=f"displacement, {result.unit}", title="measured and foretold")
    return "Measured displacement and what the model foretells, over time."


def _draw_left(recording: Recording, result: Validation, axes: Axes) -> str:
    """What is left, over time."""
    assert recording.displacement is not None
    error = recording.displacement - result.predicted - result.offset
    draw_trace(axes, recording.t_s, error, MODEL, "left")
    axes.set(xlabel="time, s", ylabel=f"measured - model, {result.unit}", title="what is left")
    return f"What the model leaves over time: {result.rms:.3g} {result.unit} rms."


def _draw_correlations(result: Validation, axes: Axes) -> str:
    """Correlations of what is left with itself and with the drive."""
    at = np.arange(result.with_drive.size)
    axes.plot(at[1:], result.autocorrelation, ".-", color=MODEL, label="with itself")
    axes.plot(at, result.with_drive, ".-", color=MEASURED, label="with the drive")
    axes.axhspan(-result.chance, result.chance, color=MEASURED, alpha=0.15, lw=0)
    add_legend(axes, 0.18)
    axes.set(xlabel="rows before", ylabel="correlation", ylim=(-1, 1), title="what is left is like")
    return "Correlation of what is left with itself and with the drive; the band is chance."
