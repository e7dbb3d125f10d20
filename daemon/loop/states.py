"""The loop's states and transitions: one table, read by the kernels of both loops, by the
documentation (docs/loop-states.md) and by an exhaustive test.

A cell names the next state. "-": the event is accepted and the state does not change; "x": the
event is ignored. In FAULT a client's stop is kept until the devices are back. Events of one sample
are handled in this order: end, recovered, commands, stale, arrived.

    target   a set-point or a point of a trajectory
    halt     a client stops the motion, or withdraws the trajectory that is being played
    release  a client releases the stage: it ramps to the safe voltage now
    stale    no target for setpoint.stale_s
    arrived  the output has reached its safe voltage
    fault    a device failed, or its report contradicts what was written
    ramp     the devices are back, safe.on_fault = "ramp" or a stop was kept
    stay     the devices are back, safe.on_fault = "hold"
    end      the process is asked to end
"""

from enum import IntEnum, auto

import numpy as np

from dehyst.daemon.rings.records import State

TABLE = """
          target   halt     release  stale    arrived  fault    ramp     stay     end
start     x        x        x        x        x        fault    x        x        stopping
ready     running  -        holding  x        x        fault    x        x        stopping
running   -        holding  holding  holding  x        fault    x        x        stopping
holding   running  -        -        x        ready    fault    x        x        stopping
fault     x        -        x        x        x        -        holding  ready    stopping
stopping  x        x        x        x        x        x        x        x        -
"""


class LoopEvent(IntEnum):
    """The columns of the table."""

    TARGET = 0
    HALT = auto()
    RELEASE = auto()
    STALE = auto()
    ARRIVED = auto()
    FAULT = auto()
    RAMP = auto()
    STAY = auto()
    END = auto()


NOTHING = -1


def _parse(table: str) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    head, *rows = (line.split() for line in table.strip().splitlines())
    if [LoopEvent[name.upper()] for name in head] != list(LoopEvent):
        raise ValueError("the table's columns are not the events in their order")
    found = np.full((len(State), len(LoopEvent)), NOTHING)
    for name, *cells in rows:
        state = State[name.upper()]
        for event, cell in zip(LoopEvent, cells, strict=True):
            if cell != "x":
                found[state, event] = state if cell == "-" else State[cell.upper()]
    return found


NEXT = _parse(TABLE)
"""(states, events) -> the next state, NOTHING where the event is ignored."""
