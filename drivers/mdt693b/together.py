"""Several outputs of one MDT693B: what they sustain together, and all three in one command."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from dehyst.drivers.call_times import CallTimes
from dehyst.drivers.mdt693b.link import CommandRefused, Mdt693bLink
from dehyst.drivers.mdt693b.settings import Mdt69xConfig
from dehyst.drivers.mdt693b.tuning import TUNING
from dehyst.drivers.mdt693b.unit_facts import NATIVE

ALL, ASK_ALL = "xyzvoltage={:.3f},{:.3f},{:.3f}", "xyzvoltage?"


class Output(Protocol):
    """What is needed of the driver of one output (driver.py)."""

    config: Mdt69xConfig

    def word(self, name: str, volts: float = 0.0) -> str:
        """A command in this unit's words."""
        ...

    def admit(self, volts: float) -> float:
        """The set-point as it will be written. Raises OutOfRange."""
        ...

    def conversation(self) -> AbstractContextManager[Mdt693bLink]:
        """The link, for this thread alone."""
        ...

    def get_in_step(self, link: Mdt693bLink) -> None:
        """Before a set: what became of the one before."""
        ...

    def trying(self, volts: float | None) -> None:
        """A set goes out whose fate is not known yet; None: it was refused."""
        ...

    def carried_out(self, volts: float) -> None:
        """The unit has acknowledged this set-point."""
        ...


class JointOutputs:
    """A Joint of open outputs. `together`: all three are here and the firmware has XYZVOLTAGE=.

    The rates are measured when it is made, with readings, as those of one output are.
    """

    def __init__(
        self, outputs: Sequence[Output], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._outputs = tuple(sorted(outputs, key=lambda output: output.config.axis))
        self._order = [outputs.index(output) for output in self._outputs]
        self.together = len(outputs) == 3 and self._knows_all()
        reads = [output.word("read") for output in self._outputs]
        self._times = [self._measure(reads[:n], clock) for n in range(1, len(reads) + 1)]
        if self.together:
            self._times[2] = self._measure([ASK_ALL], clock)

    def rate_hz(self, driven: int) -> float:
        """The highest rate of setting so many of the outputs."""
        return TUNING.batches.rate_hz(self._times[driven - 1])

    def late_s(self, driven: int) -> float:
        """What few sets of so many of the outputs take longer than."""
        return TUNING.batches.late_s(self._times[driven - 1])

    def write_all(self, volts: Sequence[float]) -> None:
        """Set all three in one command; volts in the order of the outputs as they were given.
        Raises as Mdt693b.write(), for all of them."""
        first, outputs = self._outputs[0], self._outputs
        admitted = [
            output.admit(volts[place]) for output, place in zip(outputs, self._order, strict=True)
        ]
        with first.conversation() as link:
            for output in outputs:
                output.get_in_step(link)
            for output, volt in zip(outputs, admitted, strict=True):
                output.trying(volt)
            try:
                link.set(ALL.format(*admitted))
            except CommandRefused:
                for output in outputs:
                    output.trying(None)
                raise
            for output, volt in zip(outputs, admitted, strict=True):
                output.carried_out(volt)

    def _knows_all(self) -> bool:
        """Whether the firmware knows the command, by its query."""
        first = self._outputs[0]
        if first.word("limit") != NATIVE["limit"]:
            return False
        try:
            with first.conversation() as link:
                link.ask(ASK_ALL)
        except CommandRefused:
            return False
        return True

    def _measure(self, words: Sequence[str], clock: Callable[[], float]) -> CallTimes:
        """How long these commands take one after the other."""

        def ask() -> None:
            for word in words:
                with self._outputs[0].conversation() as link:
                    link.ask(word)

        return TUNING.batches.best(ask, clock)
