"""The gateway process: connects the rings to the bus. The loop never waits for it.

One gateway serves all axes of a controller. Its threads: the publisher (rings to bus, every
`telemetry.batch_s`), the command intake (clients to command rings), the answers to queries, and,
for each axis, the mismatch watch and the doctor's desk. zenoh's own threads only fill their queues.
It can be killed and restarted at any time, since its read positions are stored in the rings.
"""

import logging
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from dehyst import __version__
from dehyst.daemon import clock, notify
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import VERSION, Keys
from dehyst.daemon.bus.messages import Status
from dehyst.daemon.bus.security import client_settings, server_settings
from dehyst.daemon.bus.session import Asked, Bus, BusError, Nobody
from dehyst.daemon.config import Config, Controller
from dehyst.daemon.gateway import refused_starts
from dehyst.daemon.gateway.answers import Answers
from dehyst.daemon.gateway.axis import ServedAxis
from dehyst.daemon.gateway.command_intake import CommandIntake
from dehyst.daemon.gateway.loop_records import trust
from dehyst.daemon.gateway.publisher import Publisher, Served
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.mismatch.monitor import compile_monitor

log = logging.getLogger(__name__)
ROUTER_S = 1.0  # for a router to connect, and for an answer through it
SWITCH_S = 0.0005
"""Switch interval of Python's threads [s]: a tenth of the default."""


def refuse_older_clients(asked: Asked) -> None:
    """Answer a client that uses an older bus version with a message that it displays."""
    asked.refuse(
        f"this daemon (dehyst {__version__}) speaks {VERSION} of the bus; update the client: "
        "pip install --upgrade dehyst"
    )
    asked.done()


