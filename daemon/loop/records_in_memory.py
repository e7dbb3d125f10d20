"""Data of the loop's kernels: numbers as records, arrays by their place in a table.

One table of addresses (dehyst.models.addresses) represents a controller, another one the inverse
that it uses (dehyst.models.inverse.state). The Python loop, the compiled loop and the tests pass
these tables to the same kernels: dehyst.daemon.loop.step_kernel and dehyst.daemon.loop.sample.

Kernels name the records `c` (CONTROL_T), `p` (SETTINGS_T), `q` (QUEUE_T) and `m` (METER_T).
"""

import math
from enum import IntEnum
from typing import Any, cast

import numpy as np
from numba import carray, njit, types
from numpy.typing import NDArray

from dehyst.daemon.loop import targets
from dehyst.daemon.loop.settings import SETTINGS_T
from dehyst.daemon.loop.states import NEXT, NOTHING
from dehyst.daemon.loop.targets import QUEUE_T
from dehyst.daemon.rings.records import COMMAND, LARGEST_TARGET, TELEMETRY, MissCause
from dehyst.models.addresses import floats_at, pointer, record, whole_at
from dehyst.models.learning import trim

Table = NDArray[np.int64]
NAN = math.nan

CONTROL_T = np.dtype(
    [
        ("volts", "<f8"),  # the output as last written
        ("found", "<i8"),  # 1: volts is the device's report, which may be off; no move since
        ("wrote_ns", "<i8"),  # time from which the next move's slew budget counts; 0: not written
        ("least_ns", "<i8"),  # shortest duration of a write
        ("writes", "<i8"),  # number of writes
        ("move_ns", "<i8"),  # time for the next move under the slew limit, at most a period
        ("glide", "<f8"),  # remaining part of a glide to the target: 1 to 0; NaN: begin one
        ("glide_from", "<f8"),  # model displacement where it began
        ("glide_share", "<f8"),  # decrease of `glide` per sample
        ("predicted", "<f8"),  # predicted next reading, from the origin
        ("target", "<f8"),  # newest target, from the origin; NaN: none
        ("learned", "<f8"),  # learned correction of the present target
        ("corrected", "<i8"),  # 1: the trajectory has learned corrections
        ("held", "<i8"),  # 1: this sample repeats the previous reading
        ("target_ns", "<i8"),  # when a client last confirmed the target
        ("since_ns", "<i8"),  # when the present state began
        ("hold_ns", "<i8"),
        ("approach_until_ns", "<i8"),
        ("stop_left_ns", "<i8"),  # time left to STOPPING; a pause of the loop counts little
        ("stop_seen_ns", "<i8"),  # when that time was counted last
        ("stop_kept", "<i8"),  # 1: a client stopped the stage in FAULT; done after it
        ("step_ns", "<i8"),  # grid point of the newest sample; 0: none yet
        ("state", "<i8"),
        ("stays", "<i8"),  # 1: set-point or hold lasts until another command
        ("starved", "<i8"),
        ("pending", "<i8"),  # the inverse has proposed a drive that is not applied yet
        ("trajectory", "<u8"),
        ("trajectory_done", "<i8"),
        ("inverse", "<i8"),  # address of the inverse's table
        ("group", "<i8"),  # of the trajectory being played or played last; 0: none
        ("left", "<i8"),  # the group that this axis left before its end
        ("cut", "<u8"),  # the trajectory whose corrections were limited last
        ("made", "<i8"),  # 1: this sample's voltage has been made
        ("notes", "<i8"),  # number of notes made
    ]
)

METER_T = np.dtype(
    [
        ("scheduled_ns", "<i8"),  # the next or present deadline
        ("samples", "<i8"),
        ("missed", "<i8"),
        ("tail", "<i8"),  # of the command ring: records taken
        ("measured", "<f8"),  # last reading as model displacement
        ("held", "<i8"),  # 1: no new reading was due
        ("scale", "<f8"),
        ("zero", "<f8"),
        ("sensor_every", "<i8"),
        ("spin_ns", "<i8"),
        # the thread's counters after the previous sample
        ("major_faults", "<i8"),
        ("minor_faults", "<i8"),
        ("switches", "<i8"),
        ("waited_ns", "<i8"),  # time that the thread was ready and had no CPU
        ("cpu", "<i8"),  # CPU on which it ran
        ("schedstat", "<i8"),  # open file of the thread's /proc schedstat; -1: none
        # requests to the loop, taken at its next sample
        ("stop", "<i8"),
        ("swap", "<i8"),  # address of another inverse's table
        ("swap_origin", "<f8"),
        ("swap_rows", "<i8"),  # address of its FOLLOW_T rows
        ("swap_n_rows", "<i8"),
        ("actuator_back", "<i8"),
        ("back_v", "<f8"),
        # devices: 1 usable, 0 down; the code that brought it down
        ("actuator_ok", "<i8"),
        ("sensor_ok", "<i8"),
        # not 0: write nothing. 1: the amplifier's report contradicts the output; 2: it is queried
        ("doubtful", "<i8"),
        ("actuator_code", "<i8"),
        ("sensor_code", "<i8"),
        # C functions of the devices, for the compiled loop
        ("write", "<i8"),
        ("write_context", "<i8"),
        ("read", "<i8"),
        ("read_context", "<i8"),
    ]
)

