"""What a daemon can be asked without commanding it: the part of a Client that needs no lease."""

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
from dehyst.daemon.client.finding import TIMEOUT_S
from dehyst.daemon.client.telemetry import StatusFeed, TelemetryStream
from dehyst.daemon.closing import Closing
from dehyst.daemon.config import Config, parse_config
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.status import is_starting
from dehyst.models.errors import NotNow
from dehyst.models.model import Model
from dehyst.models.modelfile import loads

PATIENCE_S = 2.0
LONGEST_START_S = 300.0
"""A first start compiles for one to three minutes."""


class DaemonQueries(Closing):
    """Asks one daemon. bus, keys: the connection, and the daemon's keys in it; patience_s: how long
    one that does not answer is asked again, it may be starting."""

    def _connected(self, bus: Bus, keys: Keys) -> None:
        self.bus, self.keys = bus, keys
        self.patience_s = PATIENCE_S
        self._unit = ""

    @property
    def name(self) -> str:
        """The daemon's name."""
        return self.keys.name

    @property
    def unit(self) -> str:
        """The daemon's displacement unit."""
        self._unit = self._unit or self.status().unit
        return self._unit

    def status(self) -> Status:
        """The daemon's present status. Raises BusError where nobody answers."""
        status: Status = encoding.decode(Status, self._one("status"))
        return status

    def wait_until_started(
        self, timeout_s: float = LONGEST_START_S, on_wait: Callable[[str], None] = lambda _: None
    ) -> Status:
        """The status once the daemon's start is over: at once, or when its kernels are compiled and
        its devices opened. on_wait(words) is called once where it has to wait. Raises NotNow where
        the start takes longer than timeout_s, BusError where the daemon is gone."""
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
        """The model that the daemon runs."""
        return loads(self._one("model").decode("utf-8"))

    def config(self) -> Config:
        """The configuration that the daemon runs, defaults included."""
        text = self._one("configuration").decode("utf-8")
        return parse_config(text, "the daemon's configuration")

    def doctor(self) -> tuple[DoctorReport, ...]:
        """What the doctor found about the newest mismatches, the newest last."""
        found: DoctorReports = encoding.decode(DoctorReports, self._one("doctor"))
        return found.reports

    def doctor_page(self, case: str = "") -> bytes:
        """The doctor's report on a case as HTML; "": the newest."""
        return self._one("report", case.encode())

    def history(
        self, seconds: float = 0.0, first_seq: int = 0, end_seq: int = 2**62, run: int = 0
    ) -> NDArray[Any]:
        """Samples that the daemon still has, as (n,) TELEMETRY records, ascending: the last so
        many seconds, or first_seq <= seq < end_seq. Fewer where they are not kept any more."""
        question = HistoryRequest(first_seq=first_seq, end_seq=end_seq, seconds=seconds, run=run)
        answers = self.bus.ask(self.keys.rpc("history"), encoding.encode(question), 10.0, long=True)
        parts = [encoding.samples(encoding.decode(TelemetryBatch, answer)) for answer in answers]
        samples = np.concatenate(parts) if parts else np.zeros(0, TELEMETRY)
        samples.sort(order="seq")
        return samples

    def events(self) -> tuple[Event, ...]:
        """The newest events that the daemon still knows, oldest first."""
        recent: RecentEvents = encoding.decode(RecentEvents, self._one("events"))
        return recent.events

    def stream(self) -> TelemetryStream:
        """A telemetry stream: `read()` what has arrived, `lost`, `run`."""
        return TelemetryStream(self.bus, self.keys, self.history)

    def telemetry(self) -> Iterator[NDArray[Any]]:
        """Batches of every sample from now on, as (n,) TELEMETRY records. Samples that did not
        arrive are fetched from the daemon's history; what is gone is a gap in `seq`."""
        stream = self.stream()
        while True:
            samples = stream.read(1.0)
            if samples.size:
                yield samples

    def feed(self) -> StatusFeed:
        """What the daemon tells: newest status, events, refusals."""
        return StatusFeed(self.bus, self.keys)

    def _one(self, method: str, payload: bytes = b"", timeout_s: float = TIMEOUT_S) -> bytes:
        """One answer; a gateway that is just starting again is waited for."""
        deadline_ns = clock.monotonic_ns() + round(self.patience_s * 1e9)
        while True:
            try:
                return next(iter(self.bus.ask(self.keys.rpc(method), payload, timeout_s)))
            except Nobody:
                if clock.monotonic_ns() > deadline_ns:
                    raise
            clock.sleep_s(0.05)
