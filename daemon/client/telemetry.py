"""Receives telemetry (without gaps where possible), status, events and refusals for a client."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import DoctorReport, Event, Rejection, Status, TelemetryBatch
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.bus.topics import DOCTOR, EVENT, REJECTION, STATUS, subject
from dehyst.daemon.bus.topics import TELEMETRY as TELEMETRY_TOPIC
from dehyst.daemon.rings.records import TELEMETRY

WAITING_BATCHES = 2048  # unread ones that are kept: 40 s at the default of 20 ms a batch
NOTHING: NDArray[Any] = np.zeros(0, TELEMETRY)


class TelemetryStream:
    """Delivers every sample once and in order.

    A gap in the sequence numbers (a slow reader, a restarted gateway) is filled from the daemon's
    history; samples that are no longer there are counted in `lost` and remain a gap. `run` changes
    when the loop is restarted; sequence numbers then begin at 0 again.
    """

    def __init__(self, bus: Bus, keys: Keys, history: Callable[..., NDArray[Any]]) -> None:
        self._bus, self._history = bus, history
        self._waiting: deque[bytes] = deque(maxlen=WAITING_BATCHES)
        self._arrived = threading.Event()
        self.run = 0
        self.next_seq = -1  # -1: nothing has arrived yet
        self.lost = 0
        self.recovered = 0
        self.bad = 0
        self.unit = ""
        self.wall_offset_ns = 0
        self.close = bus.listen(keys.pubsub(subject(TELEMETRY_TOPIC)), self._store)

    def _store(self, _key: str, payload: bytes) -> None:
        self._waiting.append(payload)
        self._arrived.set()

    def read(self, timeout_s: float = 0.0) -> NDArray[Any]:
        """Return the (n,) TELEMETRY records of one run that have arrived; wait up to timeout_s for
        the first batch."""
        self._bus.check_process()
        parts: list[NDArray[Any]] = []
        deadline_ns = clock.monotonic_ns() + round(timeout_s * 1e9)
        while True:
            self._arrived.clear()
            while self._waiting:
                if parts and self._run_of_next() != self.run:
                    return np.concatenate(parts)
                parts.extend(self._take(self._waiting.popleft()))
            left_s = (deadline_ns - clock.monotonic_ns()) * 1e-9
            if parts or left_s <= 0:
                return np.concatenate(parts) if parts else NOTHING
            self._arrived.wait(left_s)

    def _run_of_next(self) -> int:
        try:
            return int(encoding.decode(TelemetryBatch, self._waiting[0]).run)
        except encoding.BadMessage:
            return self.run

    def _take(self, payload: bytes) -> list[NDArray[Any]]:
        try:
            message = encoding.decode(TelemetryBatch, payload)
            samples = encoding.samples(message)
        except encoding.BadMessage:
            self.bad += 1
            return []
        if not samples.size:
            return []
        self.unit, self.wall_offset_ns = message.unit, message.wall_offset_ns
        if message.run != self.run:
            self.run, self.next_seq = message.run, -1
        samples = samples[samples["seq"] >= self.next_seq]
        if not samples.size:
            return []
        parts = []
        first = int(samples["seq"][0])
        if 0 <= self.next_seq < first:
            missing = self._missing(first)
            self.recovered += missing.size
            self.lost += first - self.next_seq - missing.size
            parts.append(missing)
        self.next_seq = int(samples["seq"][-1]) + 1
        return [*parts, samples]

    def _missing(self, end: int) -> NDArray[Any]:
        try:
            missing = self._history(first_seq=self.next_seq, end_seq=end, run=self.run)
        except BusError:
            return NOTHING
        return missing[(missing["seq"] >= self.next_seq) & (missing["seq"] < end)]


class StatusFeed:
    """Holds the newest status (None: none has arrived yet) and the newest events, refusals and
    doctor reports."""

    def __init__(self, bus: Bus, keys: Keys) -> None:
        self.status: Status | None = None
        self.status_at_ns = 0
        self.bad = 0  # messages that could not be decoded in this version
        self.events: deque[Event] = deque(maxlen=256)
        self.rejections: deque[Rejection] = deque(maxlen=256)
        self.doctor: deque[DoctorReport] = deque(maxlen=64)
        self._ends = [
            bus.listen(keys.pubsub(subject(STATUS)), self._on_status),
            bus.listen(keys.pubsub(subject(EVENT)), self._on_event),
            bus.listen(keys.pubsub(subject(REJECTION)), self._on_rejection),
            bus.listen(keys.pubsub(subject(DOCTOR)), self._on_doctor),
        ]

    def close(self) -> None:
        """Stop listening."""
        for end in self._ends:
            end()

    def _on_status(self, _key: str, payload: bytes) -> None:
        try:
            self.status = encoding.decode(Status, payload)
        except encoding.BadMessage:
            self.bad += 1
        else:
            self.status_at_ns = clock.monotonic_ns()

    def _on_event(self, _key: str, payload: bytes) -> None:
        try:
            self.events.append(encoding.decode(Event, payload))
        except encoding.BadMessage:
            self.bad += 1

    def _on_rejection(self, _key: str, payload: bytes) -> None:
        try:
            self.rejections.append(encoding.decode(Rejection, payload))
        except encoding.BadMessage:
            self.bad += 1

    def _on_doctor(self, _key: str, payload: bytes) -> None:
        try:
            self.doctor.append(encoding.decode(DoctorReport, payload))
        except encoding.BadMessage:
            self.bad += 1
