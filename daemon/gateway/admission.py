"""Decides which client commands reach the loop. Pure: takes times as arguments and returns records.

A refused command is counted and answered with a code and a reason in words. The checks, in this
order: the loop is present and in a state that follows commands; lease; order and age; unit; finite;
within reach; room in the queue. Nothing is clipped or repaired here. A trajectory's reach is fixed
when it begins (dehyst.daemon.gateway.in_play); dehyst.daemon.gateway.trajectory decides which of
its points are new and in order.
"""

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.bus.messages import Chunk, Command, Reply, Request, Setpoint
from dehyst.daemon.bus.refusal_codes import CODES, NotAdmitted
from dehyst.daemon.gateway.core_view import CoreView
from dehyst.daemon.gateway.in_play import InPlay
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.gateway.loop_records import NOTHING, make_records
from dehyst.daemon.gateway.trajectory import (
    COMPLETE,
    NewPoints,
    PassedOn,
    TrajectoryProgress,
    Values,
)
from dehyst.daemon.rings.records import LARGEST_TARGET, LoopCommand, State

AHEAD_S = 1.0  # how far ahead a sender's clock may get, s: it is stepped when it synchronises
DecideOffer = Callable[[str, int], str]
"""Takes (action, number of the offer); returns why not, in words, or "" if it is being done."""


