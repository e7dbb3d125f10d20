"""Functions of `import dehyst`.

A recording is a `Recording`, a path, columns by name, or the arrays t_s, drive, displacement.
Columns by name are a dict {"t_s": ..., "u_v": ..., "y_um": ...} or a pandas.DataFrame. A model is a
`Model`, a path, a shipped name, or a result that holds one.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from dehyst.daemon.api.inputs import take_model, take_recordings, take_trajectory
from dehyst.daemon.api.prediction import misfit, predict
from dehyst.daemon.api.results import Diagnosed, Drive, Identified, Simulated, Validated
from dehyst.daemon.api.trajectories import channels_along, spaced_evenly, target_in_unit
from dehyst.daemon.called import python_function
from dehyst.daemon.files.axis_columns import unit_factor
from dehyst.daemon.files.foreign.reading import ReadOptions, parse_columns
from dehyst.daemon.files.recordings import read_recording
from dehyst.models import diagnosis
from dehyst.models import identify as identification
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.errors import BadInput
from dehyst.models.identify.validation import validate as run_validation
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed, invert_trajectory
from dehyst.models.model import Model
from dehyst.models.recording import AXIS_CHANNEL, Recording

UNITS = ("v", "um")
# no slew limit [V/s]; the daemon's default preview; a longer one was not given in s
FREE_SLEW, WINDOW_S, LONGEST_PREVIEW_S = 1e12, 0.1, 60.0
THREADS = 2  # candidates tried at once in a diagnosis: each needs a design of all samples
Say = Callable[[str], None]


def _keep_quiet(text: str, share: float = 0.0) -> None:
    """Discard progress reports."""


@python_function
def load_recording(
    path: str | Path,
    *,
    columns: Mapping[str, str | int] | str | None = None,
    rate_hz: float | None = None,
    time_unit: str = "",
    drive_unit: str = "",
    unit: str = "",
) -> Recording:
    """Read one recording from a file of any supported kind. For a file of another program, the
    result's `read` says how the file was interpreted.

    columns: which column is which, by heading or number (from 0): {"t": 0, "u": "Voltage", "y": 2};
    rate_hz: rows per second, for a file without times; time_unit: s, ms or us; drive_unit, unit:
    units of drive and displacement, for columns whose headings give none. Raises BadRecording with
    a one-line message, and BadInput on an invalid option.
    """
    named = parse_columns(columns) if isinstance(columns, str) else dict(columns or {})
    if rate_hz is not None and not rate_hz > 0.0:
        raise BadInput(f"--rate {rate_hz:g}: give the rows per second, above 0")
    reading = ReadOptions(named, rate_hz or 0.0, time_unit, drive_unit, unit)
    return read_recording(path, min_rows=1, reading=reading)


@python_function
def load_model(path: str | Path) -> Model:
    """Read a model from a TOML file, or return a shipped one ("paper-eq12"). Raises BadModel with a
    one-line message."""
    return take_model(path)


@python_function
def identify(
    *data: Any,
    rate: bool | None = None,
    order: int | None = None,
    saturation: int | None = None,
    bias: bool | None = None,
    units: tuple[str, str] = UNITS,
    progress: Say = _keep_quiet,
) -> Identified:
    """Identify one model from one or more recordings of a stage.

    data: recordings, as described above. rate, order, saturation, bias: as in
    dehyst.models.identify.Options; None: 45 operators, the others chosen by held-out error. units:
    units of drive and displacement, for arrays. progress: called with a short text at each step.
    Raises BadRecording if no model can be identified from the recordings, BadInput if the
    recordings do not belong together.

    >>> found = dehyst.identify("run.csv", progress=print)      # doctest: +SKIP
    >>> found.save("stage.toml")                                # doctest: +SKIP
    """
    recordings = take_recordings(data, units, need_displacement=True)
    options = identification.Options(order, rate, saturation, bias)
    return Identified(identification.identify(recordings, options, progress), tuple(recordings))


@python_function
def simulate(model: Any, *data: Any, units: tuple[str, str] | None = None) -> Simulated:
    """Run a model on a recording's drive. t_s and drive are enough, plus any channels that the
    model reads. Without a displacement the stage starts de-energised; with one, it starts with the
    history that fits best: de-energised, approached from above, or approached from below. units:
    units of arrays; default: the model's.

    Raises BadInput on other units or missing channels.
    """
    model = take_model(model)
    units = units or (model.drive_unit, model.displacement_unit)
    recordings = take_recordings(data, units, need_displacement=False)
    if len(recordings) > 1:
        raise BadInput(f"one recording is simulated at a time, not {len(recordings)}")
    (recording,) = recordings
    recording = _in_unit_of(model, recording)
    y, start = predict(model, recording)
    return Simulated(y, start, model, recording, misfit(model, recording, y))


@python_function
def invert(
    model: Any,
    *data: Any,
    preview: float | None = None,
    mode: str = "auto",
    low: float | None = None,
    high: float | None = None,
    slew: float | None = None,
    start: float | None = None,
    period: float | None = None,
    unit: str | None = None,
) -> Drive:
    """Compute the drive that follows a trajectory: a path, columns (`t_s`, `target_um`), or arrays
    t_s, target.

    preview: invert exactly as the daemon does with this look-ahead [s], in `mode` ("auto",
    "static", "causal" or "preview"); None: solve the whole trajectory at once. low, high: drive
    limits [drive unit] (default: the model's validity); slew: slew-rate limit [drive unit/s]
    (default: none); start: drive before the first sample (default: 0); period: resample to this
    period [s]; unit: unit of an array of targets. Raises BadInput or BadRecording if the trajectory
    cannot be used.
    """
    if mode != "auto" and preview is None:
        raise BadInput(f"mode {mode!r} is one of the daemon's: give the look-ahead too (preview)")
    if start is not None and not math.isfinite(start):
        raise BadInput(f"--start {start:g}: not a finite drive")
    if slew is not None and not slew > 0:
        raise BadInput(f"--slew {slew:g}: must be greater than 0")
    if preview is not None and not 0 <= preview < LONGEST_PREVIEW_S:
        raise BadInput(f"--preview {preview:g}: must be from 0 to {LONGEST_PREVIEW_S:g} s")
    model = take_model(model)
    trajectory = take_trajectory(data, unit or model.displacement_unit)
    t_s, target, step = spaced_evenly(trajectory, target_in_unit(trajectory, model), period)
    v = model.validity
    lowest = v.drive_min if low is None else low
    highest = v.drive_max if high is None else high
    for option, limit in (("--min", lowest), ("--max", highest)):
        if not math.isfinite(limit):
            raise BadInput(f"{option} {limit:g}: not a finite drive")
    if not lowest < highest:
        raise BadInput(f"--min {lowest:g}: must be below --max, {highest:g}")
    compensator = Compensator(
        model,
        step,
        lowest,
        highest,
        FREE_SLEW if slew is None else slew,
        mode if preview is not None else "auto",
        WINDOW_S if preview is None else preview,
    )
    channels = channels_along(trajectory, compensator, t_s)
    solve = invert_trajectory if preview is None else invert_streamed
    return Drive(
        t_s,
        target,
        solve(compensator, target, channels, start),
        model,
        compensator.reason,
        compensator.latency_s if preview is not None else None,
        compensator.price,
        displacement_range(model, compensator.low, compensator.high),
    )


@python_function
def diagnose(
    *data: Any,
    model: Any = None,
    units: tuple[str, str] = UNITS,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosed:
    """Find the physics that the model in use lacks, from recordings of one stage, and add it to the
    model.

    model: the model in use; None: identified from these recordings. units: units of drive and
    displacement, for arrays. progress: called with a short text and the fraction done. Raises
    BadRecording if the recordings cannot be diagnosed.
    """
    recordings = _with_distinct_names(take_recordings(data, units, need_displacement=True))
    in_use = None if model is None else take_model(model)
    if in_use is not None:
        recordings = [_in_unit_of(in_use, one) for one in recordings]
    with ThreadPoolExecutor(THREADS) as threads:
        found = diagnosis.diagnose(recordings, in_use, progress, threads.map)
    return Diagnosed(found, tuple(recordings))


@python_function
def validate(models: Any, *data: Any, units: tuple[str, str] = UNITS) -> Validated:
    """Test how well models predict recordings that were not used to fit them.

    models: one model or a sequence of models. Raises BadInput on other units and on recordings that
    lack a channel the model reads.
    """
    many = [models] if not _is_many(models) else list(models)
    if not many:
        raise BadInput("no model was given; give models, or their paths")
    recordings = take_recordings(data, units, need_displacement=True)
    taken = [(_name(m), take_model(m)) for m in many]
    pairs = [(name, m, _named_in_unit_of(m, one)) for name, m in taken for one in recordings]
    return Validated(
        tuple(name for name, _, _ in pairs),
        tuple(one for _, _, one in pairs),
        tuple(run_validation(m, one) for _, m, one in pairs),
    )


def _in_unit_of(model: Model, one: Recording) -> Recording:
    """Return a recording with its lengths in the model's unit; unchanged if that is not a
    length."""
    wanted = model.displacement_unit
    factor = unit_factor(one.displacement_unit, wanted)
    if factor in (None, 1.0):
        return one
    axes = {key: AXIS_CHANNEL.fullmatch(key) for key in one.channels}
    others = {k: one.channels[k] * factor for k, axis in axes.items() if axis and not axis[2]}
    y = one.displacement
    return replace(
        one,
        displacement=None if y is None else y * factor,
        displacement_unit=wanted,
        channels={**one.channels, **others},
    )


def _named_in_unit_of(model: Model, one: Recording) -> Recording:
    """Do the same, and state it in the name: models may be in different units."""
    out = _in_unit_of(model, one)
    if out is one:
        return one
    units = f"{one.displacement_unit}, as {out.displacement_unit}"
    return replace(out, name=f"{one.name} ({units})")


def _is_many(models: Any) -> bool:
    return isinstance(models, Iterable) and not isinstance(models, str)


def _name(model: Any) -> str:
    return str(model) if isinstance(model, str | Path) else "the model"


def _with_distinct_names(recordings: list[Recording]) -> list[Recording]:
    """Make recording names unique, also when two folders hold files of the same name."""
    seen: dict[str, int] = {}
    out = []
    for one in recordings:
        seen[one.name] = seen.get(one.name, 0) + 1
        count = seen[one.name]
        out.append(one if count == 1 else replace(one, name=f"{one.name} ({count})"))
    return out
