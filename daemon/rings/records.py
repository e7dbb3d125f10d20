"""The records that core and gateway exchange through their rings, and what their codes mean.

telemetry.ring  core -> gateway   one TELEMETRY a sample, every sample
status.ring     core -> gateway   one STATUS a second and at every change of state
                                  (dehyst.daemon.rings.status)
event.ring      core -> gateway   EVENT: what happened, in words
command.ring    gateway -> core   COMMAND: set-points, trajectory points, requests

Displacements are in the model's unit and count from the configured set-point origin; voltages
are the actuator's. Times `_ns` are CLOCK_MONOTONIC of the controller.
"""

import hashlib
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

import numpy as np

TELEMETRY = np.dtype(
    [
        ("seq", "<i8"),  # sample number since the core started, without gaps
        ("scheduled_ns", "<i8"),  # deadline of this sample
        ("actual_ns", "<i8"),  # when the loop really woke
        ("target", "<f8"),  # set-point of this sample; NaN: none
        ("measured", "<f8"),  # sensor, read before `volts` is written; NaN: no valid reading
        ("predicted", "<f8"),  # what the model expected of this reading
        ("trim", "<f8"),  # what the gauge's slow trim adds to the target
        ("learned", "<f8"),  # what was learned from earlier passes and is added to the target
        ("volts_raw", "<f8"),  # what the inverse asked for
        ("volts", "<f8"),  # what was written
        ("flags", "<u4"),  # Flag
        ("state", "u1"),  # State
        ("mode", "u1"),  # Mode of the inverse
        ("cause", "<u2"),  # MissCause of a missed deadline
        ("io_us", "<f4"),  # time spent in driver calls
        ("exec_us", "<f4"),  # wake-up to end of write
    ]
)

EVENT = np.dtype(
    [("time_ns", "<i8"), ("wall_ns", "<i8"), ("level", "u1"), ("code", "S32"), ("text", "S400")]
)

COMMAND = np.dtype(
    [
        ("kind", "u1"),  # LoopCommand
        ("last", "u1"),  # POINT: the trajectory ends here; SETPOINT, HOLD: until another command
        ("client", "<u8"),
        ("trajectory", "<u8"),
        ("members", "u1"),  # POINT: how many axes play this together
        ("group", "<i8"),  # POINT: their number, 0: this axis alone
        ("offset_ns", "<i8"),  # POINT: time since the trajectory's start
        ("value", "<f8"),
        ("correction", "<f8"),  # POINT: added to the target's value, which stays what is asked for
    ]
)


def model_digest(text: str) -> str:
    """The digest of a model file's text: 16 letters."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def model_file(directory: Path, digest: str) -> Path:
    """Beside the rings: the model that the loop runs, whatever became of the configured file. The
    STATUS record of a run names it."""
    return directory / f"model-{digest}.toml"


class State(IntEnum):
    """What the loop is doing, and what that does to the voltage."""

    START = 0  # devices opening: the output stays as found
    READY = 1  # no client commands: the output stays
    RUNNING = 2  # following set-points: inverse, within range and slew
    HOLDING = 3  # set-points went stale: hold, then ramp to the safe voltage, then READY
    FAULT = 4  # a device failed: no new voltage until it is back; then `safe.on_fault`
    STOPPING = 5  # asked to end: `safe.on_stop`, then close


class Flag(IntFlag):
    """What was out of the ordinary in a sample."""

    UNREACHABLE = 1  # target outside the reachable range; nearest drive used
    SLEW = 2  # the slew limit limited the voltage
    RANGE = 4  # the voltage range limited the voltage
    SENSOR_INVALID = 8  # no valid reading
    SENSOR_HELD = 16  # no new reading was due this period; the last one is repeated
    OUTSIDE_VALIDITY = 64  # drive or rate outside those of the model's recording
    MISSED = 128  # this sample missed its deadline
    WRITE_FAILED = 256  # the actuator did not accept the voltage
    FALLBACK = 512  # the inverse fell back (preview ran dry, or not monotone)
    APPROACH = 1024  # moving to a first point, or to the target after a pause or a new model
    MISMATCH = 2048  # the stage does not behave like its model
    TRIM_FROZEN = 4096  # the slow trim is frozen because the reading is unreliable


class Mode(IntEnum):
    """Which inverse made the voltage."""

    NONE = 0
    STATIC = 1
    CAUSAL = 2
    PREVIEW = 3
    HOLD = 4


class LoopCommand(IntEnum):
    """Requests to the loop."""

    SETPOINT = 1  # value: target
    POINT = 2  # one point of a timed trajectory
    STOP_MOTION = 3  # drop targets: HOLDING
    RELEASE = 4  # drop targets and ramp to the safe voltage now
    CLEAR = 5  # forget queued trajectory points of `trajectory`
    TRUST = 6  # value 0: the mismatch watch does not trust stage or gauge; 1: it does
    ZERO = 7  # value: added to every reading from now on
    HOLD = 8  # drop targets and keep the present voltage: HOLDING


class MissCause(IntEnum):
    """Why a deadline was missed: counters of the kernel, and a witness beside the loop.

    The witness is a thread at a higher priority on the same CPU that does nothing but sleep. Where
    it was late in the same moment, the fault is not the program's.
    """

    NONE = 0
    PAGE_FAULT = 1  # a page of memory had to be loaded
    PREEMPTED = 2  # another task had the CPU
    STEAL = 3  # the machine paused, and the hypervisor reports that it took the CPU
    DRIVER_IO = 4  # a device call took too long
    COMPUTE = 5  # the step itself took too long
    LATE_WAKE = 6  # none of the above: the kernel woke the loop late
    STALL = 7  # the machine paused: the witness was late and no other task had the CPU
    SUSPENDED = 8  # the process was stopped from outside (SIGSTOP, debugger, freezer)


def name_of(kind: Any, value: int) -> str:
    """Lower-case name of an enumeration's value; the number where it has none."""
    try:
        return str(kind(value).name).lower()
    except ValueError:
        return str(value)
