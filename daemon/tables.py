"""The controller's records and arrays, found in its table of addresses (dehyst.daemon.controls).

Kernels hand records on as `c` (CONTROL_T), `p` (PLAN_T), `q` (QUEUE_T), `m` (METER_T).
"""

import math
from typing import Any

import numpy as np
from numba import carray, njit
from numpy.typing import NDArray

from dehyst.daemon import controls as at
from dehyst.daemon import targets
from dehyst.daemon.records import COMMAND, TELEMETRY
from dehyst.daemon.targets import QUEUE_T
from dehyst.drivers.direct import pointer

Table = NDArray[np.int64]
NAN = math.nan


@njit(cache=True, nogil=True)
def control_of(table: Table) -> Any:
    """The CONTROL_T record."""
    return carray(pointer(table[3 * at.CONTROL]), (1,), at.CONTROL_T)[0]


@njit(cache=True, nogil=True)
def plan_of(table: Table) -> Any:
    """The PLAN_T record."""
    return carray(pointer(table[3 * at.PLAN]), (1,), at.PLAN_T)[0]


@njit(cache=True, nogil=True)
def queue_of(table: Table) -> Any:
    """The QUEUE_T record."""
    return carray(pointer(table[3 * at.QUEUE]), (1,), QUEUE_T)[0]


@njit(cache=True, nogil=True)
def record_of(table: Table) -> Any:
    """The sample's TELEMETRY record."""
    return carray(pointer(table[3 * at.RECORD]), (1,), TELEMETRY)[0]


@njit(cache=True, nogil=True)
def commands_of(table: Table) -> Any:
    """The (n,) COMMAND records of this sample."""
    return carray(pointer(table[3 * at.COMMANDS]), (table[3 * at.COMMANDS + 1],), COMMAND)


@njit(cache=True, nogil=True)
def note(table: Table, c: Any, code: int, value: float) -> None:
    """Say what happened; the oldest of many notes are lost."""
    notes = carray(pointer(table[3 * at.NOTE_RING]), (table[3 * at.NOTE_RING + 1],), at.NOTE_T)
    slot = notes[c.notes % notes.size]
    slot.code, slot.value = code, value
    c.notes += 1


@njit(cache=True, nogil=True)
def meter_of(table: Table) -> Any:
    """The METER_T record."""
    return carray(pointer(table[3 * at.METER]), (1,), at.METER_T)[0]


@njit(cache=True, nogil=True)
def ring_of(table: Table) -> Any:
    """The telemetry ring's records."""
    shape = (table[3 * at.TELEMETRY_RING + 1],)
    return carray(pointer(table[3 * at.TELEMETRY_RING]), shape, TELEMETRY)


@njit(cache=True, nogil=True)
def command_ring_of(table: Table) -> Any:
    """The command ring's records."""
    shape = (table[3 * at.COMMAND_RING + 1],)
    return carray(pointer(table[3 * at.COMMAND_RING]), shape, COMMAND)


@njit(cache=True, nogil=True)
def enter(c: Any, state: int, now_ns: int) -> None:
    """Begin a state."""
    c.state, c.since_ns = state, now_ns
    c.bump = 0.0


@njit(cache=True, nogil=True)
def drop_targets(c: Any, q: Any) -> None:
    """Forget trajectory and set-point."""
    targets.clear(q)
    c.target = NAN
