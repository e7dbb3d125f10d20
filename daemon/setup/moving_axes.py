"""The steps that move several axes: gentle loops of each axis in turn, recordings, comparison.

Each whole drive is checked against the axis' limits before anything moves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from dehyst.daemon.acquire.axes import PACES, plan_axes
from dehyst.daemon.api.functions import load_model
from dehyst.daemon.config import Config
from dehyst.daemon.files.axis_columns import axis_column
from dehyst.daemon.setup import comparison
from dehyst.daemon.setup.comparison import COMPENSATED, LINEAR, SinePlan
from dehyst.daemon.setup.moving import (
    FRESH,
    TUNING,
    check_drives,
    check_gauge_follows,
    drive_for,
    gentle_loops,
    judge_recording,
)
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.errors import NotNow
from dehyst.models.recording import Floats, Recording

Result = dict[str, Any]


def range_in_words(config: Config) -> str:
    """Return the voltage limits as text."""
    return f"{config.limits.min_v:g} to {config.limits.max_v:g} V"


def for_each(texts: Mapping[str, str]) -> str:
    """Return the axes' texts as one: a single "each ..." if they are all equal, otherwise one per
    axis."""
    said = set(texts.values())
    if len(said) == 1:
        return f"each {said.pop()}"
    return "; ".join(f"{axis}: {text}" for axis, text in texts.items())


# -- gentle loops ---------------------------------------------------------------------------------


def describe_gentle_axes(bench: Workbench) -> str:
    """Describe the motion of the step that exercises the axes gently."""
    now, ranges, small = [], {}, {}
    for axis, config in bench.configs().items():
        check_drives(config, bench.wishes)
        now.append(f"{axis} {bench.output_now(config)[0]:.2f} V")
        limits = config.limits
        top = limits.min_v + TUNING.gentle_shares[0] * (limits.max_v - limits.min_v)
        small[axis] = f"{limits.min_v:g} to {top:g} V"
        ranges[axis] = range_in_words(config)
    return (
        f"moves: from the present outputs ({', '.join(now)}); {TUNING.loops} slow loops of one "
        f"axis after the other, {for_each(small)}; if each gauge follows its axis, {TUNING.loops} "
        f"of all together, {for_each(ranges)}; then return"
    )


def small_loops(configs: Sequence[Config]) -> tuple[Floats, Floats, list[slice]]:
    """Return small loops of one axis after the other, with the other axes at their low ends: (N,)
    times, (N, axes) volts, and the rows in which each axis moves."""
    blocks = [gentle_loops(config, TUNING.gentle_shares[0])[1] for config in configs]
    ends = np.cumsum([block.size for block in blocks])
    rows = [slice(int(end) - b.size, int(end)) for end, b in zip(ends, blocks, strict=True)]
    volts = np.empty((int(ends[-1]), len(configs)))
    for k, config in enumerate(configs):
        volts[:, k] = config.limits.min_v
        volts[rows[k], k] = blocks[k]
    return np.arange(volts.shape[0]) / configs[0].loop.rate_hz, volts, rows


def whose_gauges(
    found: Mapping[str, Recording], windows_s: Sequence[tuple[float, float]]
) -> dict[str, str]:
    """Return for each axis the axis whose gauge reading changes most while the former moves.
    windows_s: (begin, end) of each axis' motion. Raises NotNow if no gauge follows an axis, or if
    two axes have the same gauge."""
    owners: dict[str, str] = {}
    for axis, (begin, end) in zip(found, windows_s, strict=True):
        rows = (found[axis].t_s > begin) & (found[axis].t_s < end)
        drive = found[axis].drive[rows]
        moved = {}
        for other, one in found.items():
            assert one.displacement is not None
            y = one.displacement[rows]
            good = np.isfinite(y) & np.isfinite(drive)
            enough = good.mean() >= 1.0 - TUNING.most_missing if good.size else False
            moved[other] = abs(float(np.polyfit(drive[good], y[good], 1)[0])) if enough else 0.0
        owners[axis] = max(moved, key=lambda name: moved[name])
        follows = found[owners[axis]].displacement
        assert follows is not None
        one = Recording(found[axis].t_s[rows], drive, follows[rows])
        check_follows(axis, one, float(np.ptp(drive)))
    twice = [a for a in owners if list(owners.values()).count(owners[a]) > 1]
    if twice:
        raise NotNow(
            f"the axes {', '.join(twice)} move the same gauge most: check that each axis of the "
            "stage has its own gauge and its own amplifier output"
        )
    return owners


def check_follows(axis: str, recording: Recording, span_v: float) -> float:
    """As `check_gauge_follows`, with the axis' name in the error."""
    try:
        return check_gauge_follows(recording, span_v)
    except NotNow as error:
        raise NotNow(f"axis {axis}: {error}") from None


