"""The times of rows that the file does not give a time each: from a rate, and from a counter of
samples where rows were lost."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.foreign.epochs import continued
from dehyst.daemon.files.foreign.found import Column, Draft, Sheet
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import role_of_column
from dehyst.models.recording import Floats

_DIVIDED = re.compile(
    r"(?<![^\W\d_])((?:decimat|averag|oversampl|down[ _-]?sampl|sub[ _-]?sampl|mittelung|dezimat)"
    r"[^\d.,+-]*)(?:1\s*[:/]\s*)?(\d+)(?:\.0*)?(?![\d.,]|\s*(?:[mun\u00b5]?s|[kM]?Hz)\b)",
    re.IGNORECASE,
)
"""A number that may lie between the rate of a converter and that of the rows."""

UNSET_S = 1.0
"""Period [s] of a waveform of LabVIEW for which none was set."""


def _divided_by(notes: Mapping[str, str]) -> tuple[str, int]:
    """Return (the note, the number) of a decimation or of averages that a file states, ("", 1) if
    it states none: "Decimation: 10"."""
    for text in (f"{name} {value}".strip() for name, value in notes.items()):
        if (found := _DIVIDED.search(text)) and int(found[2]) > 1:
            return text[:60], int(found[2])
    return "", 1


def _counter_with_gaps(columns: Sequence[Column], taken: Sequence[int]) -> tuple[str, Floats]:
    """Return (heading, (N,) samples since the first row) of a counter of samples of which some were
    lost, ("", ()) if no column is one. taken: columns that are something else."""
    for i, column in enumerate(columns):
        if i in taken or role_of_column(column):
            continue
        count, _ = continued(np.asarray(column.values, dtype=np.float64), False)
        steps = np.diff(count)
        whole = bool(np.all(steps >= 1.0)) and bool(np.all(steps == np.round(steps)))
        if whole and steps.size < 2 * np.count_nonzero(steps == 1.0) < 2 * steps.size:
            return column.heading or f"column {column.number}", count - count[0]
    return "", np.empty(0)


def count_time(
    columns: Sequence[Column],
    taken: Sequence[int],
    found: Sheet,
    reading: ReadOptions,
    draft: Draft,
) -> None:
    """Count the times of rows without a time of their own. taken: columns that are chosen."""
    step_s, (note, divisor) = found.step_s, _divided_by(found.notes)
    if reading.rate_hz:
        step_s, source = 1.0 / reading.rate_hz, "--rate"
    elif reading.time_unit and step_s > 0.0:
        draft.asked.append(
            f"--time-unit {reading.time_unit}: there is no column of times; the file states a "
            f"period of {step_s:.6g} s, which --rate HZ replaces"
        )
        return
    elif step_s > 0.0 and note:
        draft.asked.append(
            f"the file states {1.0 / step_s:.6g} Hz and '{note}', and does not say which rate "
            f"the rows have: add --rate {1.0 / step_s:.6g} or --rate {1.0 / step_s / divisor:.6g}"
        )
        return
    else:
        source = "the file's own period"
    if step_s > 0.0:
        heading, count = _counter_with_gaps(columns, taken)
        rows = count if heading else np.arange(len(columns[0].values))
        draft.columns["t_s"] = np.asarray(found.start_s + step_s * rows, dtype=np.float64)
        each = f"a count of '{heading[:40]}'" if heading else "a row"
        draft.said.append(f"t from {source} ({step_s:.6g} s {each})")
        if step_s == UNSET_S and not reading.rate_hz and any(c.wave for c in columns):
            found.said.append(
                "a waveform's period of 1 s is also what LabVIEW writes where none was set: add "
                "--rate HZ if the rows are not 1 s apart"
            )
        if heading:
            lost = int(count[-1]) + 1 - count.size
            found.said.append(f"'{heading[:40]}' leaves out {lost} samples, and so do the times")
    elif not any("columns t=" in text or "no column holds times" in text for text in draft.asked):
        draft.asked.append("no column of times: add --rate HZ (rows a second), or --columns t=...")