class Gateway:
    """One gateway process. `run()` returns after `end()`, True if nothing went wrong."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.stop = threading.Event()
        self._broken = self._ending = False

    def end(self) -> None:
        """Request the end; safe in a signal handler (setting an Event, which locks, is not)."""
        self._ending = True

    def run(self) -> bool:
        """Serve until `end()`. Raises DehystError if it cannot start."""
        controller, configs, net = self.controller, self.controller.axes, self.controller.bus
        refuse_namesakes(controller)
        if any(config.watch.enabled for config in configs):
            compile_monitor()  # compiling in a thread later would block the others
        if self._ending:  # end() was called during compilation
            return True
        with Bus.serve(net.listen, net.connect, security_of(controller)) as bus:
            served = Served(
                controller.name,
                tuple(config.name for config in configs if config.axis),
                clock.monotonic_ns(),
                refused_starts.take_refusals(controller.directory),
                bus.watch_links(),
            )
            axes = [ServedAxis(config, bus, served) for config in configs]
            intake, answers, history = CommandIntake([a.inbox for a in axes]), Answers(), Answers()
            for axis in axes:
                axis.publisher.tick(served.started_ns)  # the first query finds a status
                self._open(bus, axis, intake, answers, history)
            for axis in axes:  # announced last: a client that sees one finds them all
                bus.announce(axis.keys.alive())
                for alive, questions in axis.keys.older():
                    bus.answer(questions, refuse_older_clients)
                    bus.announce(alive)
            threads = [
                self._thread("intake", intake.run),
                self._thread("answers", answers.run),
                self._thread("history", history.run),
                *(self._thread("watch", axis.publisher.mismatch_watch.run) for axis in axes),
                *(self._thread("doctor", axis.publisher.doctor_desk.run) for axis in axes),
            ]
            notify.send("READY=1")
            where = (*net.listen, *(f"the router {r}" for r in net.connect))
            log.info("gateway of %s listens at %s", controller.name, ", ".join(where))
            try:
                self._publish([axis.publisher for axis in axes])
            finally:
                notify.send("STOPPING=1")
                self.stop.set()
                for thread in threads:
                    thread.join(timeout=2.0)
        return not self._broken

    @staticmethod
    def _open(
        bus: Bus, axis: ServedAxis, intake: CommandIntake, answers: Answers, history: Answers
    ) -> None:
        """Serve the keys of one axis."""
        keys, inbox = axis.keys, axis.inbox
        axis.publisher.mismatch_watch.trust = lambda yes: intake.pass_to_loop(inbox, trust(yes))
        bus.listen(keys.setpoints(), partial(intake.put, inbox))
        bus.answer(keys.rpc("command"), partial(intake.ask, inbox))
        for method in ("status", "model", "configuration", "events", "doctor", "report"):
            bus.answer(keys.rpc(method), partial(answers.ask, axis))
        bus.answer(keys.rpc("history"), partial(history.ask, axis))

    def _publish(self, publishers: Sequence[Publisher]) -> None:
        watchdog_s = notify.watchdog_s() or 1.0
        notified_ns = 0
        batch_ns = round(self.controller.telemetry.batch_s * clock.NS)
        due_ns = clock.monotonic_ns()
        while not (self._ending or self.stop.is_set()):
            now_ns = clock.monotonic_ns()
            for publisher in publishers:
                publisher.tick(now_ns)
            if now_ns - notified_ns >= min(watchdog_s, 1.0) * clock.NS:
                notified_ns = now_ns
                notify.send("WATCHDOG=1", f"STATUS={'; '.join(p.summary() for p in publishers)}")
            due_ns = max(due_ns + batch_ns, now_ns)
            clock.sleep_s(max(0.0, (due_ns - clock.monotonic_ns()) * 1e-9))

    def _thread(self, name: str, run: Callable[[threading.Event], None]) -> threading.Thread:
        def guarded() -> None:
            try:
                run(self.stop)
            except BaseException:
                log.exception("the %s failed; the gateway ends", name)
                self._broken = True
                self.stop.set()

        thread = threading.Thread(target=guarded, name=name, daemon=True)
        thread.start()
        return thread


def refuse_namesakes(controller: Controller) -> None:
    """Raise BadInput if a daemon with the name of one of the axes answers at one of our routers, as
    clients could not distinguish the two. A router that is down is skipped."""
    net = controller.bus
    credentials = net.auth.credentials if net.auth is not None else ""
    for router in net.connect:
        try:
            with Bus.connect([router], ROUTER_S, client_settings(credentials)) as bus:
                for axis in controller.axes:
                    _refuse_a_namesake(bus, axis, router)
        except BusError as error:
            log.info("no other %s at %s: %s", controller.name, router, error)


def _refuse_a_namesake(bus: Bus, axis: Config, router: str) -> None:
    with suppress(Nobody):
        for answer in bus.ask(Keys(axis.bus.base, axis.name).rpc("status"), timeout_s=ROUTER_S):
            status = encoding.decode(Status, answer)
            raise BadInput(
                f"a daemon named {axis.name} is on the bus of {router} already (its "
                f"gateway is process {status.gateway.pid} of its machine, up for "
                f"{status.gateway.uptime_s:.0f} s); give one of the two another name"
            )


def security_of(controller: Controller) -> dict[str, Any] | None:
    """Return the authentication settings, and access control unless a router does that; None:
    loopback only."""
    bus = controller.bus
    auth, listen = bus.auth, bus.listen
    keys = [Keys(bus.base, axis.name) for axis in controller.axes]
    if auth is None:
        return None
    if auth.credentials:
        return client_settings(auth.credentials)
    return server_settings(
        controller.name,
        keys,
        listen,
        auth.operators,
        auth.observers,
        auth.passwords,
        auth.certificates,
    )


def run_gateway(controller: Controller) -> int:
    """Run the gateway process until SIGTERM or SIGINT and return its exit code. Raises DehystError
    if it cannot start; the next gateway that can start reports it."""
    gateway = Gateway(controller)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: gateway.end())
    sys.setswitchinterval(SWITCH_S)
    try:
        return 0 if gateway.run() else 1
    except DehystError as error:
        refused_starts.add(controller.directory, str(error))
        raise