def find_owners(bench: Workbench) -> dict[str, str]:
    """Play small loops of one axis after the other and return whose gauge is whose; see
    `whose_gauges`."""
    configs = list(bench.configs().values())
    t_s, volts, rows = small_loops(configs)
    text = f"loops of {100 * TUNING.gentle_shares[0]:g} % of the range, one axis after the other"
    found = bench.play_axes(t_s, volts, 0.0, text)
    bench.keep_axes(found, "gentle")
    end_s = t_s.size / configs[0].loop.rate_hz
    edges = [*(t_s[part.start] for part in rows), end_s]
    return whose_gauges(found, list(pairwise(edges)))


def exercise_fully(bench: Workbench) -> Result:
    """Play slow loops of all axes together through their full ranges, each at its own speed."""
    configs = bench.configs()
    blocks = []
    for pace, config in zip(paces(len(configs)), configs.values(), strict=True):
        t_s, volts = gentle_loops(config, TUNING.gentle_shares[-1])
        blocks.append(np.interp(np.arange(0.0, t_s[-1] / pace, t_s[1]) * pace, t_s, volts))
    volts_at = stack_columns(blocks)
    times = np.arange(volts_at.shape[0]) / next(iter(configs.values())).loop.rate_hz
    found = bench.play_axes(times, volts_at, 0.0, "loops of the full range, all axes")
    bench.keep_axes(found, "gentle")
    axes: Result = {}
    for axis, one in found.items():
        limits = configs[axis].limits
        gain = check_follows(axis, one, limits.max_v - limits.min_v)
        assert one.displacement is not None
        stroke = float(np.nanmax(one.displacement) - np.nanmin(one.displacement))
        axes[axis] = {
            "words": f"{stroke:.4g} {one.displacement_unit} of stroke",
            "stroke": stroke,
            "gain": gain,
        }
    return axes


