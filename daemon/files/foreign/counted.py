"""The times of rows that the file does not give a time each: from a rate, and from a counter of
samples where rows were lost."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.foreign.epochs import continued
from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.roles import role_of
from dehyst.daemon.files.foreign.units import find_unit_key

_DIVIDED = re.compile(
    r"(?<![^\W\d_])((?:decimat|averag|oversampl|down[ _-]?sampl|sub[ _-]?sampl|mittelung|dezimat)"
    r"[^\d.,+-]*)(?:1\s*[:/]\s*)?(\d+)(?:\.0*)?(?![\d.,]|\s*(?:[mun\u00b5]?s|[kM]?Hz)\b)",
    re.IGNORECASE,
)
"""A number that may lie between the rate of a converter and that of the rows."""


def divided_by(notes: Mapping[str, str]) -> tuple[str, int]:
    """Return (the note, the number) of a decimation or of averages that a file states, ("", 1) if
    it states none: "Decimation: 10"."""
    for text in (f"{name} {value}".strip() for name, value in notes.items()):
        if (found := _DIVIDED.search(text)) and int(found[2]) > 1:
            return text[:60], int(found[2])
    return "", 1


def counter_with_gaps(columns: Sequence[Column], taken: Sequence[int]) -> tuple[str, np.ndarray]:
    """Return (heading, (N,) samples since the first row) of a counter of samples of which some were
    lost, ("", ()) if no column is one. taken: columns that are something else."""
    for i, column in enumerate(columns):
        if i in taken or role_of(column.heading, find_unit_key(column.unit))[0]:
            continue
        count, _ = continued(np.asarray(column.values, dtype=np.float64), False)
        steps = np.diff(count)
        whole = bool(np.all(steps >= 1.0)) and bool(np.all(steps == np.round(steps)))
        if whole and steps.size < 2 * np.count_nonzero(steps == 1.0) < 2 * steps.size:
            return column.heading or f"column {column.number}", count - count[0]
    return "", np.empty(0)
