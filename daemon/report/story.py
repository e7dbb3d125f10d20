"""Picture of a mismatch: the error before, during and after it as bands on one time axis, and one
second of each phase, at the same position in the pattern, large enough to distinguish target and
measurement.

story: any object with t_s, target, measured (N,) in um and the times of its events [s].
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.plotting import (
    BEFORE,
    MEASURED,
    MODEL,
    UNUSED,
    Draw,
    add_legend,
    draw_rows,
)
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.error_size import finite_rms

SECOND_S = 1.0
"""Length of a close look; also the unit of time for the band of extremes."""
SETTLE_S = 3.0
"""Time after a change in which the error is that of the change itself."""
WORDS = 0.35  # of the curves' height, for the labels above them
LEGEND = 0.15  # the same, for the legend below them
TELLING = (0.7, 1.3)
"""A close look shows a second whose rms error lies within these multiples of the 90 % quantile."""
SHOWN = (2.4, 5.0)
"""Axis limit, least and most, in multiples of the largest rms: a jump does not flatten the rest."""
MOST = 0.995
"""Share of the errors of each phase that lie within the axis, up to its largest limit."""
EVENTS = (
    ("appeared_s", "an effect appears"),
    ("flagged_s", "flagged"),
    ("reported_s", "named"),
    ("accepted_s", "accepted"),
    ("over_s", ""),  # the outcome of the offer
)
RMS = {"before": "before", "with the effect": "during", "after": "after", "on trial": "trial"}
"""Key of the judged figure for each phase."""
ENDS = {"accepted": "confirmed", "returned": "went back", "rejected": "rejected"}


class StoryData(Protocol):
    """Data for the picture."""

    t_s: Floats
    target: Floats
    measured: Floats

    @property
    def rms(self) -> Mapping[str, float]:
        """Rms errors [um] by the keys of RMS, if part of a phase was judged."""

    @property
    def state(self) -> str:
        """Outcome of the offer."""


class Phase(NamedTuple):
    """A phase of the story; part: (N,) mask of its samples."""

    name: str
    color: str
    part: Bools


def list_phases(story: StoryData) -> list[Phase]:
    """Return the phases before the effect, with it, and with the offered model, as far as the story
    goes."""
    t_s = story.t_s
    if not t_s.size:
        return []
    end_s = float(t_s[-1]) + 1.0
    appeared_s, accepted_s, over_s = (
        float(getattr(story, name, np.nan)) for name in ("appeared_s", "accepted_s", "over_s")
    )
    appeared_s = appeared_s if np.isfinite(appeared_s) else end_s
    with_till_s = accepted_s if np.isfinite(accepted_s) else end_s
    confirmed = story.state == "accepted"
    offered_till_s = over_s if np.isfinite(over_s) and not confirmed else end_s
    offered_from_s = with_till_s + SETTLE_S
    spans = (
        ("before", UNUSED, -np.inf, appeared_s),
        ("with the effect", BEFORE, appeared_s + SECOND_S, with_till_s),
        ("after" if confirmed else "on trial", MODEL, offered_from_s, offered_till_s),
    )
    phases = [Phase(name, color, (t_s >= a) & (t_s < b)) for name, color, a, b in spans]
    return [one for one in phases if one.part.any()]


def draw_story_bands(story: StoryData, axes: Axes) -> str:
    """Draw the tracking error over time within the band of its rms, with the events marked."""
    error = 1e3 * (story.measured - story.target)
    _draw_extremes(axes, story.t_s, error)
    said, top = [], 0.0
    for one in list_phases(story):
        judged = 1e3 * story.rms.get(RMS[one.name], np.nan)
        rms = judged if np.isfinite(judged) else finite_rms(error[one.part])
        first_s, last_s = story.t_s[one.part][[0, -1]]
        label = f"{one.name}: {rms:.0f} nm rms"
        axes.fill_between(
            [first_s, last_s], -rms, rms, color=one.color, alpha=0.75, lw=0, label=label, zorder=3
        )
        said.append(label)
        least, most = (times * rms for times in SHOWN)
        top = max(top, min(max(least, _size_of_most(error[one.part])), most))
    if np.isfinite(top) and top > 0.0:
        axes.set_ylim(-(1.1 + 2.2 * LEGEND) * top, (1.1 + 2.2 * WORDS) * top)
    if story.t_s.size > 1:
        axes.set_xlim(float(story.t_s[0]), float(story.t_s[-1]))
    axes.set(
        xlabel="time, s",
        ylabel="measured - target, nm",
        title="tracking error (grey) and its rms (bands)",
    )
    if said:
        axes.legend(loc="lower left", ncols=3, frameon=True, framealpha=0.85, edgecolor="white")
    happened = _mark(story, axes)
    return f"Tracking error over time. {'; '.join(said)}. {happened}"


def _size_of_most(error: Floats) -> float:
    """Return the size that all but a few of the errors have at most."""
    known = np.abs(error[np.isfinite(error)])
    return float(np.quantile(known, MOST)) if known.size else 0.0


def list_close_looks(story: StoryData) -> list[Draw]:
    """Return pictures of one second of each phase: the same second of the pattern, on the same
    scale."""
    phases = list_phases(story)
    at = _clearest_second(story, phases)
    if at is None:
        return []
    found = [(one, _same_second(story, one, at)) for one in phases]
    windows = [(one, window) for one, window in found if window is not None]
    shown = np.concatenate([x[w] for _, w in windows for x in (story.target, story.measured)])
    shown = shown[np.isfinite(shown)]
    limits = (float(shown.min()), float(shown.max())) if shown.size else (0.0, 0.0)
    return [partial(draw_one_second, story, one.name, one.color, w, limits) for one, w in windows]


def draw_one_second(
    story: StoryData, name: str, color: str, window: slice, limits: tuple[float, float], axes: Axes
) -> str:
    """Draw target and measurement over one second."""
    t_s = story.t_s[window]
    since = t_s - t_s[0] if t_s.size else t_s
    target, measured = story.target[window], story.measured[window]
    axes.plot(since, target, color=MEASURED, lw=1.2, label="target")
    axes.plot(since, measured, color=color, lw=1.8, label="measured")
    low, high = limits
    if np.isfinite(high - low) and high > low:
        axes.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    rms = finite_rms(1e3 * (measured - target))
    axes.set(xlabel="time, s", ylabel="displacement, um", title=f"{name}: {rms:.0f} nm rms here")
    add_legend(axes, 0.15)
    return f"One second, {name}: target and measured, {rms:.0f} nm rms apart."


def story_picture(story: StoryData) -> bytes:
    """Return a PNG: the bands on top, a close look at each phase below."""
    bands: Draw = partial(draw_story_bands, story)
    looks = list_close_looks(story)
    return draw_rows([[bands], looks] if looks else [[bands]])


def _draw_extremes(axes: Axes, t_s: Floats, error: Floats) -> None:
    """Draw a band from the least to the largest error in each fifth of a second."""
    if not t_s.size:
        return
    part = np.floor(t_s / (SECOND_S / 5)).astype(int)
    first = np.flatnonzero(np.r_[True, np.diff(part) != 0])
    low, high = np.fmin.reduceat(error, first), np.fmax.reduceat(error, first)
    at = t_s[first]
    gap = np.r_[False, np.diff(at) > SECOND_S]
    low, high = np.where(gap, np.nan, low), np.where(gap, np.nan, high)
    axes.fill_between(at, low, high, color=MEASURED, alpha=0.25, lw=0, step="post")


def _clearest_second(story: StoryData, phases: Sequence[Phase]) -> int | None:
    """Return the first sample of the second with the effect in which the error is largest relative
    to the range shown."""
    effect = next((one for one in phases if one.name == "with the effect"), None)
    count = _samples_a_second(story)
    if effect is None or count < 2:
        return None
    inside = np.flatnonzero(effect.part)
    some = inside[: max(0, inside.size - count + 1) : max(1, count // 10)]
    longest_s = 1.05 * SECOND_S  # a second in which samples were lost is longer
    starts = [
        int(k)
        for k in some
        if k + count <= story.t_s.size
        and effect.part[k + count - 1]
        and story.t_s[k + count - 1] - story.t_s[k] < longest_s
    ]
    if not starts:
        return None
    error = story.measured - story.target
    rms = np.array([finite_rms(error[k : k + count]) for k in starts])
    ways = np.array([_way(story, slice(k, k + count)) for k in starts])
    least, most = (share * float(np.quantile(rms, 0.9)) for share in TELLING)
    score = np.where((rms >= least) & (rms <= most), rms / np.maximum(ways, 1e-9), -1.0)
    return starts[int(np.argmax(score))]


def _same_second(story: StoryData, phase: Phase, at: int) -> slice | None:
    """Return the second of a phase with the same targets as the second at a sample, the newest of
    several; None if the phase is too short, or has no such second."""
    count = _samples_a_second(story)
    if phase.name == "with the effect":
        return slice(at, at + count)
    wanted = story.target[at : at + count]
    inside = np.flatnonzero(phase.part)
    if inside.size < count:
        return None
    sums = np.lib.stride_tricks.sliding_window_view(story.target[inside], count)
    far = np.array([float(np.max(np.abs(one - wanted))) for one in sums])
    best = inside.size - count - int(np.argmin(far[::-1]))
    apart = float(np.max(np.abs((story.measured - story.target)[at : at + count])))
    if not far[best] <= apart:
        return None
    return slice(int(inside[best]), int(inside[best]) + count)


def _samples_a_second(story: StoryData) -> int:
    if story.t_s.size < 3:
        return 0
    return min(story.t_s.size, round(SECOND_S / max(1e-6, float(np.median(np.diff(story.t_s))))))


def _way(story: StoryData, window: slice) -> float:
    both = np.concatenate([story.target[window], story.measured[window]])
    both = both[np.isfinite(both)]
    return float(np.ptp(both)) if both.size else np.inf


def _mark(story: StoryData, axes: Axes) -> str:
    """Draw lines at the events within the data, and return all events in words."""
    said: list[str] = []
    shown: list[tuple[float, str]] = []
    for name, text in EVENTS:
        at_s = float(getattr(story, name, np.nan))
        if not np.isfinite(at_s):
            continue
        text = text or ENDS.get(story.state, "the trial is not over")
        said.append(f"{text} at {at_s:.0f} s")
        if not story.t_s.size or not story.t_s[0] <= at_s <= story.t_s[-1]:
            continue
        if shown and at_s - shown[-1][0] < SECOND_S:
            shown[-1] = shown[-1][0], f"{shown[-1][1]}, {text}"
        else:
            shown.append((at_s, text))
    for k, (at_s, text) in enumerate(shown):
        axes.axvline(at_s, color=MEASURED, lw=0.9, ls=":", zorder=4)
        axes.annotate(
            text,
            (at_s, 0.98 - 0.08 * (k % 2)),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=9,
            va="top",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
            zorder=5,  # above the line of the next event
        )
    return f"{'; '.join(said)}." if said else ""
