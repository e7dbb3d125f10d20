"""The picture of a mismatch on one time axis: what the stage did, and its error with what happened.

story: anything with t_s, target, measured (N,) and the times of its events [s].
"""

from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogFormatter

from dehyst.daemon.report.plotting import BEFORE, MEASURED, MODEL, add_legend, thin_rows
from dehyst.models.recording import Floats

STEP_S = 1.0
WORDS = 0.7  # of the curve's height, for the words above it
EVENTS = (
    ("appeared_s", "an effect appears"),
    ("flagged_s", "flagged"),
    ("told_s", "named"),
    ("accepted_s", "accepted"),
    ("over_s", ""),  # what became of it
)
ENDS = {"accepted": "proven", "returned": "went back", "rejected": "rejected"}


class Told(Protocol):
    """What is drawn."""

    t_s: Floats
    target: Floats
    measured: Floats

    @property
    def state(self) -> str:
        """What became of the offer."""


def draw_story_ways(story: Told, axes: Axes) -> str:
    """Target and measured displacement over the whole time."""
    t_s, target, measured = thin_rows(story.t_s, story.target, story.measured)
    axes.plot(t_s, target, color=MEASURED, lw=0.6, alpha=0.6, label="target")
    axes.plot(t_s, measured, color=MODEL, lw=0.4, alpha=0.8, label="measured")
    axes.set(ylabel="displacement, um", title="what the stage does")
    add_legend(axes)
    _mark(story, axes, words=False)
    return "Target and measured displacement over the whole story."


def draw_story_error(story: Told, axes: Axes) -> str:
    """The tracking error, rms of each second, and what happened when."""
    second = np.floor(story.t_s / STEP_S).astype(int)
    error = story.measured - story.target
    at = np.unique(second)
    rms = [1e3 * float(np.sqrt(np.mean(error[second == k] ** 2))) for k in at]
    axes.plot(STEP_S * (at + 0.5), rms, color=BEFORE, lw=1.2)
    axes.set(
        xlabel="time, s",
        ylabel="error, nm rms",
        yscale="log",
        title="tracking error of each second",
    )
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** WORDS)
    for ticks in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        ticks(LogFormatter(labelOnlyBase=False, minor_thresholds=(2, 0.5)))
    said = _mark(story, axes, words=True)
    return f"Tracking error of each second on a logarithmic axis. {said}"


def _mark(story: Told, axes: Axes, words: bool) -> str:
    said = []
    for k, (name, text) in enumerate(EVENTS):
        at_s = float(getattr(story, name, np.nan))
        if not np.isfinite(at_s):
            continue
        text = text or ENDS.get(story.state, "the trial is not over")
        said.append(f"{text} at {at_s:.0f} s")
        axes.axvline(at_s, color=MEASURED, lw=0.8, ls=":")
        if words:
            axes.annotate(
                text,
                (at_s, 0.97 - 0.08 * k),
                xycoords=("data", "axes fraction"),
                xytext=(3, 0),
                textcoords="offset points",
                fontsize=8,
                va="top",
            )
    return "; ".join(said) + "."
