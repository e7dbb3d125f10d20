"""The times of rows for which the file gives none: from a rate, and from a counter of samples if
rows were lost; and what else the file states about the pace of its rows."""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.foreign.beside import group_of
from dehyst.daemon.files.foreign.epochs import continued, never_falls
from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.found import Column, Draft, Sheet
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import role_of_column, unit_of_column
from dehyst.daemon.files.foreign.stated_step import (
    SAME_STEP,
    SURELY_SECONDS,
    on_stated_step,
)
from dehyst.daemon.files.foreign.units import TIME, UNITS, find_unit_key
from dehyst.models.arrays import Ints
from dehyst.models.recording import Floats
from dehyst.models.units import how_many

_DIVIDED = re.compile(
    r"(?<![^\W\d_])((?:decimat|averag|oversampl|down[ _-]?sampl|sub[ _-]?sampl|mittelung|dezimat)"
    r"[^\d.,+-]*)(?:1\s*[:/]\s*)?(\d+)(?:\.0*)?(?![\d.,]|\s*(?:[mun\u00b5]?s|[kM]?Hz)\b)",
    re.IGNORECASE,
)
"""A number that may lie between the rate of a converter and that of the rows."""

_PACE = re.compile(
    r"(dt|ts|(?:sampl(?:e|ing)|time)?[ _]?(?:interval|period|step))"
    r"|fs|rate|sampl(?:e|ing)[ _]?(?:rate|freq(?:uency)?)",
    re.IGNORECASE,
)
"""A name that may be that of a sampling period, the group, or of a rate."""
WRITTEN_APART = 0.4
"""Blank lines per line of numbers; more of them only separate the lines."""
REPEATED = 0.1
"""Share of times that are the same as the ones before them, if they are rounded."""
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
        rows = count if heading else number_rows(len(columns[0].values), found)
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
            found.said.append(
                f"'{heading[:40]}' leaves out {how_many(lost, 'sample')}, and so do the times"
            )
    elif not any("columns t=" in text or "no column holds times" in text for text in draft.asked):
        draft.asked.append("no column of times: add --rate HZ (rows a second), or --columns t=...")


def number_rows(size: int, found: Sheet) -> Ints:
    """Return the numbers of the rows (size,), with rows of empty fields between them counted, whose
    samples are missing."""
    if 0 < found.blank_lines <= WRITTEN_APART * size:
        found.said.append(
            f"{how_many(found.blank_lines, 'blank line is', 'blank lines are')} between the "
            "numbers, and not counted in the times"
        )
    if found.empty:
        found.said.append(
            f"{how_many(len(found.empty), 'row')} of empty fields counted in the times, the first "
            f"after {found.where(found.empty[0] - 1)}"
        )
    return _counting_empty(size, found)


def _counting_empty(size: int, found: Sheet) -> Ints:
    rows = np.arange(size)
    return rows + np.searchsorted(found.empty, rows, side="right")


def count_rounded(found: Sheet, unit: float, draft: Draft) -> None:
    """Count times that have too few digits for their steps from the period that the file states, if
    they are those of that period, and say so. unit: of the numbers in the file [s]."""
    times = draft.columns["t_s"]
    rows = _counting_empty(times.size, found)
    if found.step_s > 0.0 and not found.of_some:
        draft.columns["t_s"], digit = on_stated_step(times, rows, found.step_s, unit)
        if digit:
            found.said.append(
                f"the times are rounded to {digit:.2g} s: counted from the period that the file "
                f"states, {found.step_s:.6g} s a row"
            )


