"""The comparison at the end of a set-up: a sine with a linear gain and with the model's inverse.

Both are played open loop, directly through the drivers. Neither drive leaves the limits, so nothing
is clipped.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.api.functions import invert, load_model
from dehyst.daemon.config import Config
from dehyst.daemon.config.drives import drive_range
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.setup.moving import TUNING
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording


@dataclass(frozen=True)
class SinePlan:
    """A sine to play. t_s: (N,) times; target: (N,) [unit]; volts: (N,) drives by name [V]; f_hz:
    frequency of the sine."""

    t_s: Floats
    target: Floats
    volts: dict[str, Floats]
    f_hz: float
    unit: str

    @property
    def stroke(self) -> float:
        """Peak-to-peak amplitude of the target [unit]."""
        return float(np.ptp(self.target))


LINEAR, COMPENSATED = "linear gain", "compensated"
PICTURE = "tracking.png"


def plan_sine(bench: Workbench) -> SinePlan:
    """Plan a sine over most of the reachable range, with a linear gain and with the model's
    inverse."""
    config, model = bench.config(), load_model(bench.model_path)
    linear = plan_linear(config, model, bench.recording("record"), bench.wishes.band_hz)
    return with_inverse(linear, config, model, {})


def plan_linear(
    config: Config, model: Model, one: Recording, band_hz: float | None, pace: float = 1.0
) -> SinePlan:
    """Plan the sine with the linear gain of a recording, within the limits and the rates for which
    the model is valid. pace: frequency as a share of the highest allowed one."""
    limits, gain_v = config.limits, config.actuator.gain
    assert one.displacement is not None
    good = ~(one.missing_drive | one.missing_displacement)
    slope, offset = np.polyfit(one.drive[good], one.displacement[good], 1)
    low, high = displacement_range(model, *drive_range(config, model))
    ends = sorted((slope * v / gain_v + offset) for v in (limits.min_v, limits.max_v))
    low, high = max(low, ends[0]), min(high, ends[1])
    middle, half = 0.5 * (low + high), 0.5 * TUNING.share * (high - low)
    steepest = math.pi * (limits.max_v - limits.min_v)
    rate_max = gain_v * (model.validity.rate_max or math.inf)
    rate_max = min(rate_max / (1.0 + TUNING.spare), TUNING.slew_share * limits.slew_v_per_s)
    f_hz = pace * min(band_hz or TUNING.band_hz, rate_max / steepest)
    t_s = np.arange(round(TUNING.cycles / f_hz * config.loop.rate_hz) + 1) / config.loop.rate_hz
    target = middle - math.copysign(half, slope) * np.cos(2.0 * np.pi * f_hz * t_s)
    linear = gain_v * (target - offset) / slope
    return SinePlan(t_s, target, {LINEAR: linear}, f_hz, model.displacement_unit)


def with_inverse(
    plan: SinePlan, config: Config, model: Model, others: Mapping[str, Floats]
) -> SinePlan:
    """Return the plan with the voltages of the model's inverse added. others: columns with the
    simultaneous motion of other axes."""
    limits, gain_v = config.limits, config.actuator.gain
    inverse = invert(
        model,
        {"t_s": plan.t_s, f"target_{plan.unit}": plan.target, **others},
        low=limits.min_v / gain_v,
        high=limits.max_v / gain_v,
        slew=limits.slew_v_per_s / gain_v,
        start=limits.min_v / gain_v,
        period=1.0 / config.loop.rate_hz,
    )
    return replace(plan, volts=plan.volts | {COMPENSATED: gain_v * np.asarray(inverse)})


def describe_sine(bench: Workbench) -> str:
    """Describe the motion of `track_sine`."""
    plan = plan_sine(bench)
    low = min(float(v.min()) for v in plan.volts.values())
    high = max(float(v.max()) for v in plan.volts.values())
    return (
        f"moves: a sine of {plan.stroke:.4g} {plan.unit} peak to peak at {plan.f_hz:.3g} Hz, "
        f"{TUNING.cycles} times, with a linear gain and with the model's inverse: {low:.4g} to "
        f"{high:.4g} V (repeated if this machine was too busy); then it returns"
    )


def track_sine(bench: Workbench) -> dict[str, Any]:
    """Play both drives, measure their errors and draw the picture."""
    plan, rate_hz = plan_sine(bench), bench.config().loop.rate_hz
    played = {}
    for name, volts in plan.volts.items():

        def once(name: str = name, volts: Floats = volts) -> Recording:
            found = bench.play(plan.t_s, volts, TUNING.exercise_s, name)
            bench.keep(found, stem_of(name))
            return found

        played[name] = play_in_time(once, plan.t_s.size - 1)
    return summarise_comparison(plan, played, rate_hz, bench.folder / PICTURE)


def stem_of(name: str) -> str:
    """Return the file stem of a recording of the comparison."""
    return f"sine-{name.replace(' ', '-')}"


def play_in_time(once: Callable[[], Recording], samples: int) -> tuple[Recording, float]:
    """Repeat a run until it has hardly any late samples, at most TUNING.attempts times; return the
    run with the fewest and their share. While the machine stalls, the voltage stays constant, and
    the resulting error is not the model's."""
    runs = []
    for _ in range(TUNING.attempts):
        found = once()
        runs.append((found, 1.0 - found.size / samples))
        if runs[-1][1] <= TUNING.most_late:
            break
    return min(runs, key=lambda run: run[1])