def paces(count: int) -> list[float]:
    """Return each axis' relative speed; all differ, so that no two axes stay in phase."""
    return [PACES[k % len(PACES)] ** (1 + k // len(PACES)) for k in range(count)]


def stack_columns(blocks: Sequence[Floats]) -> Floats:
    """Stack columns of different lengths into (N, axes); shorter ones repeat their last value."""
    longest = max(block.size for block in blocks)
    return np.stack([np.pad(b, (0, longest - b.size), mode="edge") for b in blocks], axis=1)


# -- recordings -----------------------------------------------------------------------------------


def drives_for(bench: Workbench, seed: int) -> tuple[Floats, Floats]:
    """Return (N,) times and (N, axes) volts of a recording's drive; with a seed above 0, each axis
    has its own sines."""
    drives = []
    for k, config in enumerate(bench.configs().values()):
        drives.append(drive_for(config, bench.wishes, seed + k * (seed > 0)))
    longest = max(drives, key=lambda drive: drive.t_s.size)
    return longest.t_s, stack_columns([drive.u for drive in drives])


def describe_record(bench: Workbench) -> str:
    """Describe the motion of `record_axes_in_turn`."""
    for config in bench.configs().values():
        check_drives(config, bench.wishes)
    t_s, volts = drives_for(bench, 0)
    gains = np.array([config.actuator.gain for config in bench.configs().values()])
    whole_s = plan_axes(list(bench.configs().values()), t_s, volts / gains)[0][-1]
    return (
        f"moves: {TUNING.exercise_s:g} s of full loops, then one axis after the other for "
        f"{t_s[-1]:.3g} s, then all together, {whole_s:.0f} s in all; {_within(bench, volts)}"
    )


def describe_fresh(bench: Workbench) -> str:
    """Describe the motion of `record_fresh`."""
    t_s, volts = drives_for(bench, FRESH)
    return (
        f"moves: {TUNING.exercise_s:g} s of full loops, then {t_s[-1]:.3g} s of all axes together, "
        f"each with sines of its own; {_within(bench, volts)}"
    )


def _within(bench: Workbench, volts: Floats) -> str:
    texts = {}
    for k, (axis, config) in enumerate(bench.configs().items()):
        fastest = float(np.abs(np.diff(volts[:, k])).max()) * config.loop.rate_hz
        texts[axis] = (
            f"from {volts[:, k].min():.4g} to {volts[:, k].max():.4g} V at up to {fastest:.3g} V/s "
            f"(limits: {range_in_words(config)}, {config.limits.slew_v_per_s:g} V/s)"
        )
    return f"{for_each(texts)}; then they return"


def record_axes_in_turn(bench: Workbench) -> Result:
    """Record one axis after the other, then all together. Raises NotNow if the drive excites too
    little."""
    t_s, volts = drives_for(bench, 0)
    configs = list(bench.configs().values())
    gains = np.array([config.actuator.gain for config in configs])
    in_turn = plan_axes(configs, t_s, volts / gains)
    found = bench.play_axes(*in_turn, TUNING.exercise_s, "recording")
    return _judged(bench, found, "recording")


def record_fresh(bench: Workbench) -> Result:
    """Record all axes together, each with a drive that was not used to identify its model."""
    t_s, volts = drives_for(bench, FRESH)
    found = bench.play_axes(t_s, volts, TUNING.exercise_s, "recording")
    return _judged(bench, found, "fresh", identified=False)


def _judged(
    bench: Workbench, found: Mapping[str, Recording], stem: str, identified: bool = True
) -> Result:
    files, axes = bench.keep_axes(found, stem), {}
    for axis, config in bench.configs().items():
        rate_hz = config.loop.rate_hz
        axes[axis] = judge_recording(found[axis], files[axis], rate_hz, identified)
    return axes


# -- the comparison -------------------------------------------------------------------------------


def plan_sines(bench: Workbench) -> dict[str, SinePlan]:
    """Plan a sine for each axis, all moving together, each at its own speed. The inverse knows the
    other axes' targets and, if a model needs them, their drives."""
    configs, plans = bench.configs(), {}
    models = {axis: load_model(bench.model_path_of(axis)) for axis in configs}
    for pace, (axis, config) in zip(paces(len(configs)), configs.items(), strict=True):
        one = bench.recording("record", axis)
        plans[axis] = comparison.plan_linear(config, models[axis], one, bench.wishes.band_hz, pace)
    longest = max(plans.values(), key=lambda plan: plan.t_s.size).t_s
    plans = {axis: _stretched(plan, longest) for axis, plan in plans.items()}
    out = {}
    for axis, plan in plans.items():
        others = {}
        for name, other in plans.items():
            if name != axis:
                drive = other.volts[LINEAR] / configs[name].actuator.gain
                others[axis_column(name, other.unit)] = other.target
                others[axis_column(name, models[name].drive_unit, drive=True)] = drive
        out[axis] = comparison.with_inverse(plan, configs[axis], models[axis], others)
    return out


def _stretched(plan: SinePlan, t_s: Floats) -> SinePlan:
    more = t_s.size - plan.t_s.size
    return replace(
        plan,
        t_s=t_s,
        target=np.pad(plan.target, (0, more), mode="edge"),
        volts={name: np.pad(v, (0, more), mode="edge") for name, v in plan.volts.items()},
    )


def describe_sines(bench: Workbench) -> str:
    """Describe the motion of `track_sines`."""
    texts = []
    for axis, plan in plan_sines(bench).items():
        low = min(float(v.min()) for v in plan.volts.values())
        high = max(float(v.max()) for v in plan.volts.values())
        texts.append(
            f"{axis} {plan.stroke:.4g} {plan.unit} peak to peak at {plan.f_hz:.3g} Hz, {low:.4g} "
            f"to {high:.4g} V"
        )
    return (
        f"moves: a sine of each axis, all together: {'; '.join(texts)}; with linear gains and "
        "with the models' inverses (repeated if this machine was too busy); then they return"
    )


def track_sines(bench: Workbench) -> Result:
    """Play the sines with linear gains and with the inverses, measure the errors, and draw a
    picture for each axis."""
    plans, configs = plan_sines(bench), bench.configs()
    first = next(iter(plans.values()))
    played: dict[str, dict[str, tuple[Recording, float]]] = {axis: {} for axis in plans}
    for name in (LINEAR, COMPENSATED):
        volts = np.stack([plan.volts[name] for plan in plans.values()], axis=1)
        runs: list[dict[str, Recording]] = []

        def once(name: str = name, volts: Floats = volts, runs: Any = runs) -> Recording:
            runs.append(bench.play_axes(first.t_s, volts, TUNING.exercise_s, name))
            bench.keep_axes(runs[-1], comparison.stem_of(name))
            return next(iter(runs[-1].values()))

        best, late = comparison.play_in_time(once, first.t_s.size - 1)
        for found in runs:
            if next(iter(found.values())) is best:
                for axis, one in found.items():
                    played[axis][name] = (one, late)
    axes = {}
    for axis, plan in plans.items():
        picture = bench.in_folder(comparison.PICTURE, axis)
        axes[axis] = comparison.summarise_comparison(
            plan, played[axis], configs[axis].loop.rate_hz, picture
        )
    return axes
