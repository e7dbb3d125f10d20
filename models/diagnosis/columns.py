"""What a drive makes of the base and of the model in use. For a drive that no effect has changed it
is the same in every fit, whatever the reading and the rows that count, and kept."""

from collections.abc import Callable, Sequence

from dehyst.models.diagnosis.base import Base
from dehyst.models.diagnosis.effects import Effect, behind_output
from dehyst.models.diagnosis.subject import Subject
from dehyst.models.signals.joined import Data, Floats, Ints


class Columns:
    """Of one base, one model in use and one drive."""

    def __init__(self, base: Base, subject: Subject) -> None:
        self._base, self._subject = base, subject
        self._kept: dict[str, Floats] = {}

    def of_base(self, data: Data, v: Floats, rows: Ints, effects: Sequence[Effect]) -> Floats:
        """(rows, width) the base's columns behind the model's blocks and the effects, for a drive
        v (M,) on its path that has passed the effects' drive parts; on some rows."""
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
        """(N,) the model's reading for a drive v (N,). unchanged: no effect has changed it. Not to
        be written to."""
        return self._kept_or("model", unchanged, lambda: self._subject.reading(data, v))

    def _kept_or(self, name: str, unchanged: bool, make: Callable[[], Floats]) -> Floats:
        if unchanged and name not in self._kept:
            self._kept[name] = make()
        return self._kept[name] if unchanged else make()
