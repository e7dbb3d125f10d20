"""Columns of the base and of the model in use for a drive. For a drive that no effect has changed
they are the same in every fit, whatever the reading and the rows that count, and are cached."""

from collections.abc import Callable, Sequence

from dehyst.models.diagnosis.base import Base
from dehyst.models.diagnosis.diagnosed_model import DiagnosedModel
from dehyst.models.diagnosis.effects import Effect, apply_output_effects
from dehyst.models.signals.joined import Data, Floats, Ints


class Columns:
    """Cached columns of one base, one model in use and one drive."""

    def __init__(self, base: Base, diagnosed: DiagnosedModel) -> None:
        self._base, self._diagnosed = base, diagnosed
        self._kept: dict[str, Floats] = {}

    def of_base(self, data: Data, v: Floats, rows: Ints, effects: Sequence[Effect]) -> Floats:
        """Return (rows, width) the base's columns at some rows, filtered by the model's blocks and
        the effects, for a drive v (M,) on its path that has passed the effects' drive parts."""
        modes = {e.candidate.mode for e in effects}
        carried = self._diagnosed.carries and bool(self._diagnosed.linear_blocks)
        if "output" not in modes and not carried:
            there = rows if data.between is None else data.places[rows]
            return self._base.columns(v, data.path.forgets, there)
        columns = self._kept_or(
            "base",
            "drive" not in modes,
            lambda: self._diagnosed.apply_linear_blocks(
                data.path, self._base.columns(v, data.path.forgets)
            ),
        )
        return data.sampled(apply_output_effects(data.path, effects, columns))[rows]

    def of_model(self, data: Data, v: Floats, unchanged: bool) -> Floats:
        """Return the model's reading (N,) for a drive v (N,). unchanged: no effect has changed the
        drive. Read-only."""
        return self._kept_or("model", unchanged, lambda: self._diagnosed.reading(data, v))

    def _kept_or(self, name: str, unchanged: bool, make: Callable[[], Floats]) -> Floats:
        if unchanged and name not in self._kept:
            self._kept[name] = make()
        return self._kept[name] if unchanged else make()
