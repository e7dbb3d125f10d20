"""The gateway process: between the rings and the bus. The loop never waits for it.

Its threads: the publisher (rings to bus, every `telemetry.batch_s`), the command intake (clients to
command ring), the answers to longer questions, the mismatch watch, the doctor's desk. zenoh's own
threads only fill their queues. It may be killed and started again at any time: the place where it
was stands in the rings.
"""

import logging
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

from dehyst.daemon import clock, notify
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Status
from dehyst.daemon.bus.security import client_settings, server_settings
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.config import Config
from dehyst.daemon.gateway import refused_starts
from dehyst.daemon.gateway.admission import Admission, trust
from dehyst.daemon.gateway.answers import Answers
from dehyst.daemon.gateway.command_intake import CommandIntake
from dehyst.daemon.gateway.core_rings import CoreRings
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.gateway.publisher import Publisher
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.mismatch.monitor import compile_monitor

log = logging.getLogger(__name__)
ROUTER_S = 1.0
SWITCH_S = 0.0005
"""How long a Python thread keeps the others waiting: a tenth of the default."""


class Gateway:
    """One gateway process. `run()` returns after `end()`: True when nothing went wrong."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.stop = threading.Event()
        self._broken = self._ending = False

    def end(self) -> None:
        """Ask for the end; may be called from a signal handler (an Event's lock may not)."""
        self._ending = True

    def run(self) -> bool:
        """Serve until `end()`. Raises DehystError where it cannot begin."""
        config = self.config
        keys, rings = Keys(config.bus.base, config.name), CoreRings(config.directory)
        lease = Lease(round(config.setpoint.lease_s * clock.NS))
        admission = Admission("", config.setpoint.queue_s, config.setpoint.stale_s, lease)
        refuse_a_namesake(config, keys)
        if config.watch.enabled:
            compile_monitor()  # a thread that compiles would keep the others from answering
        with Bus.serve(config.bus.listen, config.bus.connect, security_of(config)) as bus:
            started_ns = clock.monotonic_ns()
            publisher = Publisher(config, bus, keys, rings, admission, started_ns)
            intake = CommandIntake(bus, keys, rings, admission)
            publisher.mismatch_watch.trust = lambda trusted: intake.tell_loop(trust(trusted))
            admission.decide_offer = publisher.doctor_desk.decide
            answers, history = (Answers(config, publisher) for _ in range(2))
            publisher.tick(started_ns)  # attach first: the first question finds an answer
            bus.listen(keys.setpoints(), intake.put)
            bus.answer(keys.rpc("command"), intake.ask)
            for method in ("status", "model", "configuration", "events", "doctor", "report"):
                bus.answer(keys.rpc(method), answers.ask)
            bus.answer(keys.rpc("history"), history.ask)
            bus.announce(keys.alive())
            threads = [
                self._thread("intake", intake.run),
                self._thread("answers", answers.run),
                self._thread("history", history.run),
                self._thread("watch", publisher.mismatch_watch.run),
                self._thread("doctor", publisher.doctor_desk.run),
            ]
            notify.send("READY=1")
            where = (*config.bus.listen, *(f"the router {r}" for r in config.bus.connect))
            log.info("gateway of %s is reached at %s", config.name, ", ".join(where))
            try:
                self._publish(publisher)
            finally:
                notify.send("STOPPING=1")
                self.stop.set()
                for thread in threads:
                    thread.join(timeout=2.0)
        return not self._broken

    def _publish(self, publisher: Publisher) -> None:
        watchdog_s = notify.watchdog_s() or 1.0
        told_ns = 0
        batch_ns = round(self.config.telemetry.batch_s * clock.NS)
        due_ns = clock.monotonic_ns()
        while not (self._ending or self.stop.is_set()):
            now_ns = clock.monotonic_ns()
            publisher.tick(now_ns)
            if now_ns - told_ns >= min(watchdog_s, 1.0) * clock.NS:
                told_ns = now_ns
                notify.send("WATCHDOG=1", f"STATUS={publisher.summary()}")
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


def refuse_a_namesake(config: Config, keys: Keys) -> None:
    """Raises BadInput where a daemon of this name answers at one of our routers: clients could
    not tell the two apart. A router that is not up is not asked."""
    credentials = config.bus.auth.credentials if config.bus.auth is not None else ""
    for router in config.bus.connect:
        try:
            with Bus.connect([router], ROUTER_S, client_settings(credentials)) as bus:
                for answer in bus.ask(keys.rpc("status"), timeout_s=ROUTER_S):
                    status = encoding.decode(Status, answer)
                    raise BadInput(
                        f"a daemon named {config.name} is on the bus of {router} already (its "
                        f"gateway is process {status.gateway.pid} of its machine, up for "
                        f"{status.gateway.uptime_s:.0f} s); give one of the two another name"
                    )
        except BusError as error:
            log.info("no other %s at %s: %s", config.name, router, error)


def security_of(config: Config) -> dict[str, Any] | None:
    """Authentication, and access control unless a router does that; None: loopback only."""
    auth, listen = config.bus.auth, config.bus.listen
    keys = Keys(config.bus.base, config.name)
    if auth is None:
        return None
    if auth.credentials:
        return client_settings(auth.credentials)
    return server_settings(
        keys, listen, auth.operators, auth.observers, auth.passwords, auth.certificates
    )


def run_gateway(config: Config) -> int:
    """Entry of the gateway process: until SIGTERM or SIGINT; exit code. Raises DehystError where
    it cannot begin; the next one that can tells of it."""
    gateway = Gateway(config)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: gateway.end())
    sys.setswitchinterval(SWITCH_S)
    try:
        return 0 if gateway.run() else 1
    except DehystError as error:
        refused_starts.add(config.directory, str(error))
        raise
