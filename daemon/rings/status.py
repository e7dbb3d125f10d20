"""The loop's status, one row per field: the only place that lists them.

The STATUS record in the ring, the status message on the bus (dehyst.daemon.bus.messages.Status) and
its JSON are made from the rows of LoopStatus. To add a field, add a row here at the end and fill it
where it is measured: in dehyst.daemon.loop.status, or in dehyst.daemon.loop.axes.core where it does
not change with every sample.

The gateway fills rows without a column. Displacements are in the model's unit and count
from the set-point origin; voltages are the actuator's; times `_ns` are the controller's
CLOCK_MONOTONIC unless said otherwise.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from dehyst.daemon.rings.records import MissCause, Mode, State, name_of
from dehyst.models.learning.freeze_reason import FreezeReason

Id = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Name = Annotated[str, Meta(max_length=64)]
Unit = Annotated[str, Meta(max_length=16)]
Version = Annotated[int, Meta(ge=1, le=2**31)]

View = Callable[[Any], str]
"""Returns the text of one cell of the live view from the whole status."""


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """Microseconds over the last window."""

    p50: float
    p99: float
    p999: float
    max: float


@dataclass(frozen=True)
class StatusField:
    """A row's part of the record. dtype, size: of the record's field (size 0: one number); read:
    converts it to the message's value; view: text in the live view, None: not shown."""

    dtype: str
    read: Callable[[Any], Any]
    size: int = 0
    view: View | None = None


def _name(kind: type[IntEnum]) -> Callable[[Any], str]:
    return lambda value: name_of(kind, int(value))


def _timing(values: Any) -> Timing:
    p50, p99, p999, most = (float(v) for v in values)
    return Timing(p50=p50, p99=p99, p999=p999, max=most)


def _causes(counts: Any) -> dict[str, int]:
    return {name_of(MissCause, i): int(n) for i, n in enumerate(counts) if int(n) > 0}


def _finite(value: Any) -> float:
    number = float(value)
    return number if math.isfinite(number) else 0.0


def _text(value: Any) -> str:
    return bytes(value).decode("utf-8", "replace")


def _why(value: Any) -> str:
    return "" if int(value) == 0 else name_of(FreezeReason, int(value))


def _device(name: str) -> View:
    def words(s: Any) -> str:
        ok, errors = getattr(s, f"{name}_ok"), getattr(s, f"{name}_errors")
        return f"{name} {'ok' if ok else 'FAILED'}, {errors} errors"

    return words


def _p99(name: str, field: str) -> View:
    return lambda s: f"{name} p99 {getattr(s, field).p99:.0f} us"


def counts(by_name: dict[str, int]) -> str:
    """Return counters as text."""
    return ", ".join(f"{name} {n}" for name, n in by_name.items()) or "none"


USUAL_SHIFT = 0.1
"""Share of the reach. After an exercise, a stage rarely differs from its own model by more; it does
differ by more from another stage's model. Before an exercise, its unknown history alone may cause
twice as much."""
OTHER_STAGE = (
    "the model may be another stage's: check model.file, sensor.scale and actuator.gain, and "
    "compare a recording with it by `dehyst validate`"
)


FROZEN = {
    "no_reading": "no valid reading",
    "stuck": "the gauge is stuck",
    "jumped": "the reading has jumped; waiting until it is back, or for dehyst zero",
    "settling": "the reading has jumped and is plausible again; waiting until it is settled",
    "beyond": "gauge and model differ implausibly; waiting until they agree, or for dehyst zero",
    "distrusted": "the mismatch watch does not trust it",
}


def positioning(s: "LoopStatus") -> str:
    """Return as text: open loop, trimmed or learned, and the present gauge minus model."""
    unit, frozen = s.unit, s.trim_frozen
    by = "learned" if s.learned else ""
    if s.trimmed and frozen in FROZEN:
        by = f"{by or 'open loop'} (trim frozen at {s.trim:+.3g} {unit}: {FROZEN[frozen]})"
    elif s.trimmed:
        trimmed = f"trimmed by {s.trim:+.3g} {unit}"
        by = f"{by} and {trimmed}" if by else trimmed
    by = by or "open loop"
    if not math.isfinite(s.differs):
        return f"{by}; the gauge gives no reading"
    return f"{by}; the gauge is {s.differs:+.3g} {unit} from the model"


def is_starting(s: "LoopStatus") -> bool:
    """Return whether the loop has not reached its first sample: it compiles kernels or opens
    devices. While it compiles, its process sends nothing."""
    return s.period_ns <= 0 or (s.state == "start" and (s.core_alive or not s.samples))


def rate(s: "LoopStatus") -> str:
    """Return the sampling rate as text."""
    return f"{1e9 / s.period_ns:g} Hz" if s.period_ns > 0 else "rate not known yet"


def place(measured: float, target: float, volts: float, unit: str) -> str:
    """Return the position of the stage as text."""
    words = [f"measured {measured:.4f} {unit}" if math.isfinite(measured) else "no valid reading"]
    words += [f"target {target:.4f} {unit}" if math.isfinite(target) else "no target"]
    if math.isfinite(measured) and math.isfinite(target):
        words.append(f"error {measured - target:+.4f} {unit}")
    return ", ".join([*words, f"output {volts:.3f} V"])


class LoopStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The rows."""

    version: Version = 1
    name: Name
    software: Name
    core_alive: bool
    """False: the loop's process has ended or is suspended, or has sent nothing for 2.5 s; the rest
    is its last report."""
    run: Id
    """Number of the loop's run; another one: it was restarted and counts from 0 again."""
    unit: Annotated[Unit, StatusField("S16", _text)]
    """Of displacements: that of the model which this run uses."""
    drive_unit: Annotated[Unit, StatusField("S16", _text)]
    time_ns: Annotated[int, StatusField("<i8", int)]
    wall_ns: Annotated[int, StatusField("<i8", int)]
    """Wall clock at time_ns."""
    state: Annotated[Name, StatusField("u1", _name(State))]
    policy: Annotated[Name, StatusField("u1", lambda fifo: "fifo" if fifo else "other")]
    """Scheduling policy obtained."""
    priority: Annotated[int, StatusField("u1", int, view=lambda s: f"{s.policy} {s.priority}")]
    mode: Annotated[Name, StatusField("u1", _name(Mode))]
    """Mode of the inverse."""
    samples: Annotated[
        int, StatusField("<i8", int, view=lambda s: f"samples {s.samples}, missed {s.missed}")
    ]
    missed: Annotated[int, StatusField("<i8", int)]
    """Deadlines missed: sample started a period or more late, or skipped."""
    missed_by: Annotated[
        dict[str, int],
        StatusField("<i8", _causes, len(MissCause), lambda s: f"by cause: {counts(s.missed_by)}"),
    ]
    wake_us: Annotated[
        Timing,
        StatusField(
            "<f4",
            _timing,
            4,
            lambda s: (
                f"wake-up p50 {s.wake_us.p50:.0f} us, p99 {s.wake_us.p99:.0f}, "
                f"max {s.wake_us.max:.0f}"
            ),
        ),
    ]
    """Lateness of the wake-up over the last window."""
    exec_us: Annotated[Timing, StatusField("<f4", _timing, 4, _p99("step", "exec_us"))]
    """Wake-up to end of write."""
    io_us: Annotated[Timing, StatusField("<f4", _timing, 4, _p99("I/O", "io_us"))]
    """Time spent in driver calls."""
    actuator_ok: Annotated[bool, StatusField("u1", bool, view=_device("actuator"))]
    sensor_ok: Annotated[bool, StatusField("u1", bool, view=_device("sensor"))]
    actuator_errors: Annotated[int, StatusField("<i8", int)]
    sensor_errors: Annotated[int, StatusField("<i8", int)]
    volts: Annotated[float, StatusField("<f8", float)]
    queue_s: Annotated[float, StatusField("<f8", _finite)]
    """Trajectory time that is still queued."""
    trajectory: Annotated[Id, StatusField("<u8", lambda number: int(number) & (2**63 - 1))]
    """The trajectory being played or played last; 0: none."""
    trajectory_done: Annotated[bool, StatusField("u1", bool)]
    origin: Annotated[float, StatusField("<f8", float)]
    """Model displacement at set-point 0."""
    reach_min: Annotated[float, StatusField("<f8", float)]
    """Reachable set-points."""
    reach_max: Annotated[
        float,
        StatusField(
            "<f8", float, view=lambda s: f"reach {s.reach_min:.4g} to {s.reach_max:.4g} {s.unit}"
        ),
    ]
    latency_s: Annotated[float, StatusField("<f8", _finite)]
    """Latency of the inverse (preview window)."""
    period_ns: Annotated[int, StatusField("<i8", int, view=lambda s: rate(s))]
    pid: Annotated[int, StatusField("<i8", int)]
    trimmed: Annotated[bool, StatusField("u1", bool)]
    """The slow trim is configured."""
    trim: Annotated[float, StatusField("<f8", float)]
    """Correction that the trim adds to the target."""
    trim_frozen: Annotated[Name, StatusField("u1", _why)]
    """Why the trim is frozen, in one word (off, not_running, no_reading, stuck, jumped, beyond,
    distrusted or settling); "" if it is not."""
    stays: Annotated[bool, StatusField("u1", bool)] = False
    """The set-point or hold lasts until another command, with its client gone."""
    learned: Annotated[bool, StatusField("u1", bool)]
    """What is played has corrections that were learned from earlier passes."""
    differs: Annotated[float, StatusField("<f8", float, view=lambda s: positioning(s))]
    """The gauge's reading minus the model's prediction of it; NaN: no reading."""
    gauge_zero: Annotated[float, StatusField("<f8", float)]
    """Added to every reading, see `dehyst zero`."""
    trajectory_start_ns: Annotated[int, StatusField("<i8", int)]
    """Time 0 of the trajectory that is being played; 0: none."""


def _columns() -> dict[str, StatusField]:
    hints = get_type_hints(LoopStatus, include_extras=True)
    found = {}
    for name, hint in hints.items():
        for extra in getattr(hint, "__metadata__", ()):
            if isinstance(extra, StatusField):
                found[name] = extra
    return found


COLUMNS = _columns()
STATUS = np.dtype(
    [(n, c.dtype, (c.size,)) if c.size else (n, c.dtype) for n, c in COLUMNS.items()]
    + [("model", "S16")]
)
"""`model` is for the gateway only: digest of the model that the loop runs, see `model_file`."""


def message_values(record: Any) -> dict[str, Any]:
    """Return the message's values by field name, from one STATUS record."""
    return {name: column.read(record[name]) for name, column in COLUMNS.items()}


def cells(status: LoopStatus) -> list[str]:
    """Return the texts that the live view shows of a status, one per cell."""
    return [c.view(status) for c in COLUMNS.values() if c.view is not None]
