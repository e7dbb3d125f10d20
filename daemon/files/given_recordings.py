"""Read the recordings named on a command line; report on stderr how they were interpreted."""

import argparse
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dehyst.daemon.files.axis_columns import unit_factor
from dehyst.daemon.files.foreign.reading import reading_of
from dehyst.daemon.files.recordings import read_recording, read_recordings
from dehyst.daemon.printable import printable
from dehyst.models.recording import Floats, Recording
from dehyst.models.units import UNIT_NAMES


def read_given(
    paths: Iterable[Path],
    args: argparse.Namespace,
    need_displacement: bool = True,
    defects: bool = False,
) -> list[Recording]:
    """Return the recordings in these files, with distinct names if two folders hold the same file
    name, and several of a file whose clock went back. args: with the options of add_reading;
    defects: report missing values and gaps. Raises BadInput."""
    reading = reading_of(args)
    out: list[Recording] = []
    for path in paths:
        parts = read_recordings(path, need_displacement=need_displacement, reading=reading)
        say_read(parts[0].read)
        for one in parts:
            say_read(one.defects() if defects else "")
            taken = any(one.name == other.name for other in out)
            out.append(replace(one, name=one.name.replace(path.name, str(path))) if taken else one)
    return out


def read_one_given(path: Path, args: argparse.Namespace, min_rows: int = 1) -> Recording:
    """Return the only recording in a file; its displacement may be missing. Raises BadInput, also
    if its clock went back."""
    recording = read_recording(path, min_rows=min_rows, reading=reading_of(args))
    say_read(recording.read)
    say_read(recording.defects())
    return recording


def say_converted(recordings: Iterable[Recording], unit: str) -> None:
    """Report recordings whose lengths are converted to a model's unit."""
    for one in recordings:
        own = one.displacement_unit
        if one.displacement is not None and unit_factor(own, unit) not in (None, 1.0):
            say_read(f"{one.name}: its lengths are in {own}, converted to the model's {unit}")


def say_defects(name: str, columns: Mapping[str, Floats]) -> None:
    """Report the values of drive and displacement that are missing, and gaps in the times."""
    t_s = columns["t_s"]
    drive, displacement = (
        next((columns[key] for unit in UNIT_NAMES if (key := f"{letter}_{unit}") in columns), None)
        for letter in "uy"
    )
    shown = Recording(t_s, np.zeros(t_s.size) if drive is None else drive, displacement, name=name)
    say_read(shown.defects())


def say_read(text: str) -> None:
    """Print one line on stderr; nothing if the text is empty."""
    if text:
        print(printable(text), file=sys.stderr)
