"""Publishes telemetry, status and events from the rings on the bus, and keeps the history.

`tick` is called every `telemetry.batch_s` by one thread. Everything that was read is published;
records that the ring overwrote before they were read are counted.
"""

import math
import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst import __version__
from dehyst.daemon import clock, log_lines
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Event, GatewayStatus, Status
from dehyst.daemon.bus.session import Bus
from dehyst.daemon.bus.topics import DOCTOR, EVENT, TELEMETRY, subject
from dehyst.daemon.bus.topics import STATUS as STATUS_TOPIC
from dehyst.daemon.config import Config
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.core_rings import CoreRings
from dehyst.daemon.gateway.doctor_desk import DoctorDesk
from dehyst.daemon.gateway.history import TelemetryHistory, runs
from dehyst.daemon.gateway.mismatch import MismatchWatch
from dehyst.daemon.gateway.model_trial import ModelTrial
from dehyst.daemon.gateway.refused_starts import RefusedStarts
from dehyst.daemon.rings.records import State, model_file, name_of
from dehyst.daemon.rings.status import STATUS, message_values
from dehyst.models.units import how_many

SILENT_NS = 2_500_000_000
"""A core that has written nothing for this long is considered dead or hanging."""
DOUBTED_NS = 500_000_000
"""After this time without a record the gateway checks whether the core's process still runs: a
slow device may delay a sample for as long, a process that has ended writes no more."""
RUNS = "the loop's process is running"
GONE = "the loop's process does not respond: it has ended, was killed, or hangs"
LONGEST_BATCH = 4096  # samples in a message: a sixteenth of what a client accepts
UNSAID_NS = 1_200_000_000  # without a status of the loop, which comes every second, ours is sent
MEAN_S = 0.1
"""Averaging time [s] of the reading in the status: people read it, and noise is of no interest."""
RECENT_EVENTS = 64
"""Events kept for clients that connect later."""


@dataclass(frozen=True)
class Served:
    """What the gateway reports about itself for every axis. controller: its name; axes: names of
    all its axes, empty for a single unnamed axis; links: returns (open links, ended links)."""

    controller: str
    axes: tuple[str, ...]
    started_ns: int
    refused: RefusedStarts
    links: Callable[[], tuple[int, int]]

    @property
    def unreachable_s(self) -> float:
        """Return the time from the first failed start to this start [s]."""
        return (self.started_ns - self.refused.since_ns) * 1e-9 if self.refused.starts else 0.0


