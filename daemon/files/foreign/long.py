"""Refuse files in which the channels stand one below the other, in rows of their own."""

import re
from collections.abc import Sequence

from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.headings import Row, texts_of
from dehyst.daemon.files.foreign.roles import role_of, role_of_column
from dehyst.models.errors import BadRecording

MOST_CHANNELS, LEAST_ROUNDS = 64, 3
_A_COLUMN_EACH = "write each channel to a column of its own, next to one column of times"
_BY_FLUX = ' (in Flux: pivot(rowKey: ["_time"], columnKey: ["_field"], valueColumn: "_value"))'
_ANNOTATIONS = (["#datatype"], ["#group"], ["#default"])
_LINES_OF_ANNOTATIONS = len(_ANNOTATIONS)  # above the names


def refuse_long(
    name: str, rows: Sequence[Row], numeric: Sequence[bool], headings: Sequence[str]
) -> None:
    """Raise BadRecording if a column of texts names the same channels in turn, at one time each
    ("0.0,drive,50.1", "0.0,sensor,3.2"), or names the channel whose value is in another column."""
    own = {role_of(heading, "")[0] for heading in headings}
    valued = not {"u", "y"} <= own and "value" in {h.strip("_").lower() for h in headings}
    for j in (j for j, is_number in enumerate(numeric) if not is_number):
        texts = [" ".join(texts_of(row[j : j + 1])) for row in rows if len(row) > j]
        turn = next((k for k in range(1, len(texts)) if texts[k] == texts[0]), len(texts))
        many = 1 < turn <= MOST_CHANNELS and len(texts) >= LEAST_ROUNDS * turn
        in_turn = many and all(text == texts[i % turn] for i, text in enumerate(texts))
        in_turn = in_turn and any(
            _at_one_time(rows, k, turn) for k, number in enumerate(numeric) if number
        )
        channels = list(dict.fromkeys(texts))[:MOST_CHANNELS]
        if in_turn or (valued and all(role_of(text, "")[0] for text in channels)):
            where, by = headings[j] or f"column {j}", _BY_FLUX if headings[j] == "_field" else ""
            how = " in turn" if in_turn else ""
            raise BadRecording(f"{name}: {_name_channels_of_rows(where, channels, how)}{by}")


def _name_channels_of_rows(where: str, channels: Sequence[str], how: str = "") -> str:
    them = ", ".join(repr(channel) for channel in channels[:4])
    return f"{where} names the channel of each row{how} ({them}): {_A_COLUMN_EACH}"


def describe_channel_rows(name: str, texts: Sequence[str], columns: Sequence[Column]) -> str:
    """Return why an array of texts next to columns of its length shows that each row has one value,
    "" if it does not: it names a drive and a displacement, which no column does."""
    channels = list(dict.fromkeys(texts))[: MOST_CHANNELS + 1]
    beside = [role_of_column(c) for c in columns if c.values.size == len(texts)]
    named = {role_of(channel, "")[0] for channel in channels}
    repeated = LEAST_ROUNDS * len(channels) <= len(texts) and len(channels) <= MOST_CHANNELS
    if not (beside and repeated and {"u", "y"} <= named) or {"u", "y"} <= set(beside):
        return ""
    return _name_channels_of_rows(name, channels)


def without_annotations(name: str, rows: Sequence[Row]) -> Sequence[Row]:
    """Return the rows with those empty that InfluxDB writes above the names of a table. Raise
    BadRecording if that table has a row for each value."""
    above = rows[:_LINES_OF_ANNOTATIONS]
    marks = [i for i, row in enumerate(above) if texts_of(row[:1])[:1] in _ANNOTATIONS]
    if ["#datatype"] not in [texts_of(row[:1]) for row in above]:
        return rows
    if any("_value" in texts_of(row) for row in rows[: _LINES_OF_ANNOTATIONS + 1]):
        raise BadRecording(
            f"{name} is InfluxDB's annotated CSV, with a row for each value: {_A_COLUMN_EACH}"
            f"{_BY_FLUX}"
        )
    return [[] if i in marks else row for i, row in enumerate(rows)]


def _at_one_time(rows: Sequence[Row], j: int, turn: int) -> bool:
    """Return whether column j changes from round to round, and in none of them."""
    values = [str(row[j]) if len(row) > j else "" for row in rows]
    rounds = [values[i : i + turn] for i in range(0, len(values), turn)]
    return all(len(set(one)) == 1 for one in rounds) and values[0] != values[turn]


def refuse_next_variable(name: str, line: str, place: str) -> None:
    """Raise BadRecording at a line between the numbers that begins the next variable, as Octave
    writes them one below the other."""
    if re.match(r"\s*[#%]\s*name:\s*\S", line):
        raise BadRecording(f"{name}: {place} begins another variable: {_A_COLUMN_EACH}")
