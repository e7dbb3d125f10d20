"""Find the controllers on the bus that the page shows, and follow each in a separate thread.

A thread reads new data ten times a second and keeps them for all browsers: buckets for the plots,
the histogram of wake-ups, status, events, the model. It sends no commands except `stop` and
`release`, which need no lease and are open to everyone who may command, and decisions on offers.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import DoctorReport, Event, Rejection, Status
from dehyst.daemon.bus.security import client_settings
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.finding import daemons
from dehyst.daemon.client.offer_change import cuts_trajectory
from dehyst.daemon.config import Config
from dehyst.daemon.page.buckets import Buckets
from dehyst.daemon.page.trail import Trail
from dehyst.daemon.page.wakeups import Wakeups
from dehyst.models.errors import DehystError
from dehyst.models.model import Model

log = logging.getLogger(__name__)
TICK_S = 0.1  # interval at which telemetry is taken and browsers are served
SILENT_S = 3.0
"""Without a status for this long, a controller counts as silent (page.js draws it by the same)."""
FIND_S = 2.0  # between two searches for controllers
MOST_CONTROLLERS = 64  # limits threads and memory
EVENTS, HEALTHS, REPORTS = 200, 600, 10  # newest ones kept; healths of the last ten minutes
PAST_SAMPLES, PAST_S = 60_000, 60.0
"""Limits of what is fetched from the daemon's history, so that the page does not start empty."""
MODEL_S = 10.0  # a reload of model or configuration is seen after this at most
CLOSE_S = 5.0


def note_health(healths: deque[tuple[float, float]], status: Status) -> None:
    """Append (wall clock [s], health) to `healths`, if new. The time is 0 until the loop has
    reported once, and does not change while the loop is silent."""
    at_s = status.wall_ns * 1e-9
    if at_s > 0.0 and not (healths and healths[-1][0] == at_s):
        healths.append((at_s, status.gateway.health))


