"""Read a file of another program, or learn what is asked for."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from dehyst.daemon.files.foreign.reading import ReadOptions, parse_columns
from dehyst.daemon.files.recordings import read_recording
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording


def read(path: Path, columns: str | Mapping[str, str | int] = "", **options: Any) -> Recording:
    """Read a recording. columns, options: as on the command line."""
    named = parse_columns(columns) if isinstance(columns, str) else columns
    return read_recording(path, need_displacement=True, reading=ReadOptions(named, **options))


def asked(path: Path, columns: str | Mapping[str, str | int] = "", **options: Any) -> str:
    """Return the one line in which a file is refused."""
    with pytest.raises(BadRecording) as error:
        read(path, columns, **options)
    assert "\n" not in str(error.value)
    return str(error.value)