FOLLOW_T = np.dtype(
    [
        ("channel", "<i8"),  # place in the inverse's channels
        ("axis", "<i8"),  # address of the followed axis' table
        ("drive", "<i8"),  # 1: its drive; 0: its displacement
        ("scale", "<f8"),
        ("zero", "<f8"),
    ]
)
"""One channel of the model that follows another axis of the controller."""

NOTE_T = np.dtype([("code", "<i8"), ("value", "<f8")])
NOTES = 64
COMMANDS_PER_SAMPLE = 512
CAUSES = len(MissCause)

# Places in the controller's table.
(
    SETTINGS,
    CONTROL,
    QUEUE,
    TIMES,
    VALUES,
    CORRECTIONS,
    TRIM_SETTING,
    TRIM,
    NOTE_RING,
    COMMANDS,
    RECORD,
    METER,
    MISSED_BY,
    WAKE,
    WAKE_MOST,
    EXEC,
    EXEC_MOST,
    IO,
    IO_MOST,
    COMMAND_WORDS,
    COMMAND_RING,
    COMMAND_DATA,
    COMMAND_CHECKS,
    TELEMETRY_WORDS,
    TELEMETRY_RING,
    TELEMETRY_DATA,
    TELEMETRY_CHECKS,
    WITNESS,
    CLOCK,
    BUFFER,
    FOLLOWS,
    N_TABLE,
) = range(32)


class Note(IntEnum):
    """Events of a sample, as a code with one number; Python turns them into messages."""

    BAD_VALUE = 1
    WITHDRAWN = 2
    STOPPED = 3
    RELEASED = 4
    POINT_FULL = 5
    POINT_LATE = 6
    RUN_DRY = 7
    NO_SETPOINT = 8
    COMMANDS_LOST = 9
    STOP_FAILED = 10
    RELOADED = 11
    STOOD_STILL = 12
    COMMANDS_DAMAGED = 13
    TRIM_GOES_ON = 14
    TRIM_NO_READING = 15
    TRIM_STUCK = 16
    TRIM_JUMPED = 17
    TRIM_BEYOND = 18
    TRIM_DISTRUSTED = 19
    ZEROED = 20
    BAD_CORRECTION = 21
    GROUP_WAITS = 22
    GROUP_BROKEN = 23
    HELD = 24
    TRIM_SETTLING = 25
    STOP_KEPT = 26
    ENDED = 27


TEXTS = {
    Note.BAD_VALUE: f"target {{:g}} dropped: it is not within {LARGEST_TARGET:g} of 0, or its time "
    "is invalid",
    Note.WITHDRAWN: "trajectory withdrawn by its client",
    Note.STOPPED: "stopped by a client",
    Note.STOP_KEPT: "stopped by a client while a device has failed: once it is back, the output "
    "ramps to the safe voltage",
    Note.HELD: "a client holds the present output",
    Note.RELEASED: "released by a client: ramping to the safe voltage",
    Note.POINT_FULL: "trajectory point at {:.3f} s dropped: the queue is full",
    Note.POINT_LATE: "trajectory point at {:.3f} s dropped: it is not later than the last point",
    Note.RUN_DRY: "the trajectory has run dry: holding its last target",
    Note.NO_SETPOINT: "no further command for {:g} s: holding, then ramping to the safe voltage",
    Note.COMMANDS_LOST: "{:.0f} commands overwritten before the loop read them",
    Note.STOP_FAILED: "ending although the output is at {:.4g} V: it does not reach its safe "
    "voltage",
    Note.ENDED: "the loop ends with the output at {:.4g} V",
    Note.STOOD_STILL: "the loop paused for {:.2f} s; a motion continues smoothly",
    Note.COMMANDS_DAMAGED: "{:.0f} damaged commands dropped",
    Note.TRIM_GOES_ON: "the trim resumes, gauge and model differ by {:.4g} {unit}",
    Note.TRIM_NO_READING: "trim frozen: no valid reading",
    Note.TRIM_STUCK: "trim frozen: the reading has not changed while the stage was moved",
    Note.TRIM_JUMPED: "trim frozen: the reading has jumped, gauge and model differ by {:.4g} "
    "{unit}; it resumes when the reading is back and settled, or after `dehyst zero`",
    Note.TRIM_SETTLING: "trim frozen: the reading has jumped, but is plausible, {:.4g} {unit} from "
    "the model; it resumes once the reading is settled",
    Note.TRIM_BEYOND: "trim frozen: gauge and model differ by {:.4g} {unit}, which is "
    "implausible; `dehyst zero` sets the gauge's zero, unless the model is another stage's",
    Note.TRIM_DISTRUSTED: "trim frozen: the mismatch watch does not trust the stage or its gauge",
    Note.ZEROED: "the gauge's zero was moved by {:.6g} {unit}",
    Note.BAD_CORRECTION: "learned correction {:g} {unit} limited to the largest allowed",
    Note.GROUP_WAITS: "holding its target until the other axes of the trajectory can continue",
    Note.GROUP_BROKEN: "holding: another axis of the trajectory has left it",
    Note.RELOADED: "the new model is in use, set-point 0 is its {:.6g} {unit}",
}


