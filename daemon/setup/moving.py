"""The steps that move the stage: gentle loops, the recordings, and the comparison at the end.

Each comes as two functions: what it will move and how far, in words, and the doing. Every drive
is checked against the limits as a whole before anything moves (dehyst.daemon.tools.acquire).
"""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.api.functions import invert, load_model
from dehyst.daemon.config import Config
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.loop.reach import displacement_range, drive_range
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.drive_design.coverage import measure_coverage
from dehyst.models.drive_design.excitation import Excitation, design
from dehyst.models.errors import NotNow
from dehyst.models.recording import Floats, Recording


@dataclass(frozen=True)
class Tuning:
    """tests/daemon/setup/test_emulated.py holds what comes of these; no benchmark has set them."""

    gentle_shares: tuple[float, ...] = (0.1, 1.0)  # of the range, one recording each
    gentle_loop_s: float = 4.0  # of one loop through the whole range, longer where slew asks it
    gentle_slew: float = 0.25  # of the slew limit
    loops: int = 2
    follows: float = 0.9  # correlation of gauge and drive: less, and they do not belong together
    most_missing: float = 0.01  # of the readings
    seconds: float = 20.0  # of each recording
    band_hz: float = 1.0  # fastest motion through the range; less where rate or slew allow less
    around: tuple[float, float] = (0.5, 1.5)  # of it: the sines of a recording
    sines: int = 2
    samples_a_period: float = 24.0
    exercise_s: float = 5.0  # before each recording: what has rested creeps
    cycles: int = 6  # of the comparison
    zero_from: int = 2  # cycles before those that are judged; in the last of them the zero is set
    share: float = 0.94  # of what can be reached, in the comparison
    slew_share: float = 0.5  # of the slew limit, the most that the comparison may need
    attempts: int = 3  # of the comparison, where the machine was too busy for it
    most_late: float = 0.002  # of the samples: more, and it is done again
    spare: float = 0.1  # of the fastest rate that the model has seen


TUNING = Tuning()


# -- gentle loops ---------------------------------------------------------------------------------


def describe_gentle(bench: Workbench) -> str:
    """What `exercise_gently` moves."""
    config = bench.config()
    now_v, spec = bench.output_now(config)
    limits = config.limits
    way = max(abs(now_v - limits.min_v), abs(now_v - limits.max_v))
    small = limits.min_v + TUNING.gentle_shares[0] * (limits.max_v - limits.min_v)
    period_s = _gentle_period_s(config, 1.0)
    return (
        f"moves: from the {now_v:.2f} V where {spec.identity or config.actuator.driver} stands, at "
        f"{config.safe.ramp_v_per_s:g} V/s; {TUNING.loops} slow loops from {limits.min_v:g} to "
        f"{small:g} V; where the gauge follows, {TUNING.loops} from {limits.min_v:g} to "
        f"{limits.max_v:g} V of {period_s:.3g} s each; then back. {way:.4g} V away at most"
    )


def exercise_gently(bench: Workbench) -> dict[str, Any]:
    """A few slow loops, small ones first, and does the gauge follow? Raises NotNow where not."""
    config = bench.config()
    gains: list[float] = []
    for share in TUNING.gentle_shares:
        t_s, volts = _gentle_loops(config, share)
        found = bench.play(t_s, volts, 0.0, f"loops of {100 * share:g} % of the range")
        bench.keep(found, "gentle")
        gains.append(check_gauge_follows(found, config.limits.max_v - config.limits.min_v))
    assert found.displacement is not None
    stroke = float(np.nanmax(found.displacement) - np.nanmin(found.displacement))
    unit = found.displacement_unit
    return {
        "words": f"the gauge follows: {stroke:.4g} {unit} of stroke, {gains[-1]:.4g} {unit}/V",
        "stroke": stroke,
        "gain": gains[-1],
    }


def check_gauge_follows(recording: Recording, span_v: float) -> float:
    """The slope of gauge over drive [displacement unit / V]. Raises NotNow where the gauge does not
    show that it sits on the stage which the amplifier drives."""
    drive, y = recording.drive, recording.displacement
    assert y is not None
    good = ~(recording.missing_drive | recording.missing_displacement)
    missing = 1.0 - float(np.mean(good))
    if missing > TUNING.most_missing:
        raise NotNow(
            f"the gauge gave no reading in {missing:.0%} of the samples: is it plugged in, and its "
            "range wide enough for this stroke? (at full scale a reading counts as none)"
        )
    moved = float(np.ptp(drive[good]))
    follows = 0.0
    if np.ptp(y[good]) > 0 and moved > 0:
        follows = abs(float(np.corrcoef(drive[good], y[good])[0, 1]))
    if follows < TUNING.follows:
        raise NotNow(
            f"the gauge does not follow: over {moved:.3g} V ({moved / span_v:.0%} of the range) it "
            f"goes with the voltage by {follows:.0%} only. Are gauge and amplifier those of the "
            "same stage, on this axis? Mend it, and give the same command again"
        )
    return float(np.polyfit(drive[good], y[good], 1)[0])


