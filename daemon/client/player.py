"""Streams a trajectory to a daemon: chunks ahead of time, paced by what the daemon says is ahead.

About LEAD_S of trajectory are kept ahead, so that a gateway may be killed and started again in
the midst without the stage noticing. When this program dies, the daemon runs out of points,
holds, and ramps to its safe voltage.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import MAX_POINTS, Event, Reply, Status, new_number
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.repeated import Numbers, Repeated
from dehyst.daemon.client.telemetry import StatusFeed, TelemetryStream
from dehyst.daemon.client.tracking import Tracking
from dehyst.models.errors import DehystError
from dehyst.models.recording import Floats

if TYPE_CHECKING:  # scipy takes its time
    from dehyst.daemon.client.learning import LessonTaker

CHUNK_S = 0.25
LEAD_S = 3.0
LEARNING_LEAD_S = 1.0
"""What was learned acts so much later."""
PATIENCE_S = 10.0
WORDS_NS = 500_000_000  # that the reason of an end may come after the end
RENEW_S = 1.0


@dataclass
class Played:
    """What happened. completed: the loop went through to the last point; reason: why not, else
    ""; tracking: errors; lost: samples whose telemetry did not arrive."""

    completed: bool
    reason: str
    trajectory: int
    duration_s: float
    unit: str
    tracking: Tracking
    lost: int
    state: str


class Connection(Protocol):
    """What the player needs of a Client; patience_s: how long a silent daemon is waited for."""

    patience_s: float

    def status(self) -> Status: ...

    def stream(self) -> TelemetryStream: ...

    def feed(self) -> StatusFeed: ...

    def chunk(
        self,
        trajectory: int,
        index: int,
        offset_ns: NDArray[np.int64],
        value: NDArray[np.float64],
        last: bool,
        allow_unreachable: bool = False,
        correction: NDArray[np.float64] | None = None,
    ) -> Reply: ...

    def renew(self) -> None: ...

    def stop(self) -> None: ...


def play(
    client: Connection,
    points: Repeated,
    allow_unreachable: bool = False,
    progress: Callable[[float, float], None] | None = None,
    on_samples: Callable[[NDArray[Any]], None] | None = None,
    lead_s: float = LEAD_S,
    lessons: "LessonTaker | None" = None,
) -> Played:
    """See Client.play. lessons: learns from each pass, and corrects the points of the next."""
    return _Player(client, points, allow_unreachable, lead_s, lessons).run(progress, on_samples)


class _Player:
    def __init__(
        self,
        client: Connection,
        points: Repeated,
        allow_unreachable: bool,
        lead_s: float,
        lessons: "LessonTaker | None",
    ) -> None:
        self.lead_s, self.lessons = lead_s, lessons
        self.client, self.points = client, points
        self.allow = allow_unreachable
        self.number = new_number()
        self.sent = self.index = 0
        self.piece: tuple[Numbers, Floats, Floats] | None = None
        self.due_ns = self.heard_ns = clock.monotonic_ns()
        self.silent_since_ns = 0
        self.refused = ""
        self.ended_ns = 0
        self.stream, self.feed = client.stream(), client.feed()
        self.before = client.status()
        if not self.before.core_alive or self.before.period_ns <= 0:
            raise DehystError("the daemon's loop is not running yet; try again when it is ready")
        self.period_s = self.before.period_ns * 1e-9
        self.tracking = Tracking(2**62, points.samples(self.period_s))

    def run(
        self,
        progress: Callable[[float, float], None] | None,
        on_samples: Callable[[NDArray[Any]], None] | None,
    ) -> Played:
        shown_ns, patience_s = 0, self.client.patience_s
        self.client.patience_s = 0.0  # telemetry is read meanwhile
        try:
            while True:
                now_ns = clock.monotonic_ns()
                if now_ns >= self.due_ns and not self.silent_too_long(now_ns):
                    self.send(now_ns)
                samples = self.stream.read(0.02)
                if samples.size:
                    self.tracking.add(samples)
                    self.learn(samples)
                    if on_samples is not None:
                        on_samples(samples)
                if progress is not None and now_ns - shown_ns > 2e8:
                    shown_ns = now_ns
                    progress(self.tracking.samples * self.period_s, self.points.duration_s)
                ended = self.ended(now_ns)
                if ended is not None:
                    if progress is not None:
                        progress(self.tracking.samples * self.period_s, self.points.duration_s)
                    return self.result(ended)
        except KeyboardInterrupt:
            self.client.stop()
            if self.points.total is None:  # that is how one without an end is ended
                self.tracking.expected = self.tracking.samples
                return self.result("")
            raise
        finally:
            self.client.patience_s = patience_s
            self.stream.close()
            self.feed.close()

    def learn(self, samples: NDArray[Any]) -> None:
        """Let the learning have the samples of this trajectory."""
        if self.lessons is None or self.index == 0:
            return
        status = self.feed.status
        if self.lessons.start_ns == 0 and status is not None and status.trajectory == self.number:
            self.lessons.start_ns = status.trajectory_start_ns
        self.lessons.add(samples[samples["seq"] >= self.tracking.first_seq])

    def send(self, now_ns: int) -> None:
        """The next chunk, or a sign of life once all are sent."""
        try:
            if self.points.over(self.sent):
                self.client.renew()
                self.due_ns = now_ns + round(RENEW_S * 1e9)
                self.silent_since_ns = 0
                return
            if self.piece is None:  # the same again where it was not taken
                self.piece = self.points.piece(self.sent, CHUNK_S, MAX_POINTS)
            offset_ns, targets, learned = self.piece
            end = self.sent + targets.size
            reply = self.client.chunk(
                self.number,
                self.index,
                offset_ns,
                targets,
                self.points.over(end),
                self.allow,
                learned if learned.any() else None,
            )
        except BusError:  # the gateway may be starting again; what was sent ahead plays on
            self.silent_since_ns = self.silent_since_ns or now_ns
            self.due_ns = now_ns + 200_000_000
            return
        except DehystError as error:
            if self.index == 0:
                raise
            self.due_ns = now_ns + 250_000_000
            if getattr(error, "code", "") != "queue-full":
                self.refused = str(error)
            return
        self.silent_since_ns = 0
        if self.index == 0:
            self.tracking.first_seq = reply.telemetry_seq + 1
        self.sent, self.index, self.piece = end, self.index + 1, None
        ahead_s = reply.queue_s - self.lead_s
        wait_s = min(max(ahead_s, 0.0), RENEW_S)
        self.due_ns = now_ns + round(wait_s * 1e9)

    def silent_too_long(self, now_ns: int) -> bool:
        """Raises BusError when the daemon has not answered for PATIENCE_S."""
        if self.silent_since_ns and now_ns - self.silent_since_ns > PATIENCE_S * 1e9:
            raise BusError(
                f"the daemon has not answered for {PATIENCE_S:g} s; the stage holds and ramps to "
                "its safe voltage by itself"
            )
        return False

    def ended(self, now_ns: int) -> str | None:
        """None: it goes on; "": through to the end; else why it ended early."""
        status = self.feed.status
        if self.refused:
            return self.refused
        if self.tracking.complete and self.points.over(self.sent):
            return ""
        if status is None or self.index == 0 or status.time_ns <= self.before.time_ns:
            return None
        if status.trajectory == self.number and status.trajectory_done:
            late = now_ns - self.feed.status_at_ns > 1e9  # the last samples are still on their way
            return "" if late else None
        if status.trajectory not in (self.number, self.before.trajectory):
            return "another trajectory took its place"
        if status.trajectory == self.number and status.state != "running" and status.core_alive:
            self.ended_ns = self.ended_ns or now_ns
            said = any(event.code == status.state for event in self.told())
            # the reason travels on a topic of its own and may come a little later
            return self.why(status) if said or now_ns - self.ended_ns > WORDS_NS else None
        if status.run != self.before.run:
            return "the loop was started anew"
        return None

    def told(self) -> list[Event]:
        """Events since the trajectory was begun."""
        return [event for event in list(self.feed.events) if event.time_ns > self.before.time_ns]

    def why(self, status: Status) -> str:
        """The daemon's own words for the end, as far as they came."""
        texts = [event.text for event in self.told()[-3:]]
        said = f" ({'; '.join(texts)})" if texts else ""
        return f"the daemon went to the state {status.state}{said}"

    def result(self, reason: str) -> Played:
        status = self.feed.status or self.before
        return Played(
            completed=not reason,
            reason=reason,
            trajectory=self.number,
            duration_s=self.points.duration_s
            if self.points.total is not None
            else self.tracking.samples * self.period_s,
            unit=status.unit,
            tracking=self.tracking,
            lost=self.stream.lost,
            state=status.state,
        )
