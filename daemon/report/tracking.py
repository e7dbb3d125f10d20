"""Pictures of a stage that follows a trajectory with two different compensations."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.plotting import BEFORE, MEASURED, MODEL, add_legend
from dehyst.models.recording import Floats


@dataclass(frozen=True)
class Track:
    """One run: t_s, target_um, measured_um (M,)."""

    name: str
    t_s: Floats
    target_um: Floats
    measured_um: Floats

    @property
    def rms_nm(self) -> float:
        """Rms of measured minus target [nm]."""
        return 1e3 * float(np.sqrt(np.nanmean((self.measured_um - self.target_um) ** 2)))


def draw_displacements(before: Track, after: Track, title: str, axes: Axes) -> str:
    """Draw set-point and displacement over the first two seconds of the tracks."""
    begin = float(before.t_s[0])
    axes.plot(before.t_s, before.target_um, color=MEASURED, lw=3, alpha=0.35, label="set-point")
    for track, color in ((before, BEFORE), (after, MODEL)):
        axes.plot(track.t_s, track.measured_um, color=color, lw=1.2, label=track.name)
    axes.set(xlabel="time, s", ylabel="displacement, um", title=title, xlim=(begin, begin + 2.0))
    add_legend(axes)
    return f"{title}: displacement over time, {before.name} and {after.name}."


def draw_tracking_error(before: Track, after: Track, axes: Axes) -> str:
    """Draw the tracking error over time."""
    said = []
    for track, color in ((before, BEFORE), (after, MODEL)):
        said.append(f"{track.name}: {track.rms_nm:.0f} nm rms")
        axes.plot(
            track.t_s,
            1e3 * (track.measured_um - track.target_um),
            color=color,
            lw=1,
            label=said[-1],
        )
    axes.set(xlabel="time, s", ylabel="error, nm", title="tracking error")
    add_legend(axes, 0.2)
    return f"Tracking error over time. {'; '.join(said)}."


def draw_measured_over_target(before: Track, after: Track, axes: Axes) -> str:
    """Draw the measured displacement over the set-point."""
    for track, color in ((before, BEFORE), (after, MODEL)):
        axes.plot(track.target_um, track.measured_um, color=color, lw=1)
    axes.set(xlabel="set-point, um", ylabel="measured, um", title="measured over set-point")
    return "Measured displacement over the set-point: a loop without compensation, a line with it."