def _gentle_period_s(config: Config, share: float) -> float:
    span = share * (config.limits.max_v - config.limits.min_v)
    slowest = math.pi * span / (TUNING.gentle_slew * config.limits.slew_v_per_s)
    return max(TUNING.gentle_loop_s * max(share, 0.5), slowest)


def _gentle_loops(config: Config, share: float) -> tuple[Floats, Floats]:
    limits, period_s = config.limits, _gentle_period_s(config, share)
    t_s = np.arange(0.0, TUNING.loops * period_s, 1.0 / config.loop.rate_hz)
    half = 0.5 * share * (limits.max_v - limits.min_v)
    return t_s, limits.min_v + half * (1.0 - np.cos(2.0 * np.pi * t_s / period_s))


# -- recordings -----------------------------------------------------------------------------------


def drive_for(bench: Workbench, seed: int) -> Excitation:
    """The drive of a recording; with a seed above 0 one of other sines, and one sine more."""
    config, wishes = bench.config(), bench.wishes
    limits, rate_hz = config.limits, config.loop.rate_hz
    slowest, fastest = TUNING.around
    by_slew = limits.slew_v_per_s / (fastest * math.pi * (limits.max_v - limits.min_v))
    most_hz = min(TUNING.band_hz, rate_hz / TUNING.samples_a_period, by_slew)
    band_hz = wishes.band_hz or most_hz
    return design(
        limits.min_v,
        limits.max_v,
        (slowest * band_hz, fastest * band_hz),
        wishes.seconds or TUNING.seconds,
        rate_hz,
        sines=TUNING.sines + (seed > 0),
        slew_per_s=limits.slew_v_per_s,
        seed=seed,
    )


def describe_drive(bench: Workbench, seed: int, exercise_s: float) -> str:
    """What recording with the drive of this seed moves."""
    drive, limits = drive_for(bench, seed), bench.config().limits
    sines = ", ".join(f"{f:.3g}" for f in drive.frequencies_hz)
    return (
        f"moves: {exercise_s:g} s of full loops, then {drive.t_s[-1]:.3g} s of sines of {sines} Hz "
        f"together, from {drive.u.min():.4g} to {drive.u.max():.4g} V at up to "
        f"{drive.rate_max:.4g} V/s (limits: {limits.min_v:g} to {limits.max_v:g} V, "
        f"{limits.slew_v_per_s:g} V/s); it ends where it was"
    )


def record_drive(bench: Workbench, seed: int, exercise_s: float, stem: str) -> dict[str, Any]:
    """Play the drive of this seed and record; does it excite enough? Raises NotNow where not."""
    drive = drive_for(bench, seed)
    found = bench.play(drive.t_s, drive.u, exercise_s, "recording")
    path = bench.keep(found, stem)
    covered = measure_coverage([found])
    if covered.missing:
        raise NotNow(
            f"{path} does not excite enough: {'; '.join(covered.missing)}. Give a longer "
            "--duration or another --band"
        )
    due = round(float(found.t_s[-1] - found.t_s[0]) * bench.config().loop.rate_hz) + 1
    late = max(0, due - found.size)
    words = (
        f"{path.name}: {found.size} samples, {late} too late, {covered.covered:.0%} of drive and "
        f"rate covered"
    )
    if covered.missing_rate:
        words += f"; not enough for a rate-dependent model: {'; '.join(covered.missing_rate)}"
    return {"words": words, "recording": path.name, "late": late, "covered": covered.covered}


# -- the comparison -------------------------------------------------------------------------------


@dataclass(frozen=True)
class SinePlan:
    """t_s: (N,); target: (N,) [unit]; volts by name, (N,) each; f_hz: of the sine."""

    t_s: Floats
    target: Floats
    volts: dict[str, Floats]
    f_hz: float
    unit: str

    @property
    def stroke(self) -> float:
        """Peak to peak."""
        return float(np.ptp(self.target))


LINEAR, COMPENSATED = "linear gain", "compensated"


