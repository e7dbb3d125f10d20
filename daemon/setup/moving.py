"""The steps that move the stage: gentle loops and recordings (comparison.py has the comparison).

Each step has two functions: one describes what will move and how far, the other moves it. Each
whole drive is checked against the limits before anything moves (dehyst.daemon.acquire.one_axis).
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.config import Config
from dehyst.daemon.setup.questions import Wishes
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.drive_design.coverage import measure_coverage
from dehyst.models.drive_design.excitation import Excitation, design
from dehyst.models.errors import BadInput, NotNow
from dehyst.models.recording import Floats, Recording
from dehyst.models.units import how_many


@dataclass(frozen=True)
class Tuning:
    """Parameters of the motion. tests/daemon/setup/test_emulated.py checks their effect; no
    benchmark has set them."""

    gentle_shares: tuple[float, ...] = (0.1, 1.0)  # of the range, one recording each
    gentle_loop_s: float = 4.0  # of one loop through the whole range, longer if slew requires it
    gentle_slew: float = 0.25  # of the slew limit
    loops: int = 2
    follows: float = 0.9  # least correlation of a gauge and the drive of its axis
    most_missing: float = 0.01  # of the readings
    seconds: float = 20.0  # of each recording
    band_hz: float = 1.0  # fastest motion through the range; less if rate or slew require it
    around: tuple[float, float] = (0.5, 1.5)  # times band_hz: band of a recording's sines
    sines: int = 2
    samples_a_period: float = 24.0
    exercise_s: float = 5.0  # before each recording: a stage that has rested creeps
    cycles: int = 6  # of the comparison
    zero_from: int = 2  # cycles before the judged ones; the last of them sets the gauge's zero
    share: float = 0.94  # of the reachable range, in the comparison
    slew_share: float = 0.5  # of the slew limit, the most that the comparison may need
    attempts: int = 3  # at the comparison, if the machine is too busy
    most_late: float = 0.002  # of the samples; if more are late, the comparison is repeated
    spare: float = 0.1  # margin to the fastest rate for which the model is valid


TUNING = Tuning()
FRESH = 1  # seed of the drive for validation; 0 is the seed for identification


# -- gentle loops ---------------------------------------------------------------------------------


def describe_gentle(bench: Workbench) -> str:
    """Describe the motion of `exercise_gently`."""
    config = bench.config()
    check_drives(config, bench.wishes)
    now_v, spec = bench.output_now(config)
    limits = config.limits
    way = max(abs(now_v - limits.min_v), abs(now_v - limits.max_v))
    small = limits.min_v + TUNING.gentle_shares[0] * (limits.max_v - limits.min_v)
    period_s = _gentle_period_s(config, 1.0)
    return (
        f"moves: from the present {now_v:.2f} V of {spec.identity or config.actuator.driver}, at "
        f"{config.safe.ramp_v_per_s:g} V/s: {TUNING.loops} slow loops, {limits.min_v:g} to "
        f"{small:g} V; if the gauge responds, {TUNING.loops} full loops, {limits.min_v:g} to "
        f"{limits.max_v:g} V, {period_s:.3g} s each; then return (largest excursion {way:.4g} V)"
    )


def exercise_gently(bench: Workbench) -> dict[str, Any]:
    """Play a few slow loops, small ones first, and check that the gauge follows. Raises NotNow if
    it does not."""
    config = bench.config()
    gains: list[float] = []
    for share in TUNING.gentle_shares:
        t_s, volts = gentle_loops(config, share)
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
    """Return the slope of gauge over drive [displacement unit / V]. Raises NotNow if too many
    readings are missing, or if the gauge does not follow the drive and so may be on another
    stage."""
    drive, y = recording.drive, recording.displacement
    assert y is not None
    good = ~(recording.missing_drive | recording.missing_displacement)
    missing = 1.0 - float(np.mean(good))
    if missing > TUNING.most_missing:
        raise NotNow(
            f"the gauge gave no reading in {missing:.0%} of the samples: check that it is plugged "
            "in and that its range covers this stroke (a reading at full scale counts as none)"
        )
    moved = float(np.ptp(drive[good]))
    follows = 0.0
    if np.ptp(y[good]) > 0 and moved > 0:
        follows = abs(float(np.corrcoef(drive[good], y[good])[0, 1]))
    if follows < TUNING.follows:
        raise NotNow(
            f"the gauge does not follow: over {moved:.3g} V ({moved / span_v:.0%} of the range) "
            f"its correlation with the voltage is only {follows:.0%}. Check that gauge and "
            "amplifier belong to the same stage and axis, then run the same command again"
        )
    return float(np.polyfit(drive[good], y[good], 1)[0])


def _gentle_period_s(config: Config, share: float) -> float:
    span = share * (config.limits.max_v - config.limits.min_v)
    slowest = math.pi * span / (TUNING.gentle_slew * config.limits.slew_v_per_s)
    return max(TUNING.gentle_loop_s * max(share, 0.5), slowest)


def gentle_loops(config: Config, share: float) -> tuple[Floats, Floats]:
    """Return (N,) times and volts of slow loops through this share of the range, from its low
    end."""
    limits, period_s = config.limits, _gentle_period_s(config, share)
    t_s = np.arange(0.0, TUNING.loops * period_s, 1.0 / config.loop.rate_hz)
    half = 0.5 * share * (limits.max_v - limits.min_v)
    return t_s, limits.min_v + half * (1.0 - np.cos(2.0 * np.pi * t_s / period_s))


# -- recordings -----------------------------------------------------------------------------------


def drive_for(config: Config, wishes: Wishes, seed: int) -> Excitation:
    """Design the drive of a recording; a seed above 0 gives other sines, and one more."""
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


def check_drives(config: Config, wishes: Wishes) -> None:
    """Raise BadInput if a drive of the set-up cannot be designed, before anything moves."""
    for seed in (0, FRESH):
        try:
            drive_for(config, wishes, seed)
        except BadInput as error:
            given = {"--band": wishes.band_hz, "--duration": wishes.seconds}
            options = [f"{name} {value:g}" for name, value in given.items() if value is not None]
            raise BadInput(": ".join([*options, str(error)])) from None


def describe_drive(bench: Workbench, seed: int) -> str:
    """Describe the motion of a recording with the drive of this seed."""
    config = bench.config()
    check_drives(config, bench.wishes)
    drive, limits = drive_for(config, bench.wishes, seed), config.limits
    sines = ", ".join(f"{f:.3g}" for f in drive.frequencies_hz)
    return (
        f"moves: {TUNING.exercise_s:g} s of full loops, then {drive.t_s[-1]:.3g} s of sines of "
        f"{sines} Hz together, from {drive.u.min():.4g} to {drive.u.max():.4g} V at up to "
        f"{drive.rate_max:.4g} V/s (limits: {limits.min_v:g} to {limits.max_v:g} V, "
        f"{limits.slew_v_per_s:g} V/s); then it returns to where it was"
    )


def record_drive(bench: Workbench, seed: int, stem: str) -> dict[str, Any]:
    """Play the drive of this seed and record. Raises NotNow if the drive for identification, with
    seed 0, excites too little."""
    drive = drive_for(bench.config(), bench.wishes, seed)
    found = bench.play(drive.t_s, drive.u, TUNING.exercise_s, "recording")
    path = bench.keep(found, stem)
    return judge_recording(found, path, bench.config().loop.rate_hz, identified=seed == 0)


def judge_recording(
    found: Recording, path: Path, rate_hz: float, identified: bool = True
) -> dict[str, Any]:
    """Return the step's result for a recording, written to this path. identified: a model will be
    identified from it; raises NotNow if it then excites too little."""
    covered = measure_coverage([found])
    if covered.missing and identified:
        raise NotNow(
            f"{path} does not excite enough: {'; '.join(covered.missing)}. Give a longer "
            "--duration or another --band"
        )
    due = round(float(found.t_s[-1] - found.t_s[0]) * rate_hz) + 1
    late = max(0, due - found.size)
    words = (
        f"{path.name}: {how_many(found.size, 'sample')}, {late} too late, {covered.covered:.0%} "
        "of the drive-rate plane covered"
    )
    if covered.missing_rate and identified:
        words += f"; not enough for a rate-dependent model: {'; '.join(covered.missing_rate)}"
    return {"words": words, "recording": path.name, "late": late, "covered": covered.covered}