class Publisher:
    """Publishes one core's rings. Unit, reach and model are as reported by that core."""

    def __init__(
        self,
        config: Config,
        bus: Bus,
        keys: Keys,
        rings: CoreRings,
        admission: Admission,
        served: Served,
    ) -> None:
        self._config, self._rings, self._admission = config, rings, admission
        self._telemetry = bus.sender(keys.pubsub(subject(TELEMETRY)), TELEMETRY)
        self._status = bus.sender(keys.pubsub(subject(STATUS_TOPIC)), STATUS_TOPIC)
        self._events = bus.sender(keys.pubsub(subject(EVENT)), EVENT)
        self._served = served
        self.history = TelemetryHistory(round(config.telemetry.history_s * config.loop.rate_hz) + 1)
        self.recent_events: deque[Event] = deque(maxlen=RECENT_EVENTS)
        self._record: Any = np.zeros(1, STATUS)[0]
        self._heard_ns = self._said_ns = served.started_ns
        self._published = self._lost = self._cores = 0
        self._published_alive = False
        self._waiting: SimpleQueue[tuple[int, str, str]] = SimpleQueue()
        if served.refused.starts:
            away = f"no client could reach this daemon for {served.unreachable_s:.1f} s"
            self._waiting.put((1, "gateway", f"{away}: {served.refused.because}"))
        self.mismatch_watch = MismatchWatch(config, self.history, self.report_later)
        found = bus.sender(keys.pubsub(subject(DOCTOR)), DOCTOR)
        self._trial = ModelTrial(config, self._core_now, self.history.get)
        self.doctor_desk = DoctorDesk(config, found.put, self.report_later, self._trial)
        self.mismatch_watch.seen = self._trial.take_samples

    def tick(self, now_ns: int) -> None:
        """Read the rings once and publish what is new."""
        core = self._admission.core
        if self._rings.refresh():
            self._attached(now_ns)
        heard = self._pass_telemetry() | self._pass_status(now_ns)
        self._pass_events()
        if heard:
            self._heard_ns = now_ns
        alive = self._rings.is_attached and self._cores > 0 and self._is_heard(now_ns)
        if alive != self._published_alive and (alive or not core.starting):
            self._published_alive = alive
            self._report(now_ns, 1 if alive else 2, "core", RUNS if alive else GONE)
        if alive != core.alive:
            core.alive = alive
            self._say(now_ns)
        elif now_ns - self._said_ns >= UNSAID_NS:
            self._say(now_ns)

    def _is_heard(self, now_ns: int) -> bool:
        silent_ns = now_ns - self._heard_ns
        return silent_ns < DOUBTED_NS or (silent_ns < SILENT_NS and not self._rings.is_stopped)

    def report_later(self, level: int, code: str, text: str) -> None:
        """Queue an event from another thread."""
        self._waiting.put((level, code, text))

    def _core_now(self) -> tuple[int, Path | None]:
        """Return (process of the loop, file of its model); (0, None): it does not run."""
        alive = self._admission.core.alive
        return (int(self._record["pid"]), self.model_path) if alive else (0, None)

    @property
    def unit(self) -> str:
        """Return the displacement unit of the core's model; "" before there was a core."""
        return bytes(self._record["unit"]).decode("utf-8", "replace")

    @property
    def model_path(self) -> Path | None:
        """Return the file of the model that the core runs; None before there was a core."""
        digest = bytes(self._record["model"]).decode("utf-8", "replace")
        return model_file(self._config.directory, digest) if digest else None

    def status(self, now_ns: int) -> Status:
        """Return the present status."""
        newest = self.history.newest(max(1, round(MEAN_S * self._config.loop.rate_hz)))
        record = self._record
        if newest.size:
            record = record.copy()
            record["volts"] = newest["volts"][-1]
            if not math.isfinite(record["differs"]):  # the gauge may have begun since
                record["differs"] = newest_difference(newest)
        return status_message(
            record,
            self._config.name,
            self.history.run,
            self._admission.core.alive,
            self._own_status(now_ns, newest),
        )

    def _own_status(self, now_ns: int, newest: NDArray[Any]) -> GatewayStatus:
        lease, history = self._admission.lease, self.history
        held = lease.is_held(now_ns)
        served = self._served
        links, links_ended = served.links()
        return GatewayStatus(
            pid=os.getpid(),
            uptime_s=(now_ns - served.started_ns) * 1e-9,
            samples_published=self._published,
            samples_lost=self._lost,
            commands=self._admission.commands,
            rejected=dict(self._admission.rejected),
            lease_client=lease.client if held else 0,
            lease_label=lease.label if held else "",
            lease_left_s=lease.left_s(now_ns),
            history_s=(history.end - history.first) * self._config.period_ns * 1e-9,
            links=links,
            links_ended=links_ended,
            restarts_of_core=max(0, self._cores - 1),
            log_dropped=log_lines.dropped(),
            starts_refused=served.refused.starts,
            unreachable_s=served.unreachable_s,
            refused_because=served.refused.because,
            controller=served.controller,
            axes=served.axes,
            health=self.mismatch_watch.health,
            mismatch=self.mismatch_watch.figure,
            trial=self._trial.progress(now_ns),
            target=float(newest["target"][-1]) if newest.size else math.nan,
            measured=mean_reading(newest["measured"]),
        )

    def _attached(self, now_ns: int) -> None:
        """Take over the rings of a core, perhaps a new one. Past samples fill the history;
        publishing resumes at the position in the ring where the previous gateway stopped."""
        rings = self._rings
        of_another_daemon = self._cores == 0 and rings.is_left_over
        self._cores += not of_another_daemon and rings.run != self.history.run
        self._heard_ns = now_ns - SILENT_NS  # rings may be left over from a core that has died
        self.history.restart(rings.run)
        self.history.add(rings.read_again("telemetry", self.history.capacity))
        self._admission.resume(rings.newest_point())
        if of_another_daemon:
            rings.read("event")
            rings.mark_taken("event")
        else:
            earlier = rings.read_again("event", RECENT_EVENTS)
            self.recent_events.extend(event_message(record) for record in earlier)
        last = rings.newest_status()
        if last.size:
            self._take_status(last[-1])

    def _pass_telemetry(self) -> bool:
        samples, lost = self._rings.read("telemetry")
        self._lost += lost
        if not samples.size:
            return False
        wall_offset_ns = clock.wall_ns() - clock.monotonic_ns()
        unit = self.unit
        origin, zero = float(self._record["origin"]), float(self._record["gauge_zero"])
        self.mismatch_watch.add(self.history.run, samples, origin, zero)
        for piece in runs(samples, LONGEST_BATCH):
            message = encoding.batch(piece, self.history.run, unit, wall_offset_ns)
            self._telemetry.put(encoding.encode(message))
        self._rings.mark_taken("telemetry")
        self.history.add(samples)
        self._published += samples.size
        core = self._admission.core
        core.telemetry_seq = int(samples["seq"][-1])
        core.state = State(int(samples["state"][-1]))
        return True

    def _pass_status(self, now_ns: int) -> bool:
        records, _ = self._rings.read("status")
        if not records.size:
            return False
        self._rings.mark_taken("status")
        for record in records[-8:]:  # report each state change, even several within one tick
            self._take_status(record)
            self._say(now_ns)
        return True

    def _take_status(self, record: Any) -> None:
        self._record, core = record, self._admission.core
        self._admission.unit = self.unit
        self.mismatch_watch.model_path = self.model_path
        core.state = State(int(record["state"]))
        core.reachable = (float(record["reach_min"]), float(record["reach_max"]))
        core.period_ns, core.samples = int(record["period_ns"]), int(record["samples"])
        core.trajectory = int(record["trajectory"])
        core.trajectory_done = bool(record["trajectory_done"])
        core.queue_s, core.status_ns = float(record["queue_s"]), int(record["time_ns"])
        self._admission.take_loop_report(core.trajectory, core.state is State.RUNNING)

    def _pass_events(self) -> None:
        records, _ = self._rings.read("event")
        for record in records:
            self._put_event(event_message(record))
        if records.size:
            self._rings.mark_taken("event")
        while not self._waiting.empty():
            self._report(clock.monotonic_ns(), *self._waiting.get())

    def _report(self, now_ns: int, level: int, code: str, text: str) -> None:
        """Publish an event of the gateway itself."""
        event = Event(time_ns=now_ns, wall_ns=clock.wall_ns(), level=level, code=code, text=text)
        self._put_event(event)

    def _put_event(self, event: Event) -> None:
        self.recent_events.append(event)
        self._events.put(encoding.encode(event))

    def _say(self, now_ns: int) -> None:
        self._said_ns = now_ns
        self._status.put(encoding.encode(self.status(now_ns)))

    def summary(self) -> str:
        """Return one line for systemctl status."""
        core = self._admission.core
        state = name_of(State, core.state) if core.alive else "no loop"
        return f"{state}, {how_many(self._published, 'sample')} published, {self._lost} lost"


def mean_reading(measured: NDArray[np.float64]) -> float:
    """Return the mean of the valid readings of (n,); NaN if the newest is invalid."""
    if not measured.size or not math.isfinite(measured[-1]):
        return math.nan
    return float(np.mean(measured[np.isfinite(measured)]))


def newest_difference(samples: NDArray[Any]) -> float:
    """Return the mean of gauge minus model of (n,) TELEMETRY; NaN if the newest reading is
    invalid."""
    return mean_reading(samples["measured"] - samples["predicted"])


def event_message(record: Any) -> Event:
    """Convert an EVENT record to a message."""
    return Event(
        time_ns=int(record["time_ns"]),
        wall_ns=int(record["wall_ns"]),
        level=int(record["level"]),
        code=bytes(record["code"]).decode("utf-8", "replace"),
        text=bytes(record["text"]).decode("utf-8", "replace"),
    )


def status_message(
    record: Any,
    name: str,
    run: int,
    alive: bool,
    gateway: GatewayStatus,
) -> Status:
    """Combine a STATUS record and the gateway's own status into a message."""
    return Status(
        name=name,
        software=__version__,
        core_alive=alive,
        run=run,
        gateway=gateway,
        **message_values(record),
    )