def plan_sine(bench: Workbench) -> SinePlan:
    """A sine over most of the reach, with a linear gain and with the inverse of the model: neither
    leaves the limits, so nothing is clipped."""
    config, model = bench.config(), load_model(bench.model_path)
    limits, gain_v = config.limits, config.actuator.gain
    one = bench.recording("record")
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
    f_hz = min(bench.wishes.band_hz or TUNING.band_hz, rate_max / steepest)
    unit = model.displacement_unit
    t_s = np.arange(round(TUNING.cycles / f_hz * config.loop.rate_hz) + 1) / config.loop.rate_hz
    target = middle - math.copysign(half, slope) * np.cos(2.0 * np.pi * f_hz * t_s)
    inverse = invert(
        model,
        t_s,
        target,
        low=limits.min_v / gain_v,
        high=limits.max_v / gain_v,
        slew=limits.slew_v_per_s / gain_v,
        start=limits.min_v / gain_v,
        period=1.0 / config.loop.rate_hz,
        unit=unit,
    )
    linear = gain_v * (target - offset) / slope
    return SinePlan(
        t_s, target, {LINEAR: linear, COMPENSATED: gain_v * np.asarray(inverse)}, f_hz, unit
    )


def describe_sine(bench: Workbench) -> str:
    """What `track_sine` moves."""
    plan = plan_sine(bench)
    low = min(float(v.min()) for v in plan.volts.values())
    high = max(float(v.max()) for v in plan.volts.values())
    return (
        f"moves: a sine of {plan.stroke:.4g} {plan.unit} peak to peak at {plan.f_hz:.3g} Hz, "
        f"{TUNING.cycles} times, with a linear gain and with the model's inverse: {low:.4g} to "
        f"{high:.4g} V (again where this machine was too busy); it ends where it was"
    )


def track_sine(bench: Workbench) -> dict[str, Any]:
    """Play both and measure; the picture."""
    from dehyst.daemon.report import tracking  # matplotlib takes its time
    from dehyst.daemon.report.plotting import draw_side_by_side

    plan, tracks, late = plan_sine(bench), {}, dict[str, float]()
    for name, volts in plan.volts.items():
        found, late[name] = _play_in_time(bench, plan, name, volts)
        tracks[name] = tracking.Track(name, *judged(plan, found, bench.config().loop.rate_hz))
    before, after = tracks[LINEAR], tracks[COMPENSATED]
    draws = (
        partial(tracking.draw_displacements, before, after, f"{plan.f_hz:.3g} Hz sine"),
        partial(tracking.draw_tracking_error, before, after),
        partial(tracking.draw_measured_over_target, before, after),
    )
    picture = Path("tracking.png")
    with whole_file(bench.folder / picture) as file:
        file.write(draw_side_by_side(draws, (1.5, 1.5, 1.0)))
    smaller, latest = before.rms_nm / after.rms_nm, max(late.values())
    busy = (
        f"; this machine was too busy to judge ({latest:.1%} of the samples were too late): "
        "--from track repeats it"
    )
    return {
        "words": f"{plan.stroke:.4g} {plan.unit} at {plan.f_hz:.3g} Hz: {before.rms_nm:.0f} nm rms "
        f"with a linear gain, {after.rms_nm:.0f} nm compensated, {smaller:.1f} times smaller, the "
        f"gauge's zero set in the cycle before; {picture}" + busy * (latest > TUNING.most_late),
        "linear_rms_nm": before.rms_nm,
        "compensated_rms_nm": after.rms_nm,
        "times_smaller": smaller,
        "late_share": latest,
        "stroke_um": plan.stroke,
        "frequency_hz": plan.f_hz,
        "picture": str(picture),
    }


def _play_in_time(
    bench: Workbench, plan: SinePlan, name: str, volts: Floats
) -> tuple[Recording, float]:
    """The run with the fewest late samples, of as many as it takes to have hardly any, and their
    share: where the machine stands still, so does the voltage, and the error is not the model's."""
    runs = []
    for _ in range(TUNING.attempts):
        found = bench.play(plan.t_s, volts, TUNING.exercise_s, name)
        bench.keep(found, f"sine-{name.replace(' ', '-')}")
        runs.append((found, 1.0 - found.size / (plan.t_s.size - 1)))
        if runs[-1][1] <= TUNING.most_late:
            break
    return min(runs, key=lambda run: run[1])


def judged(plan: SinePlan, found: Recording, rate_hz: float) -> tuple[Floats, Floats, Floats]:
    """(t_s, target, measured) of the cycles that are judged, with the gauge's zero set in the cycle
    before them: the place is the trim's and `dehyst zero`'s matter, here it is the shape.

    The reading of a sample belongs to the voltage written at the sample before it, and so to that
    sample's target.
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
