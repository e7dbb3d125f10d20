"""dehyst: hysteresis compensation service for piezo stages.

From Python: `load_recording`, `load_model`, `identify`, `simulate`, `invert`, `diagnose` and
`validate` on arrays, files and recordings, with results that show themselves in a notebook; and
`Client`, or `Group` for several axes, for a running daemon. What is heavy is imported when it is
first used.
"""

import importlib
from typing import Any

__version__ = "0.3.0.dev0"

FUNCTIONS = "dehyst.daemon.api.functions"
HOMES = {
    **dict.fromkeys(
        (
            "diagnose", "identify", "invert", "load_model", "load_recording", "simulate",
            "validate",
        ),
        FUNCTIONS,
    ),
    "Client": "dehyst.daemon.client.client",
    "DehystError": "dehyst.models.errors",
    "Group": "dehyst.daemon.client.group",
    "Model": "dehyst.models.model",
    "Positioner": "dehyst.daemon.client.positioner",
    "Recording": "dehyst.models.recording",
    "Trajectory": "dehyst.models.recording",
}  # fmt: skip
"""Module of each public name; their types stand in __init__.pyi."""

__all__ = sorted([*HOMES, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in HOMES:
        raise AttributeError(f"module 'dehyst' has no attribute {name!r}")
    value = getattr(importlib.import_module(HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
