"""What the loop's compiled parts work on: its numbers as records, its arrays by place.

One table of addresses (dehyst.drivers.direct.Addresses) stands for a controller, one for the
inverse that it uses. Both engines, the Python loop and the compiled one, and the tests hand these
tables to the same kernels: dehyst.daemon.step_kernel and dehyst.daemon.sample_kernel.
"""

from enum import IntEnum

import numpy as np

from dehyst.daemon.records import MissCause

PLAN_T = np.dtype(
    [
        ("period_ns", "<i8"),
        ("gain", "<f8"),  # actuator volts per drive unit
        ("min_v", "<f8"),
        ("max_v", "<f8"),
        ("slew_v", "<f8"),  # per period
        ("safe_v", "<f8"),
        ("ramp_v", "<f8"),  # per period
        ("ramp_on_stop", "<i8"),
        ("ramp_on_fault", "<i8"),
        ("stale_ns", "<i8"),
        ("hold_ns", "<i8"),
        ("approach_um_per_s", "<f8"),
        ("origin", "<f8"),
    ]
)

CONTROL_T = np.dtype(
    [
        ("volts", "<f8"),  # the output as last written
        ("bump", "<f8"),  # what is left of the jump that a reload would have made; NaN: take it
        ("predicted", "<f8"),  # the model's next reading, from the origin
        ("target", "<f8"),  # newest target, from the origin; NaN: none
        ("target_ns", "<i8"),  # when it was last confirmed by a client
        ("since_ns", "<i8"),  # when the present state began
        ("hold_ns", "<i8"),
        ("approach_until_ns", "<i8"),
        ("stop_by_ns", "<i8"),  # the latest end of STOPPING
        ("step_ns", "<i8"),  # grid point of the newest sample; 0: none yet
        ("state", "<i8"),
        ("starved", "<i8"),
        ("pending", "<i8"),  # the inverse has proposed a drive that is not applied yet
        ("trajectory", "<u8"),
        ("trajectory_done", "<i8"),
        ("inverse", "<i8"),  # address of the inverse's table
        ("notes", "<i8"),  # how many notes were made
    ]
)

METER_T = np.dtype(
    [
        ("scheduled_ns", "<i8"),  # the deadline that is waited for or being served
        ("samples", "<i8"),
        ("missed", "<i8"),
        ("tail", "<i8"),  # of the command ring
        ("measured", "<f8"),  # last reading as model displacement
        ("scale", "<f8"),
        ("zero", "<f8"),
        ("sensor_every", "<i8"),
        ("spin_ns", "<i8"),
        ("lost", "<i8"),  # commands overwritten before they were taken
        # the thread's counters after the sample before
        ("major_faults", "<i8"),
        ("minor_faults", "<i8"),
        ("switches", "<i8"),
        ("waited_ns", "<i8"),  # time that the thread was ready and had no CPU
        ("cpu", "<i8"),  # where it ran
        ("schedstat", "<i8"),  # open file of the thread's /proc schedstat; -1: none
        # requests to the loop, taken at its next sample
        ("stop", "<i8"),
        ("swap", "<i8"),  # address of another inverse's table
        ("swap_origin", "<f8"),
        ("actuator_back", "<i8"),
        ("back_v", "<f8"),
        ("sensor_back", "<i8"),
        ("leave", "<i8"),  # end at once
        # devices: 1 usable, 0 down; the code that brought it down
        ("actuator_ok", "<i8"),
        ("sensor_ok", "<i8"),
        ("doubtful", "<i8"),  # 1: its own report contradicts it, nothing is to be written
        ("actuator_code", "<i8"),
        ("sensor_code", "<i8"),
        # C functions of the devices, for the compiled loop
        ("write", "<i8"),
        ("write_context", "<i8"),
        ("read", "<i8"),
        ("read_context", "<i8"),
    ]
)

NOTE_T = np.dtype([("code", "<i8"), ("value", "<f8")])
NOTES = 64
COMMANDS_PER_SAMPLE = 512
CAUSES = len(MissCause)

# Places in the controller's table.
(
    PLAN, CONTROL, QUEUE, TIMES, VALUES, NOTE_RING, COMMANDS, RECORD,
    METER, MISSED_BY, WAKE, WAKE_MOST, EXEC, EXEC_MOST, IO, IO_MOST,
    COMMAND_WORDS, COMMAND_RING, TELEMETRY_WORDS, TELEMETRY_RING, WITNESS, CLOCK,
    BUFFER, N_TABLE,
) = range(24)  # fmt: skip

# Places in the inverse's table.
(
    WEIGHTS, C, KNOTS, FIXED, SETTING, BLOCKS, PARAMS, NUMBERS, PLAYS, WORK, STATES, SCRATCH,
    INNER, PAST_RING, SEQ, Y, CHANNELS, RESULT, WINDOW, N_INVERSE,
) = range(20)  # fmt: skip


class Note(IntEnum):
    """What happened in a sample, as a code with one number; Python makes words of it."""

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


TEXTS = {
    Note.BAD_VALUE: "set-point {:g} dropped: not a number a stage can follow",
    Note.WITHDRAWN: "trajectory withdrawn by its client",
    Note.STOPPED: "stopped by a client",
    Note.RELEASED: "released by a client: ramping to the safe voltage",
    Note.POINT_FULL: "trajectory point at {:.3f} s dropped: the queue is full",
    Note.POINT_LATE: "trajectory point at {:.3f} s dropped: its time is not after the last",
    Note.RUN_DRY: "the trajectory has run dry: holding its last target",
    Note.NO_SETPOINT: "no set-point for {:g} s: holding, then to the safe voltage",
    Note.COMMANDS_LOST: "{:.0f} commands overwritten before the loop took them",
    Note.STOP_FAILED: "ending although the output stands at {:g} V: it does not reach its safe "
    "voltage",
    Note.STOOD_STILL: "the loop stood still for {:.2f} s; it glides to the target now",
    Note.RELOADED: "the new model is in use, set-point 0 is its {:.6g}",
}


def words(code: int, value: float) -> str:
    """A note as a sentence."""
    return TEXTS[Note(code)].format(value)