class Watch:
    """Follow one controller. `status`, `config`, `model`: None until received; problem: why."""

    def __init__(self, address: str, base: str, name: str, credentials: str) -> None:
        self.address, self.base, self.name, self.credentials = address, base, name, credentials
        self.buckets, self.wakeups, self.trail = Buckets(), Wakeups(), Trail()
        self.lock = threading.Lock()
        self.status: Status | None = None
        self.status_at_ns = 0
        self.config: Config | None = None
        self.model: Model | None = None
        self.newest: Any = None
        self.problem = "no answer yet"
        self.lost = 0
        self.wall_offset_ns = 0
        self.events: deque[tuple[int, dict[str, Any]]] = deque(maxlen=EVENTS)
        self.healths: deque[tuple[float, float]] = deque(maxlen=HEALTHS)
        self.doctor: dict[str, DoctorReport] = {}  # by case, oldest first
        self.changes = 0  # number of changes of model and configuration
        self.findings = 0  # number of changes of the doctor's reports
        self._heard = 0
        self._errors: deque[tuple[float, float, int]] = deque(maxlen=round(1.0 / TICK_S))
        self._client: Client | None = None
        self._stop = threading.Event()
        self.thread = threading.Thread(target=self._run, name=f"watch {name}", daemon=True)
        self.thread.start()

    def close(self) -> None:
        """Ask the thread to end the connection."""
        self._stop.set()

    @property
    def silent(self) -> bool:
        """Return whether the controller has not reported for longer than SILENT_S."""
        return self.silent_s > SILENT_S

    @property
    def silent_s(self) -> float:
        """Time since the last status [s]."""
        return (clock.monotonic_ns() - self.status_at_ns) / clock.NS if self.status_at_ns else 1e9

    def error(self) -> tuple[float, float]:
        """Return (rms, largest) of measured minus target over the last second; NaN without one."""
        parts = list(self._errors)
        count = sum(n for _, _, n in parts)
        if not count:
            return float("nan"), float("nan")
        return float(np.sqrt(sum(s for s, _, _ in parts) / count)), max(m for _, m, _ in parts)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of all axes of the controller; empty if it has only one."""
        return self.status.gateway.axes if self.status is not None else ()

    @property
    def axis(self) -> str:
        """Short name of this axis, such as x; empty if it is the only one."""
        if self.status is None or len(self.axes) < 2:
            return ""
        return self.name.removeprefix(f"{self.status.gateway.controller}-")

    def stop(self, at_once: bool) -> None:
        """Drop all targets of all axes of this controller: hold, then ramp; at_once: ramp now.
        Raises BusError, Refusal."""
        client = self._client
        if client is None:
            raise BusError(f"{self.name} cannot be reached: {self.problem}")
        client.release(self.axes) if at_once else client.stop(self.axes)

    def decide_offer(self, action: Literal["accept", "reject"], number: int) -> None:
        """Accept or reject an offer of the doctor. Raises BusError, Refusal."""
        if self._client is None:
            raise BusError(f"{self.name} cannot be reached: {self.problem}")
        self._client.decide_offer(action, number)

    def is_cut_by(self, number: int) -> bool:
        """Return whether the playing trajectory may leave the reach of the offered model."""
        offers = [one.offer for one in self.doctor.values() if one.offer is not None]
        status = self.status
        return status is not None and any(
            offer.number == number and cuts_trajectory(offer, status) for offer in offers
        )

    def doctor_page(self, case: str) -> bytes:
        """Return the doctor's report on a case. Raises BusError."""
        if self._client is None:
            raise BusError(f"{self.name} cannot be reached: {self.problem}")
        return self._client.doctor_page(case)

    # -- the thread -----------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                with Client(
                    self.name, self.address, self.base, "the page", self.credentials
                ) as client:
                    # commands wait for a gateway that restarts; the thread that follows does not
                    self._client = Client.of_axis(
                        client.bus, client.keys, client.label, client.client
                    )
                    self._follow(client)
            except DehystError as error:
                self.problem = str(error)
            except Exception:
                self.problem = "an error in the page's server; its log has the details"
                log.exception("watching %s", self.name)
            finally:
                self._client = None
            self._stop.wait(1.0)

    def _follow(self, client: Client) -> None:
        feed, stream = client.feed(), client.stream()
        self._take_doctor(client.doctor())
        feed.status, feed.status_at_ns = client.status(), clock.monotonic_ns()
        self._take_status(feed.status, feed.status_at_ns)
        seconds = min(PAST_S, PAST_SAMPLES * feed.status.period_ns * 1e-9)
        self._take_samples(client.history(seconds=seconds))
        self._take_words(deque(client.events()), deque())
        self.problem, client.patience_s = "", 0.0
        asked_ns = asked_run = 0
        while not self._stop.wait(TICK_S):
            samples = stream.read(0.0)
            self.lost = stream.lost
            self.wall_offset_ns = stream.wall_offset_ns or self.wall_offset_ns
            self._take_samples(samples)
            if feed.status is not None and feed.status_at_ns != self.status_at_ns:
                self._take_status(feed.status, feed.status_at_ns)
            self._take_words(feed.events, feed.rejections)
            while feed.doctor:
                self._take_doctor((feed.doctor.popleft(),))
                asked_ns = 0  # the model may have changed
            now_ns = clock.monotonic_ns()
            status = self.status
            if status is not None and (
                status.run != asked_run or now_ns - asked_ns > MODEL_S * clock.NS
            ):
                asked_ns, asked_run = now_ns, status.run
                self._ask(client)

    def _ask(self, client: Client) -> None:
        """Request the model and configuration in use."""
        try:
            model, config = client.model(), client.config()
        except DehystError as error:
            log.debug("%s: %s", self.name, error)
            return
        if self.model is None or model.provenance != self.model.provenance or config != self.config:
            self.changes += 1
        self.model, self.config = model, config

    def _take_samples(self, samples: NDArray[Any]) -> None:
        if not samples.size:
            self._errors.append((0.0, 0.0, 0))
            return
        error = samples["measured"] - samples["target"]
        error = np.abs(error[np.isfinite(error)])
        most = float(error.max()) if error.size else 0.0
        self._errors.append((float(np.dot(error, error)), most, error.size))
        with self.lock:
            self.buckets.add(samples)
            self.wakeups.add(samples)
            self.trail.add(samples)
        self.newest = samples[-1]

    def _take_status(self, status: Status, at_ns: int) -> None:
        self.status, self.status_at_ns = status, at_ns
        self.wall_offset_ns = self.wall_offset_ns or status.wall_ns - status.time_ns
        note_health(self.healths, status)

    def _take_doctor(self, reports: Sequence[DoctorReport]) -> None:
        for report in reports:
            self.doctor[report.case] = report
        while len(self.doctor) > REPORTS:
            del self.doctor[next(iter(self.doctor))]
        self.findings += 1

    def _take_words(self, events: deque[Event], rejections: deque[Rejection]) -> None:
        while events:
            e = events.popleft()
            self._add_event(e.wall_ns, e.level, e.code, e.text)
        while rejections:
            r = rejections.popleft()
            wall_ns = r.time_ns + self.wall_offset_ns if self.wall_offset_ns else clock.wall_ns()
            self._add_event(wall_ns, 2, "refused", f"{r.count} x: {r.text}")

    def _add_event(self, wall_ns: int, level: int, code: str, text: str) -> None:
        said = {"wall_s": wall_ns * 1e-9, "level": level, "code": code, "text": text}
        if all(said != before for _, before in self.events):  # may come by history and by feed
            self._heard += 1
            self.events.append((self._heard, said))


