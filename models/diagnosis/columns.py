"""Columns of the base and of the model in use for a drive. For a drive that no effect has changed
they are the same in every fit, whatever the reading and the rows that count, and are cached."""

from collections.abc import Callable, Sequence

from dehyst.models.diagnosis.base import Base
from dehyst.models.diagnosis.effects import Effect, behind_output
from dehyst.models.diagnosis.subject import Subject
from dehyst.models.signals.joined import Data, Floats, Ints


class Columns:
    """Cached columns of one base, one model in use and one drive."""

    def __init__(self, base: Base, subject: Subject) -> None:
        self._base, self._subject = base, subject
        self._kept: dict[str, Floats] = {}

    def of_base(self, data: Data, v: Floats, rows: Ints, effects: Sequence[Effect]) -> Floats:
        """Return (rows, width) the base's columns at some rows, filtered by the model's blocks and
        the effects, for a drive v (M,) on its path that has passed the effects' drive parts."""
        modes = {e.candidate.mode for e in effects}
        carried = self._subject.carries and bool(self._subject.linear_blocks)
        if "output" not in modes and not carried:
            there = rows if data.between is None else data.places[rows]
            return self._base.columns(v, data.path.forgets, there)
        columns = self._kept_or(
            "base",
            "drive" not in modes,
            lambda: self._subject.passed(data.path, self._base.columns(v, data.path.forgets)),
        )
        return data.sampled(behind_output(data.path, effects, columns))[rows]

    def of_model(self, data: Data, v: Floats, unchanged: bool) -> Floats:
        """Return the model's reading (N,) for a drive v (N,). unchanged: no effect has changed the
        drive. Read-only."""
        return self._kept_or("model", unchanged, lambda: self._subject.reading(data, v))

    def _kept_or(self, name: str, unchanged: bool, make: Callable[[], Floats]) -> Floats:
        if unchanged and name not in self._kept:
            self._kept[name] = make()
        return self._kept[name] if unchanged else make()
