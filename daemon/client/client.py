"""The client through which remote commands and user programs control a daemon.

    from dehyst.client import Client

    with Client() as stage:
        stage.send(4.0)                  # micrometres from the set-point origin
        for samples in stage.telemetry():
            print(samples["measured"][-1])

Displacements are in the model's unit (`status().unit`, um on most stages). Several threads may
share a Client: commands are sent one at a time and the newest one takes effect. A forked process
must create its own. The first command acquires the daemon's lease automatically; `take_over()`
takes it from another client.
"""

import logging
import os
import socket
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Action, Chunk, Command, Reply, Request, Setpoint, new_number
from dehyst.daemon.bus.security import client_settings
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.bus.topics import SETPOINT, subject
from dehyst.daemon.called import python_function
from dehyst.daemon.client.finding import TIMEOUT_S, chosen_of, find_daemons, not_chosen
from dehyst.daemon.client.player import LEAD_S, LEARNING_LEAD_S, Played, Report, ignore
from dehyst.daemon.client.questions import DaemonQueries
from dehyst.daemon.client.repeated import Repeated
from dehyst.daemon.client.together import play
from dehyst.daemon.option_words import in_callers_words
from dehyst.models.errors import DehystError

if TYPE_CHECKING:  # importing scipy is slow
    from dehyst.daemon.client.learning import LessonTaker

log = logging.getLogger(__name__)
DEFAULT = "tcp/127.0.0.1:7447"
ADDRESS, CREDENTIALS = "DEHYST_CONNECT", "DEHYST_CREDENTIALS"
"""Environment variables that override the defaults."""


def open_bus(
    connect: str | Sequence[str] | None, credentials: str | Path | None
) -> tuple[Bus, list[str]]:
    """Return a connection and its addresses. None: from the environment, else the default."""
    connect = os.environ.get(ADDRESS, DEFAULT) if connect is None else connect
    credentials = os.environ.get(CREDENTIALS, "") if credentials is None else credentials
    addresses = [connect] if isinstance(connect, str) else list(connect)
    return Bus.connect(addresses, security=client_settings(str(credentials))), addresses


class Refusal(DehystError):
    """The daemon refused a command. code: one of dehyst.daemon.bus.refusal_codes.CODES."""

    def __init__(self, code: str, text: str) -> None:
        how = in_callers_words(" with --take-over") if code == "lease-taken" else ""
        super().__init__(f"the daemon refuses: {text}{how} [{code}]")
        self.code = code