class Controllers:
    """All controllers at the given addresses, each axis by its name; new ones are found while the
    server runs."""

    def __init__(
        self, addresses: Sequence[str], base: str, name: str | None, credentials: str
    ) -> None:
        self.watches: dict[str, Watch] = {}
        self.problems: dict[str, str] = dict.fromkeys(addresses, "no controller has answered yet")
        self._base, self._name, self._credentials = base, name, credentials
        self._settings = client_settings(credentials)
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._find, args=(a,), name=f"find {a}", daemon=True)
            for a in addresses
        ]
        for thread in self._threads:
            thread.start()

    def of_one(self, watch: Watch) -> list[Watch]:
        """Return all known axes of this axis' controller, in the controller's order."""
        names = watch.axes or (watch.name,)
        return [self.watches[name] for name in names if name in self.watches]

    def close(self) -> None:
        """End all connections. One that does not end within CLOSE_S is abandoned."""
        self._stop.set()
        watches = list(self.watches.values())
        for watch in watches:
            watch.close()
        end_ns = clock.monotonic_ns() + round(CLOSE_S * clock.NS)
        for thread in (*self._threads, *(watch.thread for watch in watches)):
            thread.join(max(0.0, (end_ns - clock.monotonic_ns()) / clock.NS))

    def _find(self, address: str) -> None:
        while not self._stop.is_set():
            try:
                with Bus.connect([address], security=self._settings) as bus:
                    self._look(address, lambda bus=bus: daemons(bus, self._base, set()))  # type: ignore[misc]
            except DehystError as error:
                self.problems[address] = str(error)
            self._stop.wait(FIND_S)

    def _look(self, address: str, find: Callable[[], list[str]]) -> None:
        while not self._stop.is_set():
            names = find()
            self.problems[address] = (
                "" if names else f"{address} can be reached, but no controller answers"
            )
            for name in names:
                if self._name in (None, name) and name not in self.watches:
                    if len(self.watches) >= MOST_CONTROLLERS:
                        self.problems[address] = f"more than {MOST_CONTROLLERS} controllers"
                        break
                    self.watches[name] = Watch(address, self._base, name, self._credentials)
            self._stop.wait(FIND_S)
