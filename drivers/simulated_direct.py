"""The simulated stage's amplifier and gauge as C functions, for the compiled loop.

They do what SimulatedActuator.write and SimulatedSensor.read do, on the same stage; faults of the
reading (Stage.fault) are Python's and do not show here. The context is a table of addresses.
"""

import math

import numpy as np
from numba import carray, cfunc, njit, types

from dehyst.drivers import stage_kernels, stage_parts
from dehyst.drivers.direct import (
    Addresses,
    Direct,
    Words,
    floats_at,
    grid_at,
    pointer,
    whole_at,
)
from dehyst.drivers.stage import Stage

UNPLUGGED, NOT_IN_RANGE = 1, 2
MEANING = {
    UNPLUGGED: "simulated stage is unplugged",
    NOT_IN_RANGE: "simulated actuator: voltage outside its range; nothing was written",
}
# Places in the context's table. SWITCHES: [1 when plugged, origin of time in ns].
# NUMBERS: [seconds per write or 0 for the clock's time, lowest and highest voltage].
(
    PARAMETERS, ELEMENTS, STATE, SPRINGS, RELAX, RING, RANDOM, SWITCHES, NUMBERS, N_PLACES,
) = range(10)  # fmt: skip
SIGNATURE = types.int32(types.voidptr, types.int64, types.CPointer(types.float64))


@njit(cache=True, nogil=True)
def _advance(t: Words, dt_s: float) -> None:
    parameters = carray(pointer(t[3 * PARAMETERS]), (1,), stage_parts.PARAMETERS_T)
    state = carray(pointer(t[3 * STATE]), (1,), stage_parts.STATE_T)
    held = state[0].command_v
    stage_kernels.advance(
        parameters, grid_at(t, ELEMENTS), state, floats_at(t, SPRINGS), floats_at(t, RELAX),
        grid_at(t, RING), dt_s, held, held,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _follow(t: Words, now_ns: int) -> None:
    """Let the stage's time come up to the loop's."""
    if floats_at(t, NUMBERS)[0] > 0.0:
        return
    state = carray(pointer(t[3 * STATE]), (1,), stage_parts.STATE_T)
    dt_s = (now_ns - whole_at(t, SWITCHES)[1]) * 1e-9 - state[0].time_s
    if dt_s > 0.0:
        _advance(t, dt_s)


@njit(cache=True, nogil=True)
def _write(t: Words, now_ns: int, volts: float) -> int:
    if whole_at(t, SWITCHES)[0] == 0:
        return UNPLUGGED
    numbers = floats_at(t, NUMBERS)
    if not numbers[1] <= volts <= numbers[2]:
        return NOT_IN_RANGE
    _follow(t, now_ns)
    state = carray(pointer(t[3 * STATE]), (1,), stage_parts.STATE_T)
    state[0].command_v = volts
    if numbers[0] > 0.0:
        _advance(t, numbers[0])
    return 0


@njit(cache=True, nogil=True)
def _read(t: Words, now_ns: int) -> float:
    if whole_at(t, SWITCHES)[0] == 0:
        return math.nan
    _follow(t, now_ns)
    parameters = carray(pointer(t[3 * PARAMETERS]), (1,), stage_parts.PARAMETERS_T)
    state = carray(pointer(t[3 * STATE]), (1,), stage_parts.STATE_T)
    random = carray(pointer(t[3 * RANDOM]), (1,), types.uint64)
    return stage_parts.reading(parameters, state, grid_at(t, RING), random)


@cfunc(SIGNATURE, cache=True)
def write(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Set the output to value[0]."""
    return _write(carray(context, (3 * N_PLACES,), types.int64), now_ns, value[0])


@cfunc(SIGNATURE, cache=True)
def read(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Put one reading into value[0]."""
    t = carray(context, (3 * N_PLACES,), types.int64)
    value[0] = _read(t, now_ns)
    return UNPLUGGED if whole_at(t, SWITCHES)[0] == 0 else 0


def context_of(
    stage: Stage, switches: Words, period_s: float, low_v: float, high_v: float
) -> Addresses:
    """The context of both functions; switches: (2,) see SWITCHES."""
    table = Addresses(N_PLACES)
    arrays = {
        PARAMETERS: stage._parameters,
        ELEMENTS: stage._elements,
        STATE: stage._state,
        SPRINGS: stage._z,
        RELAX: stage._relax,
        RING: stage._ring,
        RANDOM: stage._random,
        SWITCHES: switches,
        NUMBERS: np.array([period_s, low_v, high_v]),
    }
    for place, array in arrays.items():
        table.put(place, array)
    return table


def actuator(context: Addresses) -> Direct:
    """The amplifier."""
    return Direct(write.address, context.address, MEANING, (context,))


def sensor(context: Addresses) -> Direct:
    """The gauge."""
    return Direct(read.address, context.address, MEANING, (context,))