class Client(DaemonQueries):
    """A connection to one daemon.

    name: the controller's name; None: the only one that answers. connect: one or several zenoh
    addresses; None: $DEHYST_CONNECT, else the daemon on this machine. label: identifies this client
    to others who want to command. credentials: a directory with ca.pem, certificate.pem and
    key.pem, or a file with one line name:password; None: $DEHYST_CREDENTIALS. Raises BusError if no
    daemon answers, or if several do and no name was given.
    """

    @python_function
    def __init__(
        self,
        name: str | None = None,
        connect: str | Sequence[str] | None = None,
        base: str = "dehyst",
        label: str = "",
        credentials: str | Path | None = None,
    ) -> None:
        bus, addresses = open_bus(connect, credentials)
        try:
            names = find_daemons(bus, base, addresses, lambda found: chosen_of(found, name))
            if (chosen := chosen_of(names, name)) is None:
                raise BusError(not_chosen(names, name, ", ".join(addresses)))
            self._begin(bus, Keys(base, chosen), label, new_number())
        except BaseException:
            bus.close()
            raise

    @classmethod
    def of_axis(cls, bus: Bus, keys: Keys, label: str, number: int) -> Self:
        """Return a client that shares its connection and client number with others."""
        client = cls.__new__(cls)
        client._begin(bus, keys, label, number)
        return client

    def _begin(self, bus: Bus, keys: Keys, label: str, number: int) -> None:
        self._connected(bus, keys)
        self.client = number
        self.commanding = threading.RLock()
        self.report: Report = ignore  # receives messages for the user while a trajectory plays
        self.label = (label or f"client {os.getpid()} on {socket.gethostname()}")[:64]
        self.together: tuple[Client, ...] = (self,)
        self._lease = self._sequence = 0
        self._senders: dict[str, Any] = {}

    def close(self) -> None:
        """Give up the lease and close the connection. Safe to call twice."""
        self.give_up()
        self.bus.close()

    def give_up(self) -> None:
        """Give up the lease, so that others need not wait until it expires."""
        if not self._lease or not self.bus.is_of_this_process:
            return
        patience_s, self.patience_s = self.patience_s, 0.0
        try:
            self._ask(self._request("give-up"), timeout_s=0.5)
        except DehystError as error:
            log.debug("the lease runs out by itself: %s", error)
        self.patience_s, self._lease = patience_s, 0

    # -- commands -------------------------------------------------------------------------------

    def acquire(self) -> None:
        """Take the command lease. Raises Refusal if another client holds it."""
        self._take("acquire")

    def take_over(self) -> None:
        """Take the command lease from whoever holds it."""
        self._take("take-over")

    def renew(self) -> None:
        """Renew the lease without sending a command."""
        self._command(lambda: self._request("renew"))

    @python_function
    def send(self, value: float, allow_unreachable: bool = False, stay: bool = False) -> Reply:
        """Go to `value` and wait for the daemon's answer. Raises Refusal with the reason.

        A set-point expires after `setpoint.stale_s` of the daemon's configuration; send it again
        before then to stay. stay: it remains valid until the next command, even after this client
        has disconnected; refused unless the daemon's configuration has `setpoint.stay = true`.
        """
        return self._command(lambda: self._setpoint(value, allow_unreachable, stay))

    @python_function
    def hold(self, stay: bool = False) -> Reply:
        """Hold the present voltage for `setpoint.hold_s`; stay: as for send. The stage may creep:
        `send` keeps the position, `hold` keeps the voltage."""
        return self._command(lambda: msgspec.structs.replace(self._request("hold"), stay=stay))

    @python_function
    def put(self, value: float, allow_unreachable: bool = False) -> None:
        """Go to `value` without waiting for an answer, for programs that send hundreds of
        set-points per second. Refusals appear only in `feed().rejections`. The first call takes the
        lease."""
        self.bus.check_process()
        with self.commanding:
            if not self._lease:
                self.acquire()
            if "setpoint" not in self._senders:
                key = self.keys.pubsub(subject(SETPOINT, self.unit), str(self.client))
                self._senders["setpoint"] = self.bus.sender(key, SETPOINT)
            self._senders["setpoint"].put(encoding.encode(self._setpoint(value, allow_unreachable)))

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
    ) -> Reply:
        """Send the next points of a trajectory. correction: learned correction of each point, added
        to its target; axes: names of all axes that play it together. Raises Refusal."""
        return self._command(
            lambda: Chunk(
                client=self.client,
                lease=self._lease,
                trajectory=trajectory,
                index=index,
                sent_ns=clock.monotonic_ns(),
                unit=self.unit,
                offset_ns=np.asarray(offset_ns, "<i8").tobytes(),
                value=np.asarray(value, "<f8").tobytes(),
                correction=b"" if correction is None else np.asarray(correction, "<f8").tobytes(),
                last=last,
                allow_unreachable=allow_unreachable,
                axes=tuple(axes),
            )
        )

    @python_function
    def play(
        self,
        t_s: ArrayLike,
        value: ArrayLike,
        allow_unreachable: bool = False,
        progress: Callable[[float, float], None] | None = None,
        on_samples: Callable[[NDArray[Any]], None] | None = None,
        lead_s: float = LEAD_S,
        repeat: int = 1,
    ) -> Played:
        """Stream a trajectory, (n,) times [s] and (n,) targets, and wait for its end.

        progress(played_s, total_s) is called several times per second; on_samples receives the
        telemetry; lead_s: how much of the trajectory is sent ahead; repeat: number of passes,
        separated by one typical step; 0: until an interrupt. Raises Refusal, or BusError if the
        daemon is gone for longer than the points sent ahead last. An interrupt stops the motion and
        is raised again.
        """
        points = Repeated(t_s, value, repeat)
        return play(self, points, allow_unreachable, progress, on_samples, lead_s)

    def play_learning(
        self,
        points: Repeated,
        lessons: "LessonTaker",
        allow_unreachable: bool = False,
        progress: Callable[[float, float], None] | None = None,
    ) -> Played:
        """Stream a trajectory whose corrections are learned from pass to pass: see
        `dehyst play --learn` and dehyst.daemon.client.play_learning."""
        return play(self, points, allow_unreachable, progress, None, LEARNING_LEAD_S, lessons)

    @python_function
    def move_zero(self, shift: float) -> None:
        """Add `shift` to every gauge reading from now on."""
        self._command(lambda: self._request("zero", shift))

    def decide_offer(self, action: Literal["accept", "reject"], number: int) -> None:
        """Accept or reject the doctor's offer with this number. Needs no lease. Raises Refusal."""
        self._send_request(msgspec.structs.replace(self._request(action), offer=number))

    def stop(self, axes: Sequence[str] = ()) -> None:
        """Drop all targets: the output holds, then ramps to the safe voltage; while a device has
        failed, once it is back. Needs no lease. axes: names of the controller's axes to stop with
        the same message, including this one."""
        self._send_request(msgspec.structs.replace(self._request("stop"), axes=tuple(axes)))

    def release(self, axes: Sequence[str] = ()) -> None:
        """Drop all targets and ramp to the safe voltage now. Needs no lease. axes: as for stop."""
        self._send_request(msgspec.structs.replace(self._request("release"), axes=tuple(axes)))

    # -- parts ----------------------------------------------------------------------------------

    def _ask(self, command: Command, timeout_s: float = TIMEOUT_S) -> Reply:
        answer = self._one("command", encoding.encode(command), timeout_s)
        reply: Reply = encoding.decode(Reply, answer)
        return reply

    def _send_request(self, command: Command) -> Reply:
        reply = self._ask(command)
        if not reply.ok:
            raise Refusal(reply.code, reply.text)
        return reply

    def _command(self, make: Callable[[], Command]) -> Reply:
        """Send a command under the lease; if the gateway was restarted, acquire the lease again
        once. Commands are serialized: all threads share the client's lease and sequence numbers."""
        self.bus.check_process()  # before the lock, which another thread may have held at the fork
        with self.commanding:
            if not self._lease:
                self.acquire()
            reply = self._ask(make())
            if not reply.ok and reply.code == "no-lease":
                self.acquire()
                reply = self._ask(make())
        if not reply.ok:
            raise Refusal(reply.code, reply.text)
        return reply

    def _take(self, action: Action) -> None:
        """Take the lease for all axes that are commanded together, or for none."""
        self.bus.check_process()
        with self.commanding:
            self._lease = 0
            request = self._request(action)
            if len(self.together) > 1:
                axes = tuple(client.name for client in self.together)
                request = msgspec.structs.replace(request, axes=axes)
            lease = self._send_request(request).lease
            for client in self.together:
                client._lease = lease

    def _request(self, action: Action, value: float = 0.0) -> Request:
        return Request(
            client=self.client,
            lease=self._lease,
            sent_ns=clock.monotonic_ns(),
            action=action,
            value=value,
            label=self.label,
        )

    def _setpoint(self, value: float, allow_unreachable: bool, stay: bool = False) -> Setpoint:
        self._sequence += 1
        return Setpoint(
            client=self.client,
            lease=self._lease,
            sequence=self._sequence,
            sent_ns=clock.monotonic_ns(),
            value=float(value),
            unit=self.unit,
            allow_unreachable=allow_unreachable,
            stay=stay,
        )
