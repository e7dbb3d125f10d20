"""Queries to a daemon that command nothing: the part of a Client that needs no lease."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import (
    DoctorReport,
    DoctorReports,
    Event,
    HistoryRequest,
    RecentEvents,
    Status,
    TelemetryBatch,
)
from dehyst.daemon.bus.session import Bus, Nobody
from dehyst.daemon.called import python_function
from dehyst.daemon.client.finding import TIMEOUT_S
from dehyst.daemon.client.telemetry import StatusFeed, TelemetryStream
from dehyst.daemon.closing import Closing
from dehyst.daemon.config import Config, parse_config
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.status import is_starting
from dehyst.models.errors import NotNow
from dehyst.models.model import Model
from dehyst.models.modelfile import loads

PATIENCE_S = 2.0  # for a gateway that is being restarted
LONGEST_START_S = 300.0
"""The first start compiles for one to three minutes."""


class DaemonQueries(Closing):
    """Queries one daemon. bus, keys: the connection and the daemon's keys on it; patience_s: how
    long to retry while it does not answer, as it may be starting."""

    def _connected(self, bus: Bus, keys: Keys) -> None:
        self.bus, self.keys = bus, keys
        self.patience_s = PATIENCE_S
        self._unit = ""

    @property
    def name(self) -> str:
        """Return the daemon's name."""
        return self.keys.name

    @property
    def unit(self) -> str:
        """Return the daemon's displacement unit."""
        self._unit = self._unit or self.status().unit
        return self._unit

    def status(self) -> Status:
        """Return the daemon's present status. Raises BusError if nothing answers."""
        status: Status = encoding.decode(Status, self._one("status"))
        return status

    @python_function
    def wait_until_started(
        self, timeout_s: float = LONGEST_START_S, on_wait: Callable[[str], None] = lambda _: None
    ) -> Status:
        """Return the status once the daemon has started: at once, or when its kernels are compiled
        and its devices open. on_wait(message) is called once if it has to wait. Raises NotNow if
        the start takes longer than timeout_s, BusError if the daemon is gone."""
        end_ns = clock.monotonic_ns() + round(timeout_s * clock.NS)
        status = self.status()
        if is_starting(status):
            on_wait(f"{self.name} is starting; waiting until it is ready")
        while is_starting(status):
            if clock.monotonic_ns() > end_ns:
                raise NotNow(f"{self.name} is still starting after {timeout_s:g} s; see its log")
            clock.sleep_s(0.1)
            status = self.status()
        return status

    def model(self) -> Model:
        """Return the model that the daemon runs."""
        return loads(self._one("model").decode("utf-8"))

    def config(self) -> Config:
        """Return the configuration that the daemon runs, including defaults."""
        text = self._one("configuration").decode("utf-8")
        return parse_config(text, "the daemon's configuration")

    def doctor(self) -> tuple[DoctorReport, ...]:
        """Return the doctor's reports on the latest mismatches, newest last."""
        found: DoctorReports = encoding.decode(DoctorReports, self._one("doctor"))
        return found.reports

    def doctor_page(self, case: str = "") -> bytes:
        """Return the doctor's report on a case as HTML; "": the newest."""
        return self._one("report", case.encode())

    def history(
        self, seconds: float = 0.0, first_seq: int = 0, end_seq: int = 2**62, run: int = 0
    ) -> NDArray[Any]:
        """Return samples from the daemon's history as (n,) TELEMETRY records, ascending: those of
        the last `seconds`, or first_seq <= seq < end_seq. Samples no longer kept are missing."""
        question = HistoryRequest(first_seq=first_seq, end_seq=end_seq, seconds=seconds, run=run)
        answers = self.bus.ask(self.keys.rpc("history"), encoding.encode(question), 10.0, long=True)
        parts = [encoding.samples(encoding.decode(TelemetryBatch, answer)) for answer in answers]
        samples = np.concatenate(parts) if parts else np.zeros(0, TELEMETRY)
        samples.sort(order="seq")
        return samples

    def events(self) -> tuple[Event, ...]:
        """Return the latest events that the daemon has kept, oldest first."""
        recent: RecentEvents = encoding.decode(RecentEvents, self._one("events"))
        return recent.events

    def stream(self) -> TelemetryStream:
        """Return a telemetry stream: `read()` gives what has arrived; see also `lost` and `run`."""
        return TelemetryStream(self.bus, self.keys, self.history)

    def telemetry(self) -> Iterator[NDArray[Any]]:
        """Yield every sample from now on in batches of (n,) TELEMETRY records. Samples that did not
        arrive are fetched from the daemon's history; those that are gone leave a gap in `seq`."""
        stream = self.stream()
        while True:
            samples = stream.read(1.0)
            if samples.size:
                yield samples

    def feed(self) -> StatusFeed:
        """Return a feed of what the daemon publishes: newest status, events, refusals."""
        return StatusFeed(self.bus, self.keys)

    def _one(self, method: str, payload: bytes = b"", timeout_s: float = TIMEOUT_S) -> bytes:
        """Return one answer; retry for patience_s while the gateway is restarting."""
        deadline_ns = clock.monotonic_ns() + round(self.patience_s * 1e9)
        while True:
            try:
                return next(iter(self.bus.ask(self.keys.rpc(method), payload, timeout_s)))
            except Nobody:
                if clock.monotonic_ns() > deadline_ns:
                    raise
            clock.sleep_s(0.05)
