"""Several outputs of one MDT693B: their joint rate, and setting all three with one command."""

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
    """What JointOutputs needs from the driver of one output (driver.py)."""

    config: Mdt69xConfig

    def word(self, name: str, volts: float = 0.0) -> str:
        """Return a command in this unit's dialect."""
        ...

    def admit(self, volts: float) -> float:
        """Return the set-point as it will be written. Raises OutOfRange."""
        ...

    def conversation(self) -> AbstractContextManager[Mdt693bLink]:
        """Yield the link, reserved for this thread."""
        ...

    def get_in_step(self, link: Mdt693bLink) -> None:
        """Before a set, find out what happened to the previous one."""
        ...

    def trying(self, volts: float | None) -> None:
        """Note that a set is sent whose outcome is not known yet; None: it was refused."""
        ...

    def carried_out(self, volts: float) -> None:
        """Note that the unit has acknowledged this set-point."""
        ...


class JointOutputs:
    """A Joint of open outputs. `together`: it has all three and the firmware knows XYZVOLTAGE=.

    The constructor measures the rates with readings, as for a single output.
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
        """Return the highest rate at which this number of outputs can be set."""
        return TUNING.batches.rate_hz(self._times[driven - 1])

    def late_s(self, driven: int) -> float:
        """Return the time that few sets of this number of outputs exceed."""
        return TUNING.batches.late_s(self._times[driven - 1])

    def write_all(self, volts: Sequence[float]) -> None:
        """Set all three with one command; volts in the order in which the outputs were given.
        Raises as Mdt693b.write() does, for all of them together."""
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
        """Return whether the firmware knows the command; its query shows that."""
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
        """Measure how long these commands take one after the other."""

        def ask() -> None:
            for word in words:
                with self._outputs[0].conversation() as link:
                    link.ask(word)

        return TUNING.batches.best(ask, clock)