def summarise_comparison(
    plan: SinePlan,
    played: Mapping[str, tuple[Recording, float]],
    rate_hz: float,
    picture: Path,
) -> dict[str, Any]:
    """Return the step's result and draw the picture. played: by name, the recording and its share
    of late samples."""
    from dehyst.daemon.report import tracking  # importing matplotlib takes long
    from dehyst.daemon.report.plotting import draw_side_by_side

    before, after = (
        tracking.Track(name, *judged(plan, played[name][0], rate_hz))
        for name in (LINEAR, COMPENSATED)
    )
    draws = (
        partial(tracking.draw_displacements, before, after, f"{plan.f_hz:.3g} Hz sine"),
        partial(tracking.draw_tracking_error, before, after),
        partial(tracking.draw_measured_over_target, before, after),
    )
    with whole_file(picture) as file:
        file.write(draw_side_by_side(draws, (1.5, 1.5, 1.0)))
    smaller, latest = before.rms_nm / after.rms_nm, max(late for _, late in played.values())
    busy = ""
    if latest > TUNING.most_late:
        busy = (
            f"; this machine was too busy to judge ({latest:.1%} of the samples were too late): "
            "--from track repeats it"
        )
    return {
        "words": f"{plan.stroke:.4g} {plan.unit} at {plan.f_hz:.3g} Hz: {before.rms_nm:.0f} nm rms "
        f"with a linear gain, {after.rms_nm:.0f} nm compensated, {smaller:.1f} times smaller, "
        f"with the gauge's zero set in the previous cycle; {picture.name}{busy}",
        "linear_rms_nm": before.rms_nm,
        "compensated_rms_nm": after.rms_nm,
        "times_smaller": smaller,
        "late_share": latest,
        "stroke_um": plan.stroke,
        "frequency_hz": plan.f_hz,
        "picture": picture.name,
    }


def judged(plan: SinePlan, found: Recording, rate_hz: float) -> tuple[Floats, Floats, Floats]:
    """Return (t_s, target, measured) of the cycles that are judged, with the gauge's zero set in
    the cycle before them: the comparison judges the shape; the mean position is corrected by the
    trim and `dehyst zero`.

    The reading of a sample is compared with the target of the sample before it, whose voltage was
    in effect.
    """
    assert found.displacement is not None
    written = np.round(found.t_s * rate_hz).astype(np.int64)[:-1]
    target = plan.target[np.clip(written, 0, plan.target.size - 1)]
    cycle = found.t_s[1:] * plan.f_hz
    measured = found.displacement[1:]
    zeroing = (cycle >= TUNING.zero_from - 1) & (cycle < TUNING.zero_from)
    zero = float(np.nanmean((measured - target)[zeroing]))
    after = (cycle >= TUNING.zero_from) & (cycle < TUNING.cycles)
    return found.t_s[1:][after], target[after], measured[after] - zero
