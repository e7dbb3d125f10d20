"""Common parts of the emulated APT units: requests and replies with their times and faults."""

import random
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Annotated

from msgspec import Meta, structs

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import AptMessage, Decoder, encode_apt
from dehyst.drivers.settings import Settings


class AptKnobs(Settings, frozen=True):
    """Properties that every such unit has."""

    driver = "emulated APT unit"

    serial_number: Annotated[int, Meta(ge=0, description="serial number that the unit reports")] = 0
    model: Annotated[str, Meta(max_length=8, description="model that the unit reports")] = ""
    latency_s: Annotated[float, Meta(ge=0, description="delay of each message, in sequence")] = (
        0.0002
    )
    chunk_size: Annotated[int, Meta(ge=0, description="bytes per write; 0: whole")] = 0
    seed: Annotated[int, Meta(description="seed of the garbage")] = 0


class AptFaults(Settings, frozen=True):
    """Faults that every such unit can have at run time."""

    driver = "emulated APT unit's faults"

    mute: Annotated[bool, Meta(description="no replies")] = False
    delay_s: Annotated[float, Meta(ge=0, description="delay added to each reply")] = 0.0
    garbage: Annotated[
        int, Meta(ge=0, description="number of replies preceded by random bytes")
    ] = 0


class AptUnit(ABC):
    """An emulated APT unit; a PtyUnit. A subclass answers its kind's messages."""

    knobs: AptKnobs
    faults: AptFaults
    notes = b"emulated unit"
    addresses: tuple[int, ...] = (codec.UNIT,)

    def __init__(self, knobs: AptKnobs, faults: AptFaults, clock: Callable[[], float]) -> None:
        self.knobs = knobs
        self.faults = faults
        self._clock = clock
        self._decoder = Decoder(self.addresses, (codec.HOST,))
        self._random = random.Random(knobs.seed)
        self._requests: deque[tuple[float, AptMessage]] = deque()
        self._outgoing: deque[tuple[float, bytes]] = deque()
        self._busy_until_s = 0.0

    def feed(self, data: bytes) -> None:
        """Take bytes from the host that arrive now; the unit handles one message after another."""
        for message in self._decoder.feed(data):
            self._busy_until_s = max(self._busy_until_s, self._clock()) + self.knobs.latency_s
            self._requests.append((self._busy_until_s, message))

    def take(self) -> bytes:
        """Carry out the requests that are due; return the next bytes due by now."""
        now = self._clock()
        while self._requests and self._requests[0][0] <= now:
            due, message = self._requests.popleft()
            reply = self.answer(message, due)
            if reply and not self.faults.mute:
                self._send(reply, due + self.faults.delay_s)
        if self._outgoing and self._outgoing[0][0] <= now:
            return self._outgoing.popleft()[1]
        return b""

    def next_due_s(self) -> float | None:
        """Return the clock time at which take() next has something."""
        due = [queue[0][0] for queue in (self._requests,) if queue]
        due += [queue[0][0] for queue in (self._outgoing,) if queue]
        return min(due, default=None)

    def link_lost(self) -> None:
        """Handle a pulled cable; the unit keeps what was set."""
        self._decoder.reset()
        self._requests.clear()
        self._outgoing.clear()

    def set_serial_number(self, number: int) -> None:
        """Report the serial number of a different unit at the same port."""
        self.knobs = structs.replace(self.knobs, serial_number=number)

    def answer(self, message: AptMessage, now: float) -> bytes:
        """Return the reply to a message due at `now`, ignoring faults; b"": none."""
        own = message.name == "hw_req_info" and message.destination == self.addresses[0]
        return self._info() if own else self._answer(message, now)

    @abstractmethod
    def _answer(self, message: AptMessage, now: float) -> bytes:
        """Carry out a message that was due at `now`; return its reply, if it has one."""

    def _send(self, reply: bytes, due_s: float) -> None:
        if self.faults.garbage > 0:
            self.faults = structs.replace(self.faults, garbage=self.faults.garbage - 1)
            reply = self._random.randbytes(7) + reply
        size = self.knobs.chunk_size or len(reply)
        for start in range(0, len(reply), size):
            self._outgoing.append((due_s, reply[start : start + size]))

    def _info(self) -> bytes:
        return self._reply(
            "hw_get_info",
            serial_number=self.knobs.serial_number,
            model=self.knobs.model.encode()[:8],
            type=3,
            firmware=bytes([3, 0, 1, 0]),  # minor, interim, major
            notes=self.notes,
            hardware_version=1,
            modification=0,
            channels=1,
        )

    def _reply(self, name: str, **values: object) -> bytes:
        return encode_apt(name, source=self.addresses[0], destination=codec.HOST, **values)
