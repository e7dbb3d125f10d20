"""Why the slow trim stands still; apart, because clients name it and need no kernels."""

from enum import IntEnum


class Why(IntEnum):
    """Why the trim stands still; NOTHING: it does not."""

    NOTHING = 0
    OFF = 1  # not configured
    NOT_RUNNING = 2  # nobody commands
    NO_READING = 3
    STUCK = 4  # the same reading to the last digit while the model moved
    JUMPED = 5  # the reading moved at once, the model did not
    BEYOND = 6  # further from the model than is believed
    DISTRUSTED = 7  # by the mismatch watch
    SETTLING = 8  # it jumped, is plausible again, and has to keep its place for a while
