"""Errors that a user can cause or mend. Everything else is a bug and may show a traceback.

DehystError
├── BadInput            a file, key, value or argument is wrong (the command line exits with 2)
│   ├── BadModel        a model file or its numbers
│   └── BadRecording    a recording or trajectory
├── NotNow              nothing is wrong with the input: a full disk, a busy port (exits with 1)
├── NotInvertible       the model cannot be inverted as it stands
└── DriverError         see dehyst.drivers.interface, where its branches are drawn
"""


class DehystError(Exception):
    """Base of all errors whose message is written for the user: what, where, what to do."""


class BadInput(DehystError):
    """Input that cannot be used; the message names the file, key or value and the remedy."""


class BadModel(BadInput):
    """A model file that is damaged, incomplete, or holds a number outside its range."""


class BadRecording(BadInput):
    """A recording or trajectory that is damaged or does not hold what the task needs."""


class NotNow(DehystError):
    """What was asked cannot be done at present; the same may work later."""


class NotInvertible(DehystError):
    """The model's output runs the wrong way after some reversal, or its saturation turns over."""
