"""Bring columns that begin at different times to common rows.

A waveform states when it begins, and its period; a column of a sheet or group with times of its own
has those. Rows of different times do not belong together, whatever --rate says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dehyst.daemon.files.foreign.choice.advice import describe_column
from dehyst.daemon.files.foreign.choice.choose import path_of
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import role_of_column, unit_of_column
from dehyst.daemon.files.foreign.stated_step import SAME_STEP, SURELY_SECONDS
from dehyst.daemon.files.foreign.units import TIME, UNITS, find_unit_key
from dehyst.models.arrays import Floats
from dehyst.models.errors import BadRecording

LEAST_PAIRS = 10
"""Of rows with one time, which fewer may have by chance."""
OF_PAIRS, OF_STEPS = 0.99, 0.1
"""Shares of the pairs that rise, and of the steps between pairs that fall, in an envelope: samples
of a signal that falls are in falling pairs."""
WHOLE = 0.05
"""Share of a period by which beginnings may be off a whole number of rows, as they are rounded."""
_REMEDY = "bring them to one column of times first"


def refuse_no_common_row(name: str, columns: Sequence[Column], chosen: Mapping[str, int]) -> None:
    """Raise BadRecording if no row has both a drive and a displacement."""
    pair = [columns[chosen[role]] for role in "uy" if role in chosen]
    given = [np.isfinite(np.asarray(column.values, dtype=np.float64)) for column in pair]
    if len(pair) == 2 and all(map(np.any, given)) and not np.any(given[0] & given[1]):
        both = " and ".join(map(describe_column, pair))
        raise BadRecording(
            f"{name}: no row has both {both}, each is written at times of its own, as "
            f"PlotJuggler does: {_REMEDY}"
        )


def refuse_envelope(
    name: str, columns: Sequence[Column], chosen: Mapping[str, int], reading: ReadOptions
) -> None:
    """Raise BadRecording if each time comes twice with the lower value first, as an oscilloscope
    writes the envelope of an interval. With --rate the rows count as samples."""
    if "t" not in chosen or reading.rate_hz:
        return
    first, second = _pairs(columns[chosen["t"]])
    if first.size < LEAST_PAIRS or not np.array_equal(first, second):
        return
    if np.any(np.diff(first) == 0.0):
        return
    pairs = [_pairs(columns[chosen[role]]) for role in "uy" if role in chosen]
    rising = [np.mean(low < high) >= OF_PAIRS for low, high in pairs]
    if rising and all(rising) and all(np.mean(np.diff(low) < 0) > OF_STEPS for low, _ in pairs):
        raise BadRecording(
            f"{name}: each time comes twice, the lower value first: these seem to be minimum and "
            "maximum of an interval (peak detect, envelope), not samples: export the samples, or "
            "add --rate HZ if the rows are samples"
        )


def _pairs(column: Column) -> tuple[Floats, Floats]:
    values = np.asarray(column.values, dtype=np.float64)
    return values[: values.size // 2 * 2 : 2], values[1::2]


def with_own_times(
    name: str, columns: Sequence[Column], chosen: Mapping[str, int], reading: ReadOptions
) -> list[Column]:
    """Return the columns such that each of a group with times of its own states its beginning and
    period in place of these times, [] unless drive and displacement are in two groups whose times
    differ. Raises BadRecording if these are not even."""
    pair = [columns[chosen[role]] for role in "uy" if role in chosen]
    times = [_times_beside(column, columns) for column in pair]
    if len(times) < 2 or times[0] is None or times[1] is None or times[0] is times[1]:
        return []
    first, second = (np.asarray(column.values, dtype=np.float64) for column in (times[0], times[1]))
    near = WHOLE * float(np.median(np.abs(np.diff(first))))
    if np.allclose(first, second, rtol=0.0, atol=near):
        return []
    waves = {_group_of(time): _even_wave(name, time, reading) for time in times if time}
    replaced = {time.number for time in times if time}
    return [
        replace(column, wave=waves.get(_group_of(column), column.wave))
        for column in columns
        if column.number not in replaced
    ]


def _group_of(column: Column) -> tuple[str, ...]:
    return tuple(path_of(column.heading)[:-1])


def _times_beside(column: Column, columns: Sequence[Column]) -> Column | None:
    """Return the only column of times in the group of a column, None if there is none."""
    group = _group_of(column)
    times = [c for c in columns if _group_of(c) == group and (c.clock or role_of_column(c) == "t")]
    return times[0] if group and len(times) == 1 else None


def _even_wave(name: str, times: Column, reading: ReadOptions) -> tuple[float, float]:
    """Return (beginning, period) [s] of even times. Raises BadRecording."""
    values = np.asarray(times.values, dtype=np.float64)
    step = float(values[-1] - values[0]) / (values.size - 1)
    even = values[0] + step * np.arange(values.size)
    if not step > 0.0 or not np.allclose(values, even, rtol=0.0, atol=WHOLE * step):
        raise BadRecording(
            f"{name}: {describe_column(times)} holds other times than those of the other sheet or "
            f"group, and uneven ones: {_REMEDY}"
        )
    unit = "s" if times.clock else find_unit_key(reading.time_unit) or unit_of_column(times)
    kind, _, factor = UNITS[unit or "s"]
    if kind != TIME or not (unit or step < SURELY_SECONDS):
        raise BadRecording(
            f"{name}: {describe_column(times)} steps by {step:.4g}, and gives no unit of time: add "
            "--time-unit s, ms or us"
        )
    return float(values[0]) * factor, step * factor


def on_common_rows(
    name: str,
    columns: Sequence[Column],
    chosen: Mapping[str, int],
    found: Sheet,
    reading: ReadOptions,
) -> tuple[list[Column], dict[str, int]]:
    """Return (columns, number of the column for each role) such that the values in a row are of the
    same time, and set the period of the sheet. Raises BadRecording if their periods differ, or if
    their beginnings do not differ by a whole number of rows."""
    taken = [columns[i] for i in chosen.values()]
    stated = [(column, *column.wave) for column in taken if column.wave]
    periods = {column.wave[1] for column in columns if column.wave}
    if not stated and len(periods) == 1:  # which column is which is still to be asked for
        found.step_s = found.step_s or periods.pop()
    step_s = _common_period(name, [(column, step) for column, _, step in stated if step])
    if step_s:
        same = not found.step_s or abs(found.step_s - step_s) <= SAME_STEP * step_s
        found.step_s = step_s if same else 0.0
    period = step_s or found.step_s or (1.0 / reading.rate_hz if reading.rate_hz else 0.0)
    begins = {column.number: begin for column, begin, _ in stated}
    early = min(begins.values(), default=0.0)
    if max(begins.values(), default=0.0) - early <= WHOLE * period:
        return list(columns), dict(chosen)
    if "t" in chosen or len(stated) < len(taken):
        raise _different(name, stated, "and the other columns state no beginning")
    if not period:
        raise _different(name, stated, "and no period is stated: add --rate HZ")
    places = {n: (begin - early) / period for n, begin in begins.items()}
    if any(abs(place - round(place)) > WHOLE for place in places.values()):
        raise _different(name, stated, f"no whole number of rows apart ({period:.6g} s a row)")
    lead = round(max(places.values()))
    rows = min(round(places[c.number]) + len(c.values) for c in taken) - lead
    if rows < 2:
        raise _different(name, stated, "and have no times in common")
    needed = {column.number for column in taken}
    kept = [c for c in columns if c.number in needed or _fits(c, early, period, lead, rows)]
    out = []
    for column in kept:
        skip = lead - round(((column.wave or (early, 0.0))[0] - early) / period)
        out.append(replace(column, values=column.values[skip : skip + rows]))
    found.start_s += lead * period
    found.said.append(f"{_starts(stated)}: each at its own time, in the {rows} rows of all of them")
    numbers = [column.number for column in kept]
    if left := [describe_column(c) for c in columns if c.number not in numbers]:
        found.said.append(f"of other times and left out: {', '.join(left[:5])}")
    return out, {role: numbers.index(columns[i].number) for role, i in chosen.items()}


def _common_period(name: str, steps: Sequence[tuple[Column, float]]) -> float:
    """Return the period [s] that columns state, 0 if none does. Raises BadRecording."""
    if not steps:
        return 0.0
    slow, fast = max(steps, key=lambda one: one[1]), min(steps, key=lambda one: one[1])
    if slow[1] > (1.0 + SAME_STEP) * fast[1]:
        raise BadRecording(
            f"{name}: {describe_column(fast[0])} has a row every {fast[1]:.6g} s, "
            f"and {describe_column(slow[0])} every {slow[1]:.6g} s: {_REMEDY}"
        )
    return steps[0][1]


def _fits(column: Column, early: float, period: float, lead: int, rows: int) -> bool:
    """Return whether a column that nobody asked for has a value in each of the common rows."""
    if column.wave is None:
        return False
    place = (column.wave[0] - early) / period
    whole = abs(place - round(place)) <= WHOLE
    same = not column.wave[1] or abs(column.wave[1] - period) <= SAME_STEP * period
    return whole and same and 0 <= lead - round(place) <= len(column.values) - rows


def _starts(stated: Sequence[tuple[Column, float, float]]) -> str:
    first, last = min(stated, key=lambda one: one[1]), max(stated, key=lambda one: one[1])
    return (
        f"{describe_column(first[0])} begins at {first[1]:.12g} s, {describe_column(last[0])} at "
        f"{last[1]:.12g} s"
    )


def _different(name: str, stated: Sequence[tuple[Column, float, float]], why: str) -> BadRecording:
    remedy = "" if why.endswith("--rate HZ") else f": {_REMEDY}"
    return BadRecording(f"{name}: {_starts(stated)}, {why}{remedy}")
