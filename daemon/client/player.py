"""Streams a trajectory to a daemon in chunks, paced by the queue length that the daemon reports.

Each axis has a player of its own; dehyst.daemon.client.together runs them. About LEAD_S of
trajectory are sent ahead, so that the gateway can be killed and restarted
without disturbing the motion. The player waits when a refusal only asks for time, and continues
when the model changes. When this program dies, the daemon runs out of points, holds, and ramps to
its safe voltage.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import MAX_POINTS, Event, Reply, Status, new_number
from dehyst.daemon.bus.refusal_codes import CODES
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.repeated import Numbers, Repeated
from dehyst.daemon.client.telemetry import StatusFeed, TelemetryStream
from dehyst.daemon.client.tracking import Tracking
from dehyst.models.errors import DehystError
from dehyst.models.recording import Floats

if TYPE_CHECKING:  # importing scipy is slow
    from dehyst.daemon.client.learning import LessonTaker

CHUNK_S = 0.25  # of trajectory in a command: a small part of what is sent ahead
LEAD_S = 3.0  # sent ahead: plays on while the gateway is restarted
LEARNING_LEAD_S = 1.0
"""Lead while learning [s]; a new correction takes effect this much later."""
PATIENCE_S = 10.0
"""Limit [s] for a daemon that does not answer, whose loop is silent, or that asks for time."""
WORDS_NS = 500_000_000  # how much later than the end its reason may arrive
AGAIN_NS, REFUSED_NS = 200_000_000, 250_000_000  # pause after no answer, and after a refusal
RENEW_S = 1.0  # between renewals of the lease, which lasts 3 s by default


Report = Callable[[str], None]
"""Called with a message for the user while the trajectory plays."""


def ignore(text: str) -> None:
    """Discard the message."""


@dataclass
class Played:
    """Result of playing a trajectory. completed: the loop reached the last point; reason: why it
    did not, else ""; tracking: tracking errors; lost: samples whose telemetry did not arrive."""

    completed: bool
    reason: str
    trajectory: int
    duration_s: float
    unit: str
    tracking: Tracking
    lost: int
    state: str
    notes: tuple[str, ...] = ()
    """Messages that the player reported while playing."""


class Connection(Protocol):
    """The part of a Client that the player needs. patience_s: how long to wait for a silent daemon;
    report: receives messages for the user while playing."""

    patience_s: float
    report: Report

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
        axes: Sequence[str] = (),
    ) -> Reply: ...

    def renew(self) -> None: ...

    def stop(self) -> None: ...


def model_reach(status: Status) -> tuple[float, float]:
    """Return the reach as model displacements, which origin and trim do not shift."""
    zero = status.origin + status.trim
    return status.reach_min + zero, status.reach_max + zero


class Player:
    """Plays one axis. together: names of all axes that play this trajectory, empty for a single
    axis; number: the trajectory's number, the same for all of them."""

    def __init__(
        self,
        client: Connection,
        points: Repeated,
        allow_unreachable: bool = False,
        lead_s: float = LEAD_S,
        lessons: "LessonTaker | None" = None,
        together: Sequence[str] = (),
        number: int = 0,
    ) -> None:
        self.lead_s, self.lessons = lead_s, lessons
        self.client, self.points = client, points
        self.allow, self.together = allow_unreachable, tuple(together)
        self.number = number or new_number()
        self.sent = self.index = 0
        self.piece: tuple[Numbers, Floats, Floats] | None = None
        self.due_ns = self.heard_ns = clock.monotonic_ns()
        self.silent_since_ns = 0
        self.refused = ""
        # since when the daemon has asked for time; since when the loop has been gone
        self.asked_since_ns = self.gone_since_ns = 0
        self.notes: list[str] = []
        self.ended_ns = 0
        self.stream, self.feed = client.stream(), client.feed()
        self.before = client.status()
        if not self.before.core_alive or self.before.period_ns <= 0:
            raise DehystError("the daemon's loop is not running yet; try again when it is ready")
        self.period_s, self.reach = self.before.period_ns * 1e-9, model_reach(self.before)
        self.tracking = Tracking(2**62, points.samples(self.period_s))

    def hear(self, timeout_s: float) -> NDArray[Any]:
        """Return the telemetry that has arrived, and evaluate it."""
        samples = self.stream.read(timeout_s)
        if samples.size:
            self.tracking.add(samples)
            self.learn(samples)
        self._see_model()
        return samples

    def _see_model(self) -> None:
        """Report, once per change of model or trim, the remaining points that are out of reach."""
        status = self.feed.status
        if status is None or not self.index or np.allclose(model_reach(status), self.reach):
            return
        self.reach = model_reach(status)
        targets, low, high = self.points.left(self.sent), status.reach_min, status.reach_max
        far = np.maximum(low - targets, targets - high)
        far = far[far > 0.0]
        head = f"{status.name}: the model or the trim has changed, and the reach is now "
        head += f"{low:.6g} to {high:.6g} {status.unit}"
        if self.allow or not far.size:
            self.report(f"{head}; the trajectory goes on")
            return
        whole = "remaining points" if self.points.total is not None else "points of each pass"
        self.report(
            f"{head}: {far.size} of the {targets.size} {whole} are beyond it, by up to "
            f"{far.max():.3g} {status.unit}; they are played at the nearest position and flagged"
        )

    def report(self, text: str) -> None:
        """Report a message now, and keep it for the result."""
        self.notes.append(text)
        self.client.report(text)

    def learn(self, samples: NDArray[Any]) -> None:
        """Pass the samples of this trajectory to the learner."""
        if self.lessons is None or self.index == 0:
            return
        status = self.feed.status
        if status is not None and status.trajectory == self.number and status.trajectory_start_ns:
            self.lessons.start_ns = status.trajectory_start_ns
        self.lessons.add(samples[samples["seq"] >= self.tracking.first_seq])

    def send(self, now_ns: int) -> None:
        """Send the next chunk, or renew the lease once all chunks are sent."""
        try:
            if self.points.over(self.sent):
                self.client.renew()
                self.due_ns = now_ns + round(RENEW_S * 1e9)
                self.silent_since_ns = 0
                return
            if self.piece is None:  # a chunk that was not accepted is sent again
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
                self.together,
            )
        except BusError:  # the gateway may be restarting; the points sent ahead keep playing
            self.silent_since_ns = self.silent_since_ns or now_ns
            self.due_ns = now_ns + AGAIN_NS
            return
        except DehystError as error:
            self._refuse(now_ns, error)
            return
        self.silent_since_ns = self.asked_since_ns = 0
        if self.index == 0:
            self.tracking.first_seq = reply.telemetry_seq + 1
        self.sent, self.index, self.piece = end, self.index + 1, None
        ahead_s = reply.queue_s - self.lead_s
        wait_s = min(max(ahead_s, 0.0), RENEW_S)
        self.due_ns = now_ns + round(wait_s * 1e9)

    def _refuse(self, now_ns: int, error: DehystError) -> None:
        """Wait if the refusal asks for time, else end. Raises it if nothing has started."""
        code = getattr(error, "code", "")
        waits = code in CODES and CODES[code].waits
        self.due_ns, self.silent_since_ns = now_ns + REFUSED_NS, 0
        # a full queue drains; any other request for time could go on forever
        if waits and code != "queue-full":
            self.asked_since_ns = self.asked_since_ns or now_ns
            waits = now_ns - self.asked_since_ns <= PATIENCE_S * 1e9
        if self.index == 0 and (not waits or self.together):
            raise error
        if not waits:
            self.refused = str(error)

    def silent_too_long(self, now_ns: int) -> bool:
        """Return True if the daemon has not answered for PATIENCE_S. Raises BusError if nothing has
        started."""
        if not self.silent_since_ns or now_ns - self.silent_since_ns <= PATIENCE_S * 1e9:
            return False
        self.refused = (
            f"the daemon has not answered for {PATIENCE_S:g} s; the stage holds and ramps to its "
            "safe voltage by itself"
        )
        if self.index == 0:
            raise BusError(self.refused)
        return True

    def ended(self, now_ns: int) -> str | None:
        """Return None while it plays, "" once it has reached its end, else why it ended early."""
        status = self.feed.status
        if self.refused:
            return self.refused
        if self.tracking.complete and self.points.over(self.sent):
            return ""
        if status is None or self.index == 0:
            return None
        self.gone_since_ns = 0 if status.core_alive else self.gone_since_ns or now_ns
        if self.gone_since_ns and now_ns - self.gone_since_ns > PATIENCE_S * 1e9:
            return f"the daemon's loop has sent nothing for {PATIENCE_S:g} s"
        if status.time_ns <= self.before.time_ns:
            return None
        if status.trajectory == self.number and status.trajectory_done:
            late = now_ns - self.feed.status_at_ns > 1e9  # the last samples may still arrive
            return "" if late else None
        if status.trajectory not in (self.number, self.before.trajectory):
            return "another trajectory replaced it"
        if status.trajectory == self.number and status.state != "running" and status.core_alive:
            self.ended_ns = self.ended_ns or now_ns
            said = any(event.code == status.state for event in self.new_events())
            # the reason is sent on a separate topic and may arrive a little later
            return self.why(status) if said or now_ns - self.ended_ns > WORDS_NS else None
        if status.run != self.before.run:
            return "the loop was restarted"
        return None

    def new_events(self) -> list[Event]:
        """Return the events since the trajectory was started."""
        return [event for event in list(self.feed.events) if event.time_ns > self.before.time_ns]

    def why(self, status: Status) -> str:
        """Return the daemon's own messages about the end, as far as they have arrived."""
        texts = [event.text for event in self.new_events()[-3:]]
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
            notes=tuple(self.notes),
        )
