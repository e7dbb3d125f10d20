"""Reasons for a frozen slow trim; a separate module, because clients need it without kernels."""

from enum import IntEnum


class FreezeReason(IntEnum):
    """Why the trim is frozen; NOTHING: it is not."""

    NOTHING = 0
    OFF = 1  # not configured
    NOT_RUNNING = 2  # no client commands
    NO_READING = 3
    STUCK = 4  # the same reading to the last digit while the model moved
    JUMPED = 5  # the reading moved suddenly, the model did not
    BEYOND = 6  # further from the model than is accepted
    DISTRUSTED = 7  # by the mismatch watch
    SETTLING = 8  # it jumped, is plausible again, and must stay constant for a while
