"""A simulated axis' amplifier and gauge as C functions, for the compiled loop.

They do what SimulatedActuator.write and SimulatedSensor.read do, on the same stage; faults of the
reading (Stage.fault) are applied only in Python, not here. The context is a table of addresses.
"""

import math

import numpy as np
from numba import carray, cfunc, njit, types

from dehyst.drivers.direct_calls import SIGNATURE, Direct
from dehyst.drivers.interface import DeviceGone, DriverError, OutOfRange
from dehyst.drivers.simulated import kernels, parts
from dehyst.drivers.simulated.axes import DRIVEN, EPOCH, PLUGGED, WRITTEN, N
from dehyst.drivers.simulated.kernels import PlatformArrays
from dehyst.models.addresses import Addresses, Words, floats_at, grid_at, pointer, whole_at

UNPLUGGED, NOT_IN_RANGE = 1, 2
# Positions in the context's table: the fields of PlatformArrays, then SWITCHES (see
# shared_stage.py), then NUMBERS: [seconds per sample or 0 for the clock's time, lowest volts,
# highest volts, axis].
SWITCHES, NUMBERS, N_PLACES = (len(PlatformArrays._fields) + i for i in range(3))
PARAMETERS, ELEMENTS, STATE, SPRINGS, RELAX, RING, RANDOM, PRESENT = range(SWITCHES)


@njit(cache=True, nogil=True)
def _platform(t: Words) -> PlatformArrays:
    return PlatformArrays(
        carray(pointer(t[3 * PARAMETERS]), (N,), parts.PARAMETERS_T),
        grid_at(t, ELEMENTS),
        carray(pointer(t[3 * STATE]), (N,), parts.STATE_T),
        grid_at(t, SPRINGS),
        grid_at(t, RELAX),
        grid_at(t, RING),
        carray(pointer(t[3 * RANDOM]), (N,), types.uint64),
        whole_at(t, PRESENT),
    )


@njit(cache=True, nogil=True)
def _follow(t: Words, now_ns: int) -> None:
    """Advance the stage to the loop's time; do nothing in virtual time."""
    numbers = floats_at(t, NUMBERS)
    if numbers[0] > 0.0:
        return
    platform = _platform(t)
    begun_s = platform.state[int(numbers[3])].time_s
    dt_s = (now_ns - whole_at(t, SWITCHES)[EPOCH]) * 1e-9 - begun_s
    if dt_s > 0.0:
        kernels.advance_platform(platform, dt_s)


@njit(cache=True, nogil=True)
def _write(t: Words, now_ns: int, volts: float) -> int:
    numbers, switches = floats_at(t, NUMBERS), whole_at(t, SWITCHES)
    period_s, low_v, high_v, place = numbers[0], numbers[1], numbers[2], int(numbers[3])
    if switches[PLUGGED + place] == 0:
        return UNPLUGGED
    if not low_v <= volts <= high_v:
        return NOT_IN_RANGE
    _follow(t, now_ns)
    platform = _platform(t)
    if period_s > 0.0 and switches[WRITTEN + place] != 0:
        kernels.advance_platform(platform, period_s)
        switches[WRITTEN : WRITTEN + N] = 0
    platform.state[place].command_v = volts
    switches[WRITTEN + place] = 1
    for i in range(N):
        if switches[WRITTEN + i] < switches[DRIVEN + i]:
            return 0
    if period_s > 0.0:
        kernels.advance_platform(platform, period_s)
        switches[WRITTEN : WRITTEN + N] = 0
    return 0


@njit(cache=True, nogil=True)
def _read(t: Words, now_ns: int) -> float:
    place = int(floats_at(t, NUMBERS)[3])
    if whole_at(t, SWITCHES)[PLUGGED + place] == 0:
        return math.nan
    _follow(t, now_ns)
    plant = kernels.axis_of(_platform(t), place)
    return parts.reading(plant.parameters, plant.state, plant.ring, plant.random)


@cfunc(SIGNATURE, cache=True)
def write(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Set the output to value[0]."""
    return _write(carray(context, (3 * N_PLACES,), types.int64), now_ns, value[0])


@cfunc(SIGNATURE, cache=True)
def read(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Store one reading in value[0]."""
    t = carray(context, (3 * N_PLACES,), types.int64)
    value[0] = _read(t, now_ns)
    place = int(floats_at(t, NUMBERS)[3])
    return UNPLUGGED if whole_at(t, SWITCHES)[PLUGGED + place] == 0 else 0


def context_of(
    arrays: PlatformArrays, switches: Words, numbers: tuple[float, float, float, int]
) -> Addresses:
    """Return the context of both functions; switches, numbers: see SWITCHES, NUMBERS."""
    table = Addresses(N_PLACES)
    for place, array in enumerate(arrays):
        table.put(place, array)
    table.put(SWITCHES, switches)
    table.put(NUMBERS, np.array(numbers, dtype=np.float64))
    return table


def explain(code: int) -> DriverError:
    """Return the error that a non-zero result means."""
    if code == NOT_IN_RANGE:
        return OutOfRange("simulated actuator: the value is outside its range; nothing was written")
    return DeviceGone("the simulated stage is unplugged")


def actuator(context: Addresses) -> Direct:
    """Return the amplifier's function."""
    return Direct(write.address, context.address, explain, (context,))


def sensor(context: Addresses) -> Direct:
    """Return the gauge's function."""
    return Direct(read.address, context.address, explain, (context,))
