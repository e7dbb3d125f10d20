"""The gateway process: between the rings and the bus. The loop never waits for it.

Three threads: the publisher (rings to bus, every `telemetry.batch_s`), the commander (clients to
command ring), the librarian (longer questions). zenoh's own threads only fill their queues. It
may be killed and started again at any time: the place where it was stands in the rings.
"""

import logging
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

from dehyst.daemon import clock, notify
from dehyst.daemon.admission import Admission
from dehyst.daemon.bus import Bus
from dehyst.daemon.commander import Commander
from dehyst.daemon.config import Config
from dehyst.daemon.corelink import CoreLink
from dehyst.daemon.files import load_model
from dehyst.daemon.keys import Keys
from dehyst.daemon.lease import Lease
from dehyst.daemon.librarian import Librarian
from dehyst.daemon.publisher import Publisher
from dehyst.daemon.records import MODEL_IN_USE
from dehyst.daemon.security import client_settings, server_settings
from dehyst.models.errors import BadModel
from dehyst.models.model import Model

log = logging.getLogger(__name__)
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
        model = _model(config)
        keys, link = Keys(config.bus.base, config.name), CoreLink(config.directory)
        lease = Lease(round(config.setpoint.lease_s * clock.NS))
        unit = model.displacement_unit
        admission = Admission(unit, config.setpoint.queue_s, config.setpoint.stale_s, lease)
        with Bus.serve(config.bus.listen, config.bus.connect, _security(config, keys)) as bus:
            started_ns = clock.monotonic_ns()
            units = (unit, model.drive_unit)
            publisher = Publisher(config, units, bus, keys, link, admission, started_ns)
            commander = Commander(bus, keys, link, admission)
            librarian = Librarian(config, unit, publisher)
            publisher.tick(started_ns)  # attach first: the first question finds an answer
            bus.listen(keys.setpoints(), commander.put)
            bus.answer(keys.rpc("command"), commander.ask)
            for method in ("status", "model", "configuration", "history"):
                bus.answer(keys.rpc(method), librarian.ask)
            bus.announce(keys.alive())
            threads = [
                self._thread("commander", commander.run),
                self._thread("librarian", librarian.run),
                self._thread("watch", publisher.watch.run),
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


def _security(config: Config, keys: Keys) -> dict[str, Any] | None:
    """Authentication, and access control unless a router does that; None: loopback only."""
    auth, listen = config.bus.auth, config.bus.listen
    if auth is None:
        return None
    if auth.credentials:
        return client_settings(auth.credentials)
    return server_settings(
        keys, listen, auth.operators, auth.observers, auth.passwords, auth.certificates
    )


def _model(config: Config) -> Model:
    """The model that the loop runs: its own copy where there is one, else the configured file."""
    try:
        return load_model(config.directory / MODEL_IN_USE)
    except BadModel:
        return load_model(config.model.file)


def run_gateway(config: Config) -> int:
    """Entry of the gateway process: until SIGTERM or SIGINT; exit code."""
    gateway = Gateway(config)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: gateway.end())
    sys.setswitchinterval(SWITCH_S)
    return 0 if gateway.run() else 1
