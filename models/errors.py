"""Errors that a user can cause or correct. Everything else is a bug and may show a traceback.

DehystError
├── BadInput            a file, key, value or argument is wrong (the command line exits with 2)
│   ├── BadModel        a model file or its numbers
│   └── BadRecording    a recording or trajectory; OddRecording: of another stage than the others
├── NotNow              nothing is wrong with the input: a full disk, a busy port (exits with 1)
├── NotInvertible       the model cannot be inverted in its present form
└── DriverError         see dehyst.drivers.interface for its subclasses
"""


class DehystError(Exception):
    """Base of all errors whose message is for the user: what is wrong, where, and the remedy."""


class BadInput(DehystError):
    """The input cannot be used; the message names the file, key or value and the remedy."""


class BadModel(BadInput):
    """A model file is damaged or incomplete, or contains a number outside its range."""


class BadRecording(BadInput):
    """A recording or trajectory is damaged or lacks what the task needs."""


class OddRecording(BadRecording):
    """One recording does not belong to the others. recording: its name."""

    def __init__(self, message: str, recording: str) -> None:
        super().__init__(message)
        self.recording = recording


class NotNow(DehystError):
    """The request cannot be carried out at present; it may succeed later."""


class NotInvertible(DehystError):
    """After some reversal the model's output moves the wrong way, or its saturation is not
    monotone."""
