"""Refuse text in which the channels stand one below the other, in rows of their own."""

import re
from collections.abc import Sequence

from dehyst.daemon.files.foreign.headings import Row, texts_of
from dehyst.models.errors import BadRecording

MOST_CHANNELS, LEAST_ROUNDS = 64, 3
_A_COLUMN_EACH = "write each channel to a column of its own, next to one column of times"


def refuse_long(
    name: str, rows: Sequence[Row], numeric: Sequence[bool], headings: Sequence[str]
) -> None:
    """Raise BadRecording if a column of texts names the same channels in turn, at one time each:
    "0.0,drive,50.1", "0.0,sensor,3.2"."""
    for j in (j for j, is_number in enumerate(numeric) if not is_number):
        texts = [texts_of(row[j : j + 1]) for row in rows if len(row) > j]
        turn = next((k for k in range(1, len(texts)) if texts[k] == texts[0]), len(texts))
        many = 1 < turn <= MOST_CHANNELS and len(texts) >= LEAST_ROUNDS * turn
        in_turn = many and all(text == texts[i % turn] for i, text in enumerate(texts))
        if in_turn and any(
            _at_one_time(rows, k, turn) for k, number in enumerate(numeric) if number
        ):
            them = ", ".join(repr(text) for of in texts[: min(turn, 4)] for text in of)
            raise BadRecording(
                f"{name}: {headings[j] or f'column {j}'} names the channel of each row in turn "
                f"({them}): {_A_COLUMN_EACH}"
            )


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
