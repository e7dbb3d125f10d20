"""Command one controller for one person, through a separate client with its own lease.

Commands run in a thread, one at a time; the next one ends the one before. A set-point is repeated
before it goes stale, for the requested time and while the browser is connected. A trajectory is
stopped when its browser disconnects. The daemon then holds and ramps by itself.
"""

import logging
import threading
from collections.abc import Callable, Mapping, Set
from functools import partial
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import Reply
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.group import Group
from dehyst.daemon.page.watching import Watch
from dehyst.models.errors import DehystError

log = logging.getLogger(__name__)
Say = Callable[[str, bool], None]
"""Send the person a text; True: it is an error."""
Task = Callable[[Client, threading.Event], None]
LONGEST_S = 86_400.0  # a day
LEAST_PAUSE_S = 0.02
"""Shortest pause between two repetitions of a hold, for a daemon that holds only very briefly."""
SETTLE_S = 4.0
"""Longest wait for a command in progress to end."""


class Ended(DehystError):
    """The motion was ended by the next command, or by the end of the page."""


class Commander:
    """Commands for one controller by one person."""

    def __init__(self, watch: Watch, label: str, say: Say) -> None:
        self._watch, self._label, self._say = watch, label, say
        self._tasks: SimpleQueue[tuple[Task | None, threading.Event]] = SimpleQueue()
        self._over = threading.Event()
        self._waiting, self._settled = 0, threading.Condition()
        self.number = 0  # of its client; 0: no client yet
        self._thread = threading.Thread(target=self._run, name="command", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the running command and release the lease; returns at once."""
        self._begin(None)

    def go(self, value: float, seconds: float, take_over: bool) -> None:
        """Go to a set-point and stay there for `seconds`."""

        def task(client: Client, over: threading.Event) -> None:
            _take(client, take_over)
            if over.is_set():  # connecting may take seconds
                return
            client.send(value)
            config = self._watch.config or client.config()
            pause_s = min(config.setpoint.stale_s, config.setpoint.lease_s) / 4
            end_ns = clock.monotonic_ns() + round(min(seconds, LONGEST_S) * clock.NS)
            self._say(f"going to {value:g} {client.unit}, held for {seconds:g} s", False)
            while (left_s := (end_ns - clock.monotonic_ns()) / clock.NS) > 0:
                if over.wait(min(pause_s, left_s)):
                    return
                client.send(value)

        self._begin(task)

    def hold(self, target: float, seconds: float, take_over: bool) -> None:
        """Hold the stage for `seconds`: at the target if it is within the reach, else at the
        present voltage. target: NaN for none."""

        def task(client: Client, over: threading.Event) -> None:
            _take(client, take_over)
            if over.is_set():
                return
            config = self._watch.config or client.config()
            words = f"holding {target:g} {client.unit}"
            again: Callable[[], Reply] = partial(client.send, target)
            try:
                if not np.isfinite(target):
                    raise Refusal("unreachable", "there is no target")
                again()
            except Refusal as refused:
                if refused.code != "unreachable":
                    raise
                words, again = "holding the present voltage", client.hold
                again()
            lasts_s = min(config.setpoint.stale_s, config.setpoint.lease_s, config.setpoint.hold_s)
            end_ns = clock.monotonic_ns() + round(min(seconds, LONGEST_S) * clock.NS)
            self._say(f"{words} for {seconds:g} s", False)
            while (left_s := (end_ns - clock.monotonic_ns()) / clock.NS) > 0:
                if over.wait(min(max(lasts_s / 4, LEAST_PAUSE_S), left_s)):
                    return
                again()

        self._begin(task)

    def play(
        self, t_s: NDArray[np.float64], target: NDArray[np.float64], name: str, take_over: bool
    ) -> None:
        """Play a trajectory that has been checked, once, to its end."""

        def task(client: Client, over: threading.Event) -> None:
            def progress(_at_s: float, _total_s: float) -> None:
                if over.is_set():
                    raise Ended(f"{name} was ended")

            if take_over:
                client.take_over()
            if over.is_set():
                return
            self._say(f"playing {name}", False)
            played = client.play(t_s, target, progress=progress)
            if played.completed:
                rms = played.tracking.rms_error
                self._say(f"{name} played to the end, rms error {rms:.4g} {played.unit}", False)
            else:
                self._say(f"{name} ended early: {played.reason}", True)

        self._begin(task)

    def play_together(
        self,
        t_s: NDArray[np.float64],
        targets: Mapping[str, NDArray[np.float64]],
        name: str,
        take_over: bool,
        mine: Set[int],
    ) -> None:
        """Play a checked trajectory of several axes once, all on the same samples. mine: numbers of
        this person's own clients, whose leases are taken over without asking."""

        def task(client: Client, over: threading.Event) -> None:
            def progress(_at_s: float, _total_s: float) -> None:
                if over.is_set():
                    raise Ended(f"{name} was ended")

            w = self._watch
            controller = client.status().gateway.controller
            with Group(
                controller, list(targets), w.address, w.base, self._label, w.credentials
            ) as group:
                holders = {one.gateway.lease_client for one in group.status().values()}
                if take_over or holders <= {0, client.client, *mine}:
                    group.take_over()
                if over.is_set():
                    return
                self._say(f"playing {name} on {', '.join(targets)}", False)
                try:
                    played = group.play(t_s, dict(targets), progress=progress)
                except Ended:
                    group.stop()
                    raise
            wrong = next((one.reason for one in played.values() if not one.completed), "")
            errors = ", ".join(
                f"{axis} {one.tracking.rms_error:.4g} {one.unit}" for axis, one in played.items()
            )
            said = f"ended early: {wrong}" if wrong else f"played to the end, rms error {errors}"
            self._say(f"{name} {said}", bool(wrong))

        self._begin(task)

    def end_task(self) -> None:
        """End the running command, because another axis of the controller was stopped and this one
        with it."""
        self._over.set()

    def stop(self, at_once: bool) -> None:
        """Stop the stage, regardless of who commands it; at_once: ramp now. Raises BusError,
        Refusal."""
        self._over.set()
        with self._settled:
            busy = self._waiting > 0
        self._watch.stop(at_once)
        if busy:  # a set-point already sent may have arrived after the stop
            with self._settled:
                self._settled.wait_for(lambda: not self._waiting, SETTLE_S)
            self._watch.stop(at_once)

    def _begin(self, task: Task | None) -> None:
        self._over.set()
        self._over = threading.Event()
        with self._settled:
            self._waiting += 1
        self._tasks.put((task, self._over))

    def _run(self) -> None:
        client: Client | None = None
        cut_short = False
        w = self._watch
        while True:
            task, over = self._tasks.get()
            if task is None:
                break
            try:
                if not over.is_set():
                    client = client or Client(w.name, w.address, w.base, self._label, w.credentials)
                    self.number = client.client
                    task(client, over)
            except Ended as ended:
                self._say(str(ended), False)
            except DehystError as error:
                self._say(str(error), True)
            finally:
                cut_short = over.is_set()
                with self._settled:
                    self._waiting -= 1
                    self._settled.notify_all()
        if client is not None:
            if cut_short:
                stop_own(client)
            client.close()


def _take(client: Client, take_over: bool) -> None:
    """Take the lease for a new command; it may repeat the one that another client has stopped.
    Raises Refusal."""
    if take_over:
        client.take_over()
    else:
        client.acquire()


def stop_own(client: Client) -> None:
    """Stop the stage if this client has the lease."""
    try:
        if client.status().gateway.lease_client == client.client:
            client.stop()
    except DehystError as error:
        log.debug("the daemon holds by itself: %s", error)


def target_now(newest: Any) -> float:
    """Return the present target; NaN for none. newest: a TELEMETRY record, or None."""
    return float("nan") if newest is None else float(newest["target"])
