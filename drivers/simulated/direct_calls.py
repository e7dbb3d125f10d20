"""The simulated stage's amplifier and gauge as C functions, for the compiled loop.

They do what SimulatedActuator.write and SimulatedSensor.read do, on the same stage; faults of the
reading (Stage.fault) are Python's and do not show here. The context is a table of addresses.
"""

import math

import numpy as np
from numba import carray, cfunc, njit, types

from dehyst.drivers.direct_calls import (
    SIGNATURE,
    Addresses,
    Direct,
    Words,
    floats_at,
    grid_at,
    pointer,
    whole_at,
)
from dehyst.drivers.interface import DeviceGone, DriverError, OutOfRange
from dehyst.drivers.simulated import kernels, parts
from dehyst.drivers.simulated.kernels import StageArrays
from dehyst.drivers.simulated.stage import Stage

UNPLUGGED, NOT_IN_RANGE = 1, 2
# Places in the context's table: the fields of StageArrays, then SWITCHES: [1 when plugged, origin
# of time in ns], then NUMBERS: [seconds per write or 0 for the clock's time, lowest volts,
# highest volts].
SWITCHES, NUMBERS, N_PLACES = (len(StageArrays._fields) + i for i in range(3))
PARAMETERS, ELEMENTS, STATE, SPRINGS, RELAX, RING, RANDOM = (
    StageArrays._fields.index(name)
    for name in ("parameters", "elements", "state", "springs", "relax", "ring", "random")
)


@njit(cache=True, nogil=True)
def _plant(t: Words) -> StageArrays:
    return StageArrays(
        carray(pointer(t[3 * PARAMETERS]), (1,), parts.PARAMETERS_T),
        grid_at(t, ELEMENTS),
        carray(pointer(t[3 * STATE]), (1,), parts.STATE_T),
        floats_at(t, SPRINGS),
        floats_at(t, RELAX),
        grid_at(t, RING),
        carray(pointer(t[3 * RANDOM]), (1,), types.uint64),
    )


@njit(cache=True, nogil=True)
def _follow(t: Words, now_ns: int) -> None:
    """Let the stage's time come up to the loop's."""
    if floats_at(t, NUMBERS)[0] > 0.0:
        return
    plant = _plant(t)
    s = plant.state[0]
    dt_s = (now_ns - whole_at(t, SWITCHES)[1]) * 1e-9 - s.time_s
    if dt_s > 0.0:
        kernels.advance_stage(plant, dt_s, s.command_v, s.command_v)


@njit(cache=True, nogil=True)
def _write(t: Words, now_ns: int, volts: float) -> int:
    if whole_at(t, SWITCHES)[0] == 0:
        return UNPLUGGED
    numbers = floats_at(t, NUMBERS)
    period_s, low_v, high_v = numbers[0], numbers[1], numbers[2]
    if not low_v <= volts <= high_v:
        return NOT_IN_RANGE
    _follow(t, now_ns)
    plant = _plant(t)
    plant.state[0].command_v = volts
    if period_s > 0.0:
        kernels.advance_stage(plant, period_s, volts, volts)
    return 0


@njit(cache=True, nogil=True)
def _read(t: Words, now_ns: int) -> float:
    if whole_at(t, SWITCHES)[0] == 0:
        return math.nan
    _follow(t, now_ns)
    plant = _plant(t)
    return parts.reading(plant.parameters, plant.state, plant.ring, plant.random)


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
    for place, array in enumerate(stage.plant):
        table.put(place, array)
    table.put(SWITCHES, switches)
    table.put(NUMBERS, np.array([period_s, low_v, high_v]))
    return table


def explain(code: int) -> DriverError:
    """What a result other than 0 stands for."""
    if code == NOT_IN_RANGE:
        return OutOfRange("simulated actuator: outside its range; nothing was written")
    return DeviceGone("the simulated stage is unplugged")


def actuator(context: Addresses) -> Direct:
    """The amplifier."""
    return Direct(write.address, context.address, explain, (context,))


def sensor(context: Addresses) -> Direct:
    """The gauge."""
    return Direct(read.address, context.address, explain, (context,))