class Admission:
    """Admits or refuses commands. unit: the model's displacement unit; queue_s: longest trajectory
    ahead of the loop; stale_s: set-points and chunks that took longer to arrive are refused;
    may_stay: a set-point or a hold may outlast its client."""

    def __init__(
        self, unit: str, queue_s: float, stale_s: float, lease: Lease, may_stay: bool = False
    ) -> None:
        self.unit, self.stale_s, self.lease = unit, stale_s, lease
        self.may_stay = may_stay
        self.core = CoreView()
        self.rejected: Counter[str] = Counter()
        self.commands = 0
        self.decide_offer: DecideOffer = lambda action, offer: "this controller has no doctor"
        self.report: Callable[[int, str, str], None] = lambda level, code, text: None
        self.keep: Callable[[InPlay], None] = lambda begun: None
        self.begun = InPlay()
        self._trajectory, self._queue = TrajectoryProgress(), PassedOn(queue_s)
        self._room = 0
        self._stopped_by_another = False
        self._stop_sent_ns: int | None = None  # of the holder's newest stop, by its clock
        self._zeroed: tuple[int, int] | None = None  # client and time of the newest zero

    def resume(self, newest: NDArray[np.void]) -> None:
        """Restore what an earlier gateway has passed on, from the (0,) or (1,) newest POINT record
        in the ring."""
        self._trajectory = TrajectoryProgress.resumed(newest)

    def take_loop_report(self, trajectory: int, running: bool) -> None:
        """Take the loop's report on its trajectory; one that the loop has left (no more points, a
        fault) is not resumed."""
        if trajectory == self._trajectory.number and not running:
            self._trajectory.over = self._trajectory.over or "the loop no longer follows it"

    def queue_ahead_s(self, now_ns: int) -> float:
        """Return the trajectory ahead of the loop at most [s]: its last report plus what was passed
        on since."""
        return self._queue.ahead_s(now_ns, self.core)

    def handle(self, now_ns: int, command: Command, room: int) -> tuple[Reply, NDArray[np.void]]:
        """Return (answer, COMMAND records for the loop). room: records that its ring can take."""
        self.commands += 1
        self._room = room
        code, text = "ok", ""
        try:
            if isinstance(command, Chunk):
                records, code, text = self._chunk(now_ns, command)
            elif isinstance(command, Setpoint):
                records = self._setpoint(now_ns, command)
            else:
                records = self._request(now_ns, command)
        except NotAdmitted as refused:
            self._report_final(command, refused)
            return self.refuse(now_ns, refused.code, str(refused)), NOTHING
        return self.granted(now_ns, command, code, text), records

    def _report_final(self, command: Command, refused: NotAdmitted) -> None:
        """Report once that a chunk of the trajectory in play is finally refused."""
        now = self._trajectory
        said = CODES[refused.code].waits or now.over or now.refused
        if isinstance(command, Chunk) and self.is_playing(command) and not said:
            now.refused = True
            self.report(
                2, "trajectory", f"a chunk is refused; the trajectory in play continues: {refused}"
            )

    def granted(self, now_ns: int, command: Command, code: str = "ok", text: str = "") -> Reply:
        """Return the answer to an admitted command."""
        holder = self.lease.check(now_ns, command.client, self.lease.lease)
        return Reply(
            ok=True,
            code=code,
            text=text,
            lease=self.lease.lease if holder and isinstance(command, Request) else 0,
            lease_s=self.lease.length_ns * 1e-9,
            queue_s=self.queue_ahead_s(now_ns),
            telemetry_seq=self.core.telemetry_seq,
        )

    def refuse(self, now_ns: int, code: str, text: str) -> Reply:
        """Count a refusal and return the answer with its reason."""
        self.rejected[code] += 1
        return Reply(ok=False, code=code, text=text[:500], queue_s=self.queue_ahead_s(now_ns))

    def _check_lease(self, now_ns: int, client: int, lease: int) -> None:
        if self.lease.check(now_ns, client, lease):
            return
        if self.lease.is_held(now_ns) and client != self.lease.client:
            raise NotAdmitted("lease-taken", self._taken(now_ns))
        raise NotAdmitted("no-lease", "no lease, or an expired one: acquire one first")

    def _taken(self, now_ns: int) -> str:
        who = self.lease.label or f"client {self.lease.client}"
        return (
            f"{who} commands this daemon (its lease ends {self.lease.left_s(now_ns):.1f} s after "
            "its last command): wait, or take over"
        )

    def _check_age(self, now_ns: int, sent_ns: int, however_old: bool = False) -> None:
        age_s = self.lease.age_ns(now_ns, sent_ns) * 1e-9
        if age_s > self.stale_s and not however_old:
            raise NotAdmitted(
                "late", f"sent {age_s:.1f} s ago; at most {self.stale_s:g} s are allowed"
            )
        if age_s < -AHEAD_S:
            raise NotAdmitted(
                "late", f"sent {-age_s:.1f} s in the future by the sender's own clock"
            )

    def _check_values(
        self, values: Values, unit: str, allow_unreachable: bool, begun: InPlay
    ) -> None:
        if unit != self.unit:
            raise NotAdmitted(
                "unit", f"the targets are in {unit!r}; this daemon takes {self.unit!r}"
            )
        if not np.all(np.isfinite(values)):
            raise NotAdmitted("not-finite", "a target is NaN or infinite")
        if np.max(np.abs(values), initial=0.0) > LARGEST_TARGET:
            raise NotAdmitted(
                "unreachable",
                f"a target is more than {LARGEST_TARGET:g} {self.unit} from 0, which no stage "
                "reaches; is it in the right unit?",
            )
        wrong = None if allow_unreachable else begun.find_unreachable(values, self.core.reachable)
        if wrong is not None:
            low, high = self.core.reachable
            raise NotAdmitted(
                "unreachable",
                f"{wrong:g} {self.unit} cannot be reached: the range is {low:g} to {high:g}",
            )

    def _setpoint(self, now_ns: int, command: Setpoint) -> NDArray[np.void]:
        self.core.check_state(self._room)
        self._check_lease(now_ns, command.client, command.lease)
        if command.sequence <= self.lease.sequence:
            raise NotAdmitted(
                "old", f"set-point {command.sequence} came after {self.lease.sequence}"
            )
        self.lease.keep_alive(now_ns)
        self._check_age(now_ns, command.sent_ns)
        self._check_values(
            np.array([command.value]), command.unit, command.allow_unreachable, InPlay()
        )
        self._check_stay(command.stay)
        self._check_stopped(command.sent_ns)
        self.lease.sequence = command.sequence
        self.lease.renew(now_ns, command.sent_ns)
        self._end_trajectory("a set-point replaced it")
        records = make_records(
            LoopCommand.SETPOINT, command.client, value=np.array([command.value])
        )
        records["last"] = command.stay
        return records

    def is_playing(self, command: Chunk) -> bool:
        """Return whether the trajectory of this chunk has begun on this axis."""
        return self._trajectory.is_of(command)

    def check_first(self, now_ns: int, command: Chunk, room: int) -> None:
        """Raise NotAdmitted if this first chunk of a trajectory would be refused now."""
        self._room = room
        self._check_chunk(now_ns, command)

    def _chunk(self, now_ns: int, command: Chunk) -> tuple[NDArray[np.void], str, str]:
        checked = self._check_chunk(now_ns, command)
        if checked is None:
            self.lease.renew(now_ns, command.sent_ns)
            return NOTHING, "duplicate", ""
        now, new = checked
        span_s = 1e-9 * now.span_ns(new.offsets)
        if command.index == 0:
            self._queue.clear()
            self.core.queue_s = 0.0
        if not self._has_begun(now):
            self.begun = InPlay.begin(now.number, now.client, self.core.reachable)
            self.keep(self.begun)
        self._trajectory = now
        now.pass_on(command, new.offsets)
        self._queue.add(now_ns, span_s)
        self.lease.renew(now_ns, command.sent_ns)
        records = make_records(
            LoopCommand.POINT, command.client, command.trajectory, new.values, new.offsets
        )
        records["last"][-1] = command.last
        records["correction"] = new.learned
        if len(command.axes) > 1:
            records["group"], records["members"] = command.trajectory, len(command.axes)
        return records, "ok", "" if command.allow_unreachable else self._beyond(command, new.values)

    def _has_begun(self, now: TrajectoryProgress) -> bool:
        """Return whether the reach at the trajectory's start is known."""
        return (self.begun.trajectory, self.begun.client) == (now.number, now.client)

    def _beyond(self, command: Chunk, values: Values) -> str:
        """Count the points that a model change has put out of reach. Report them at the first one,
        then also in words for the client, and at the end."""
        begun, first = self.begun, not self.begun.beyond
        if begun.count(values, self.core.reachable):
            self.keep(begun)
        if not begun.beyond or not (first or command.last):
            return ""
        text = begun.describe_beyond(self.core.reachable, self.unit)
        self.report(2, "trajectory", text)
        return text if first else ""

    def _check_chunk(
        self, now_ns: int, command: Chunk
    ) -> tuple[TrajectoryProgress, NewPoints] | None:
        """Return the chunk's trajectory and its new points, None for a duplicate. Raises
        NotAdmitted."""
        self.core.check_state(self._room, len(command.value) // 8 + 1)
        self._check_lease(now_ns, command.client, command.lease)
        self._check_age(now_ns, command.sent_ns)
        now = self._trajectory.continued(command)
        new = now.new_points(command)
        if new is None:
            return None
        self._check_stopped(command.sent_ns)
        begun = self.begun if self._has_begun(now) else InPlay()
        self._check_values(new.values, command.unit, command.allow_unreachable, begun)
        if not np.all(np.isfinite(new.learned)):
            raise NotAdmitted("not-finite", "a learned correction is NaN or infinite")
        now.check_dense(new.offsets, self.core.period_ns)
        ahead_s = 0.0 if command.index == 0 else self.queue_ahead_s(now_ns)
        self._queue.check_room(ahead_s, 1e-9 * now.span_ns(new.offsets))
        return now, new

    def _zero(self, command: Request) -> NDArray[np.void]:
        self.core.check_state(self._room)
        low, high = self.core.reachable
        if not np.isfinite(command.value):
            raise NotAdmitted("not-finite", "the shift of the gauge's zero is NaN or infinite")
        if abs(command.value) > high - low:
            raise NotAdmitted(
                "unreachable",
                f"the gauge's zero cannot move by {command.value:g} {self.unit}: that is more than "
                f"the stage's whole reach of {high - low:g}",
            )
        again = self._zeroed == (command.client, command.sent_ns)
        self._zeroed = command.client, command.sent_ns
        if again:  # sent once more, because the answer was lost: the shift is already made
            return NOTHING
        return make_records(LoopCommand.ZERO, command.client, value=np.array([command.value]))

    def _check_stopped(self, sent_ns: int) -> None:
        """Raise NotAdmitted for a motion that would undo a stop: another client's, of which the
        holder learns by this, or the holder's own, which has overtaken what it sent before."""
        if self._stopped_by_another:
            raise NotAdmitted(
                "over",
                "another client has stopped the stage; acquire the lease to command it again",
            )
        if self._stop_sent_ns is not None and sent_ns < self._stop_sent_ns:
            raise NotAdmitted("old", "sent before the client's own stop")

    def _check_stay(self, stay: bool) -> None:
        if stay and not self.may_stay:
            raise NotAdmitted(
                "stay",
                "a position is kept only while a client requests it: setpoint.stay is false in "
                "the daemon's configuration; set it to true, and start the daemon again",
            )

    def _hold(self, command: Request) -> NDArray[np.void]:
        self.core.check_state(self._room)
        self._check_stay(command.stay)
        self._check_stopped(command.sent_ns)
        self._end_trajectory("its stage is held where it is")
        records = make_records(LoopCommand.HOLD, command.client)
        records["last"] = command.stay
        return records

    def _end_trajectory(self, why: str) -> None:
        if (now := self._trajectory).number and now.over in ("", COMPLETE):
            if not now.over:
                self.report(1, "trajectory", f"the trajectory ended early: {why}")
            now.over = why
        self._queue.clear()

    def check_free(self, now_ns: int, command: Request) -> None:
        """Raise NotAdmitted if this command cannot get the lease."""
        lease = self.lease
        if command.action == "take-over" or not lease.is_held(now_ns):
            return
        if lease.client != command.client:
            raise NotAdmitted("lease-taken", self._taken(now_ns))

    def give_lease(self, now_ns: int, command: Request, number: int = 0) -> None:
        """Give the lease to the command's client, after check_free. number: the lease's number, 0:
        a new one."""
        lease, client = self.lease, command.client
        before = lease.client if lease.is_held(now_ns) else 0
        lease.give(now_ns, client, command.label, command.sent_ns, number)
        self._stopped_by_another, self._stop_sent_ns = False, None
        if before not in (0, client):
            self._end_trajectory("another client took over")

    def _request(self, now_ns: int, command: Request) -> NDArray[np.void]:
        action, client, lease = command.action, command.client, self.lease
        if action in ("acquire", "take-over"):
            self.check_free(now_ns, command)
            self.give_lease(now_ns, command)
            return NOTHING
        if action in ("stop", "release"):  # needs the right to command, but no lease
            self.core.check(self._room)
            self._end_trajectory("it was stopped")
            if action == "release" and self.core.state is State.FAULT:
                raise NotAdmitted(
                    "state",
                    "a device has failed, so the output cannot be ramped now: release again once "
                    "it is back",
                )
            if lease.check(now_ns, client, command.lease):
                lease.keep_alive(now_ns)
                self._stop_sent_ns = command.sent_ns
            else:
                self._stopped_by_another = True
            return make_records(
                LoopCommand.STOP_MOTION if action == "stop" else LoopCommand.RELEASE, client
            )
        if action in ("accept", "reject"):  # needs no lease either: it moves nothing by itself
            if why := self.decide_offer(action, command.offer):
                raise NotAdmitted("no-offer", why)
            return NOTHING
        self._check_lease(now_ns, client, command.lease)
        lease.keep_alive(now_ns)
        self._check_age(now_ns, command.sent_ns, however_old=action not in ("zero", "hold"))
        lease.renew(now_ns, command.sent_ns)
        if action == "zero":
            return self._zero(command)
        if action == "hold":
            return self._hold(command)
        if action == "give-up":
            lease.give_up()
        elif action == "clear":
            self.core.check(self._room)
            if command.trajectory == self._trajectory.number:
                self._end_trajectory("its client withdrew it")
            return make_records(LoopCommand.CLEAR, client, command.trajectory)
        return NOTHING