def note_contradictions(
    columns: Sequence[Column],
    chosen: Mapping[str, int],
    found: Sheet,
    reading: ReadOptions,
    draft: Draft,
) -> None:
    """Say which times are used where the file states others: a unit in the heading of the times
    that `--time-unit` replaces; a rate, a period, or times whose pace is not that of `--rate`; a
    rate or a period next to times of another pace. Where the unit of the times is not given, ask
    which is right."""
    time = columns[chosen["t"]] if "t" in chosen and not reading.rate_hz else None
    own = unit_of_column(time) if time is not None and not time.clock else ""
    if time is not None and reading.time_unit and own not in ("", find_unit_key(reading.time_unit)):
        found.said.append(
            f"--time-unit {reading.time_unit} is used for '{time.heading[:40]}', whose heading "
            f"says {own}"
        )
    used = _paces(draft.columns.get("t_s", np.empty(0)))
    in_seconds = own or reading.time_unit or time is None or time.clock
    others = _stated_paces([columns[i] for i in chosen.values()], found)
    sure = bool(others)
    others = others or _paces_by_name([columns[i] for i in chosen.values()], found)
    if reading.rate_hz:
        others += [
            (f"'{column.heading[:40]}' gives", _paces(factor * np.asarray(column.values)))
            for i, column in enumerate(columns)
            if i not in chosen.values() and (factor := _seconds_in(column))
        ]
    for what, paces in others:
        if min(*used, *paces) > 0.0 and not any(
            abs(pace - one) <= SAME_STEP * one for pace in paces for one in used
        ):
            other, here = f"{what} {1.0 / paces[0]:.6g} Hz", f"{1.0 / used[0]:.6g} Hz"
            if reading.rate_hz:
                found.said.append(f"{other}, --rate {here}, which is used")
            elif sure and not in_seconds:
                draft.asked.append(
                    f"{other}, the times without a unit, taken as seconds, {here}: add --time-unit "
                    "s, ms or us, or --rate HZ"
                )
            else:
                found.said.append(
                    f"{other}, its times {here}: the times are used, as each row has its own "
                    f"(--rate {1.0 / paces[0]:.6g} counts the rows instead)"
                )


def _stated_paces(taken: Sequence[Column], found: Sheet) -> list[tuple[str, tuple[float, ...]]]:
    """Return (how the file states it, periods [s] of the rows that agree with it) for each period
    that a file states for the columns that are taken, or for all."""
    waves = {column.wave[1] for column in taken if column.wave and column.wave[1]}
    if UNSET_S in waves:
        return []
    divisor = _divided_by(found.notes)[1]
    steps = waves or ({found.step_s} if found.step_s and not found.of_some else set())
    return [("the file states", (step, step * divisor)) for step in sorted(steps)]


def _paces_by_name(taken: Sequence[Column], found: Sheet) -> list[tuple[str, tuple[float, ...]]]:
    """Return the same for numbers next to the times that may be a period or a rate, in any unit."""
    groups = {group_of(column.heading).rstrip("/.") for column in taken} | {""}
    out: list[tuple[str, tuple[float, ...]]] = []
    for key, text in found.notes.items():
        group, values = group_of(key), {number_of(part) for part in text.split()}
        value = values.pop() if len(values) == 1 else None  # one for each channel, perhaps
        name = _PACE.fullmatch(key[len(group) :])
        if name and group.rstrip("/.") in groups and value and 0.0 < value < math.inf:
            step = value if name[1] else 1.0 / value
            paces = tuple(step * unit for unit in (1.0, 1e-3, 1e-6, 1e-9))
            out.append((f"the file states {name[0]} = {value:g}, perhaps", paces))
    return out


def _seconds_in(column: Column) -> float:
    """Return the seconds in a unit of a column that gives times; 0 for any other column, or if its
    unit is not given and may be another."""
    if role_of_column(column) != "t" or not never_falls(column.values):
        return 0.0
    unit = "s" if column.clock else unit_of_column(column)
    kind, _, factor = UNITS.get(unit, ("", "", 1.0))
    return factor if kind == TIME or _paces(np.asarray(column.values))[0] < SURELY_SECONDS else 0.0


def _paces(times: Floats) -> tuple[float, float]:
    """Return the usual and the mean step of (N,) times, which differ where times pause; the mean
    twice where they are rounded so much that they repeat; zeros if there is none."""
    known = times[np.isfinite(times)]
    steps = np.diff(known)
    if not steps.size:
        return 0.0, 0.0
    mean = float(known[-1] - known[0]) / steps.size
    repeated = float(np.mean(steps == 0.0)) > REPEATED
    return mean if repeated else float(np.median(steps)) or mean, mean