def as_int64(member: int) -> int:
    """Convert a member of an enumeration for kernels: numba compiles a function again for every
    plain integer constant passed to it, but only once for these."""
    return cast(int, np.int64(member))


def describe_note(code: int, value: float, unit: str) -> str:
    """Return a note as a message. unit: of displacements."""
    return TEXTS[Note(code)].format(value, unit=unit)


@njit(cache=True, nogil=True)
def control_of(table: Table) -> Any:
    """Return the CONTROL_T record."""
    return record(table[3 * CONTROL], CONTROL_T)


@njit(cache=True, nogil=True)
def settings_record_of(table: Table) -> Any:
    """Return the SETTINGS_T record."""
    return record(table[3 * SETTINGS], SETTINGS_T)


@njit(cache=True, nogil=True)
def queue_of(table: Table) -> Any:
    """Return the QUEUE_T record."""
    return record(table[3 * QUEUE], QUEUE_T)


@njit(cache=True, nogil=True)
def points_of(table: Table) -> Any:
    """Return the arrays of the queue."""
    return targets.Points(
        whole_at(table, TIMES), floats_at(table, VALUES), floats_at(table, CORRECTIONS)
    )


@njit(cache=True, nogil=True)
def trim_setting_of(table: Table) -> Any:
    """Return the trim's SETTING record."""
    return record(table[3 * TRIM_SETTING], trim.SETTING)


@njit(cache=True, nogil=True)
def trim_of(table: Table) -> Any:
    """Return the trim's STATE record."""
    return record(table[3 * TRIM], trim.STATE)


@njit(cache=True, nogil=True)
def record_of(table: Table) -> Any:
    """Return the sample's TELEMETRY record."""
    return record(table[3 * RECORD], TELEMETRY)


@njit(cache=True, nogil=True)
def commands_of(table: Table) -> Any:
    """Return the (n,) COMMAND records of this sample."""
    return carray(pointer(table[3 * COMMANDS]), (table[3 * COMMANDS + 1],), COMMAND)


@njit(cache=True, nogil=True)
def follows_of(table: Table) -> Any:
    """Return the (n,) FOLLOW_T rows."""
    return carray(pointer(table[3 * FOLLOWS]), (table[3 * FOLLOWS + 1],), FOLLOW_T)


@njit(cache=True, nogil=True)
def add_note(table: Table, c: Any, code: int, value: float) -> None:
    """Add a note about an event; when the ring is full, the oldest notes are lost."""
    notes = carray(pointer(table[3 * NOTE_RING]), (table[3 * NOTE_RING + 1],), NOTE_T)
    slot = notes[c.notes % notes.size]
    slot.code, slot.value = code, value
    c.notes += 1


@njit(cache=True, nogil=True)
def meter_of(table: Table) -> Any:
    """Return the METER_T record."""
    return record(table[3 * METER], METER_T)


@njit(cache=True, nogil=True)
def ring_of(table: Table) -> Any:
    """Return the telemetry ring's records."""
    shape = (table[3 * TELEMETRY_RING + 1],)
    return carray(pointer(table[3 * TELEMETRY_RING]), shape, TELEMETRY)


@njit(cache=True, nogil=True)
def command_ring_of(table: Table) -> Any:
    """Return the command ring's records."""
    shape = (table[3 * COMMAND_RING + 1],)
    return carray(pointer(table[3 * COMMAND_RING]), shape, COMMAND)


@njit(cache=True, nogil=True)
def bytes_at(table: Table, place: int) -> NDArray[np.uint8]:
    """Return the (n, m) bytes at a place."""
    shape = (table[3 * place + 1], table[3 * place + 2])
    return carray(pointer(table[3 * place]), shape, types.uint8)


@njit(cache=True, nogil=True)
def takes(c: Any, event: int) -> bool:
    """Return whether the present state accepts this event."""
    return bool(NEXT[c.state, event] != NOTHING)


@njit(cache=True, nogil=True)
def happens(c: Any, event: int, now_ns: int) -> bool:
    """Apply an event of dehyst.daemon.loop.states; return True where the state changed."""
    after = NEXT[c.state, event]
    if after == NOTHING or after == c.state:
        return False
    c.state, c.since_ns = after, now_ns
    c.glide, c.stays = 0.0, 0
    return True


@njit(cache=True, nogil=True)
def drop_targets(c: Any, q: Any) -> None:
    """Drop trajectory and set-point."""
    targets.clear(q)
    c.target, c.learned = NAN, 0.0
