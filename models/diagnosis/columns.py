"""What a drive makes of the base and of the model in use. For a drive that no effect has changed it
is the same in every fit, whatever the reading and the rows that count, and kept."""

from dehyst.models.diagnosis.base import Base
from dehyst.models.diagnosis.subject import Subject
from dehyst.models.signals.joined import Data, Floats


class Columns:
    """Of one base, one model in use and one drive."""

    def __init__(self, base: Base, subject: Subject) -> None:
        self._base, self._subject = base, subject
        self._kept: dict[str, Floats] = {}

    def of_base(self, data: Data, v: Floats, unchanged: bool) -> Floats:
        """(N, width) the base's columns behind the model's blocks. unchanged: no effect has changed
        the drive v (N,). Not to be written to."""
        if unchanged and "base" in self._kept:
            return self._kept["base"]
        columns = self._subject.passed(data, self._base.columns(v, data.forgets))
        if unchanged:
            self._kept["base"] = columns
        return columns

    def of_model(self, data: Data, v: Floats, unchanged: bool) -> Floats:
        """(N,) the model's reading, the same way."""
        if unchanged and "model" in self._kept:
            return self._kept["model"]
        reading = self._subject.reading(data, v)
        if unchanged:
            self._kept["model"] = reading
        return reading
