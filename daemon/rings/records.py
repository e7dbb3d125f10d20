"""Records that core and gateway exchange through their rings, and the meaning of their codes.

telemetry.ring  core -> gateway   one TELEMETRY per sample, for every sample
status.ring     core -> gateway   one STATUS per second and at every change of state
                                  (dehyst.daemon.rings.status)
event.ring      core -> gateway   EVENT: messages about what happened
command.ring    gateway -> core   COMMAND: set-points, trajectory points, requests

Displacements are in the model's unit and count from the configured set-point origin; voltages
are the actuator's. Times `_ns` are CLOCK_MONOTONIC of the controller.
"""

import hashlib
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

import numpy as np

LARGEST_TARGET, LATEST_OFFSET_NS = 1e6, 10**9 * 86_400 * 365
"""Limits of a target, in either direction, and of a trajectory point's time. The gateway refuses
what is beyond them, and the loop drops what passed the gateway."""

TELEMETRY = np.dtype(
    [
        ("seq", "<i8"),  # sample number since the core started, without gaps
        ("scheduled_ns", "<i8"),  # deadline of this sample
        ("actual_ns", "<i8"),  # when the loop really woke
        ("target", "<f8"),  # set-point of this sample; NaN: none
        ("measured", "<f8"),  # sensor, read before `volts` is written; NaN: no valid reading
        ("predicted", "<f8"),  # the model's prediction of this reading
        ("trim", "<f8"),  # the slow trim's correction, added to the target
        ("learned", "<f8"),  # correction learned from earlier passes, added to the target
        ("volts_raw", "<f8"),  # voltage that the inverse requested
        ("volts", "<f8"),  # voltage that was written
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
        ("members", "u1"),  # POINT: number of axes that play this together
        ("group", "<i8"),  # POINT: number of their group, 0: this axis alone
        ("offset_ns", "<i8"),  # POINT: time since the trajectory's start
        ("value", "<f8"),
        ("correction", "<f8"),  # POINT: added to `value`; the reported target stays `value`
    ]
)


def model_digest(text: str) -> str:
    """Return the digest of a model file's text: 16 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def model_file(directory: Path, digest: str) -> Path:
    """Return the path, in the rings' folder, of the model that the loop runs, which may differ from
    the configured file by now. The STATUS record of a run contains its digest."""
    return directory / f"model-{digest}.toml"


class State(IntEnum):
    """States of the loop, and the effect of each on the voltage."""

    START = 0  # devices opening: the output stays as found
    READY = 1  # no client commands: the output stays
    RUNNING = 2  # following set-points: inverse, within range and slew
    HOLDING = 3  # set-points went stale: hold, then ramp to the safe voltage, then READY
    FAULT = 4  # a device failed: no new voltage until it is back; then `safe.on_fault`
    STOPPING = 5  # the daemon ends: `safe.on_stop`, then close


class Flag(IntFlag):
    """Exceptional conditions of a sample."""

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
    """The inverse that computed the voltage."""

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
    TRUST = 6  # value 0: the mismatch watch distrusts stage or gauge; 1: it trusts them
    ZERO = 7  # value: added to every reading from now on
    HOLD = 8  # drop targets and keep the present voltage: HOLDING


class MissCause(IntEnum):
    """Why a deadline was missed, by counters of the kernel and by a witness thread.

    The witness only sleeps, at a higher priority on the same CPU. If it was late at the same time,
    the program is not the cause.
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
    """Return the lower-case name of an enumeration's value; the number where it has none."""
    try:
        return str(kind(value).name).lower()
    except ValueError:
        return str(value)
