"""The records that core and gateway exchange through their rings, and what their codes mean.

telemetry.ring  core -> gateway   one TELEMETRY a sample, every sample
status.ring     core -> gateway   one STATUS a second and at every change of state
event.ring      core -> gateway   EVENT: what happened, in words
command.ring    gateway -> core   COMMAND: set-points, trajectory points, requests

Displacements are in the model's unit and count from the configured set-point origin; voltages
are the actuator's. Times `_ns` are CLOCK_MONOTONIC of the controller.
"""

from enum import IntEnum, IntFlag

import numpy as np

MODEL_IN_USE = "in-use.toml"
"""Beside the rings: the model that the loop runs, whatever became of the configured file."""

TELEMETRY = np.dtype(
    [
        ("seq", "<i8"),  # sample number since the core started, without gaps
        ("scheduled_ns", "<i8"),  # deadline of this sample
        ("actual_ns", "<i8"),  # when the loop really woke
        ("target", "<f8"),  # set-point of this sample; NaN: none
        ("measured", "<f8"),  # sensor, read before `volts` is written; NaN: no valid reading
        ("predicted", "<f8"),  # what the model expected of this reading
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

STATUS = np.dtype(
    [
        ("time_ns", "<i8"),
        ("wall_ns", "<i8"),
        ("state", "u1"),
        ("policy", "u1"),  # scheduling policy obtained: 0 other, 1 fifo
        ("priority", "u1"),
        ("mode", "u1"),
        ("samples", "<i8"),
        ("missed", "<i8"),  # deadlines missed: sample started a period or more late, or skipped
        ("missed_by", "<i8", (9,)),  # by MissCause
        ("wake_us", "<f4", (4,)),  # p50, p99, p99.9, max of wake-up lateness, last window
        ("exec_us", "<f4", (4,)),  # the same of execution time
        ("io_us", "<f4", (4,)),
        ("actuator_ok", "u1"),
        ("sensor_ok", "u1"),
        ("actuator_errors", "<i8"),
        ("sensor_errors", "<i8"),
        ("volts", "<f8"),
        ("queue_s", "<f8"),  # trajectory still ahead
        ("trajectory", "<u8"),  # id of the trajectory being played or played last; 0: none
        ("trajectory_done", "u1"),
        ("origin", "<f8"),  # model displacement at set-point 0
        ("reach_min", "<f8"),  # reachable set-points
        ("reach_max", "<f8"),
        ("latency_s", "<f8"),  # of the inverse (preview window)
        ("period_ns", "<i8"),
        ("pid", "<i8"),
    ]
)

EVENT = np.dtype(
    [("time_ns", "<i8"), ("wall_ns", "<i8"), ("level", "u1"), ("code", "S32"), ("text", "S400")]
)

COMMAND = np.dtype(
    [
        ("kind", "u1"),  # Command
        ("last", "u1"),  # POINT: the trajectory ends here
        ("client", "<u8"),
        ("trajectory", "<u8"),
        ("offset_ns", "<i8"),  # POINT: time since the trajectory's start
        ("value", "<f8"),
    ]
)


class State(IntEnum):
    """What the loop is doing, and what that does to the voltage."""

    START = 0  # devices opening: the output stays as found
    READY = 1  # nobody commands: the output stays
    RUNNING = 2  # following set-points: inverse, within range and slew
    HOLDING = 3  # set-points went stale: hold, then ramp to the safe voltage, then READY
    FAULT = 4  # a device failed: no new voltage until it is back; then `safe.on_fault`
    STOPPING = 5  # asked to end: `safe.on_stop`, then close


class Flag(IntFlag):
    """What was out of the ordinary in a sample."""

    UNREACHABLE = 1  # target outside the reachable range; nearest drive used
    SLEW = 2  # the slew limit held the voltage back
    RANGE = 4  # the voltage range held the voltage back
    SENSOR_INVALID = 8  # no valid reading
    SENSOR_HELD = 16  # no new reading was due this period; the last one is repeated
    STALE = 32  # the set-point is older than setpoint.stale_s
    OUTSIDE_VALIDITY = 64  # drive or rate outside what the model was identified on
    MISSED = 128  # this sample missed its deadline
    WRITE_FAILED = 256  # the actuator did not take the voltage
    FALLBACK = 512  # the inverse fell back (preview ran dry, or not monotone)
    APPROACH = 1024  # moving to a trajectory's first point
    MISMATCH = 2048  # the stage does not behave as its model


class Mode(IntEnum):
    """Which inverse made the voltage."""

    NONE = 0
    STATIC = 1
    CAUSAL = 2
    PREVIEW = 3
    HOLD = 4


class Command(IntEnum):
    """Requests to the loop."""

    SETPOINT = 1  # value: target
    POINT = 2  # one point of a timed trajectory
    STOP_MOTION = 3  # drop targets: HOLDING
    RELEASE = 4  # drop targets and ramp to the safe voltage now
    CLEAR = 5  # forget queued trajectory points of `trajectory`


class MissCause(IntEnum):
    """Why a deadline was missed: counters of the kernel, and a witness beside the loop.

    The witness is a thread at a higher priority on the same CPU that does nothing but sleep. Where
    it was late in the same moment, the fault is not the program's.
    """

    NONE = 0
    PAGE_FAULT = 1  # memory was not there
    PREEMPTED = 2  # another task had the CPU
    STEAL = 3  # the machine stood still, and the hypervisor says that it took the CPU
    DRIVER_IO = 4  # a device call took its time
    COMPUTE = 5  # the step itself took too long
    LATE_WAKE = 6  # none of the above: the kernel woke us late
    STALL = 7  # the machine stood still: the witness was late and nobody else had the CPU
    SUSPENDED = 8  # the process was stopped from outside (SIGSTOP, debugger, freezer)
