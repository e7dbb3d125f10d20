"""Moves a stage to a position and reports its arrival, for scans and experiment control.

    with dehyst.Positioner() as stage:
        for place in (2.0, 4.0, 6.0):
            stage.go(place).result()             # there, and kept there
            print(stage.read(0.1).result().measured)

A thread repeats the set-point before it expires, so the stage stays where it was sent while this
program runs; when the program dies, the daemon holds and then ramps to its safe voltage, as for
every client. Every call returns a future; its exception is the daemon's own answer.
"""

import logging
import math
import os
import queue
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dehyst.daemon import clock
from dehyst.daemon.called import python_function
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.player import PATIENCE_S
from dehyst.daemon.client.readings import Flight, Reading, mean_of, model_place
from dehyst.daemon.client.staying import IN_PASSING, POLL_S, REPEATS, SHARE, Stopped, Stops
from dehyst.daemon.client.telemetry import NOTHING, TelemetryStream
from dehyst.daemon.client.tracking import Tracking
from dehyst.daemon.closing import Closing
from dehyst.models.errors import BadInput, DehystError, NotNow

log = logging.getLogger(__name__)
WORDS = {
    "model": "according to the model",
    "gauge": "according to the gauge",
    "model-alone": "according to the model alone",
}
NOISES = 3.0  # standard errors of the mean that are attributed to noise


@dataclass
class _Going:
    """A set-point that the stage is moving to."""

    value: float
    future: "Future[Reading]"
    end_ns: int
    near_since_ns: int = 0
    """Time of the first sample in the unbroken run within tolerance; 0: none."""
    near: list[NDArray[Any]] = field(default_factory=list)
    """The samples of this run."""
    blind: bool = False
    """True if the newest samples have no valid reading."""


@dataclass
class _Collecting:
    """A request for the mean of the samples from now on."""

    seconds: float
    future: "Future[Reading]"
    end_ns: int
    parts: list[NDArray[Any]]


class Positioner(Closing):
    """Moves one axis to positions and along trajectories.

    connect: makes the Client, in the thread that uses it; None: `Client()`. tolerance: distance
    that counts as on target, in the stage's unit (0: 0.2 % of the reach); settle_s: how long the
    stage must stay within it; by: what decides arrival: "model" (it predicts when the motion is
    over; the gauge must give valid readings, and if it disagrees a warning is logged and
    Reading.agrees is False), "gauge", or "model-alone" for a stage without gauge readings;
    timeout_s: a position not reached by then is an error. Raises what the client raises.
    """

    @python_function
    def __init__(
        self,
        connect: Callable[[], Client] | None = None,
        *,
        tolerance: float = 0.0,
        settle_s: float = 0.05,
        by: Literal["model", "gauge", "model-alone"] = "model",
        timeout_s: float = 30.0,
    ) -> None:
        if by not in WORDS:
            raise BadInput(f"by={by!r}: one of {', '.join(WORDS)}")
        self.settle_s, self.by, self.timeout_s = settle_s, by, timeout_s
        self._process = os.getpid()
        self._jobs: queue.SimpleQueue[Callable[[Client], None] | None] = queue.SimpleQueue()
        self._going: _Going | None = None
        self._collecting: list[_Collecting] = []
        self._held: float | None = None
        self._repeat_ns = self._refused_ns = 0
        self._wall_offset_ns = 0
        self._stops = Stops()
        ready: Future[tuple[str, str, tuple[float, float], float, float]] = Future()
        make = connect if connect is not None else lambda: Client(label="positioner")
        self._thread = threading.Thread(target=self._live, args=(make, ready), daemon=True)
        self._thread.start()
        # without `close`, zenoh's threads would still run when the interpreter shuts down
        weakref.finalize(self, _end, self._stops, self._jobs, self._thread, self._process)
        self.name, self.unit, self.reach, self.period_s, self._stale_s = ready.result()
        self.tolerance = tolerance or SHARE * (self.reach[1] - self.reach[0])

    # -- public calls, from any thread -----------------------------------------------------------

    def go(self, value: float) -> "Future[Reading]":
        """Go to `value` and stay; the future gives the reading there once the stage has arrived.
        A new call during a motion redirects the stage at once, and the earlier future fails."""
        future: Future[Reading] = Future()
        self._do(lambda client: self._begin_going(client, float(value), future), future)
        return future

    def read(self, seconds: float = 0.0) -> "Future[Reading]":
        """Return the mean of the samples of the next `seconds`, at least one sample."""
        future: Future[Reading] = Future()
        self._do(lambda _: self._begin_collecting(seconds, future), future)
        return future

    def fly(self, t_s: ArrayLike, value: ArrayLike) -> "Future[Flight]":
        """Play a trajectory, (n,) times [s] and (n,) targets, and stay at its end; the future gives
        all its samples."""
        future: Future[Flight] = Future()
        times, targets = np.array(t_s, float), np.array(value, float)
        before = self._stops.count
        self._do(lambda client: self._fly(client, times, targets, before, future), future)
        return future

    def stop(self) -> None:
        """Stop the stage where it is. It then follows the daemon's `[setpoint]`: hold, then ramp to
        the safe voltage. The future of a motion in progress fails."""
        self._stops.add()
        done: Future[None] = Future()
        self._do(lambda client: self._stop(client, done), done)
        done.result()

    def close(self) -> None:
        """Release the stage and close the connection. Safe to call twice."""
        if os.getpid() != self._process:
            return
        self._stops.add()
        self._jobs.put(None)
        self._thread.join()

    # -- the thread ------------------------------------------------------------------------------

    def _do(self, job: Callable[[Client], None], future: "Future[Any]") -> None:
        def guarded(client: Client) -> None:
            try:
                job(client)
            except Exception as error:  # the caller gets it through the future
                _settle(future, error=error)

        if os.getpid() != self._process:
            raise NotNow(
                "this positioner was made before the process was forked and cannot be used here: "
                "make a new Positioner in the child"
            )
        if not self._thread.is_alive():
            raise NotNow("the positioner is closed")
        self._jobs.put(guarded)

    def _live(self, connect: Callable[[], Client], ready: "Future[Any]") -> None:
        try:
            with connect() as client:
                status, stale_s = client.wait_until_started(), client.config().setpoint.stale_s
                reach, period_s = (status.reach_min, status.reach_max), status.period_ns * 1e-9
                self._listen(client)
                ready.set_result((client.name, status.unit, reach, period_s, stale_s))
                try:
                    while self._step(client):
                        pass
                finally:
                    self._fail("the positioner was closed")
        except BaseException as error:
            if ready.done():
                raise
            ready.set_exception(error)

    def _listen(self, client: Client) -> None:
        self._stream = client.stream()

    def _step(self, client: Client) -> bool:
        """Run one turn of the thread; return False when it should end."""
        try:
            job = self._jobs.get_nowait()
            if job is None:
                return False
            job(client)
        except queue.Empty:
            pass
        try:
            self._stay(client)
        except DehystError as error:  # another client commands, or the daemon is gone
            self._held = None
            self._fail(str(error))
        samples = self._stream.read(POLL_S)
        if samples.size:
            self._wall_offset_ns = self._stream.wall_offset_ns
            self._judge(samples)
            self._collect(samples)
        self._look_at_the_clock()
        return True

    def _stay(self, client: Client) -> None:
        """Repeat the set-point before it expires; send it again if it was refused as late or as one
        too many."""
        now_ns = clock.monotonic_ns()
        if self._held is None or now_ns < self._repeat_ns:
            return
        try:
            client.send(self._held)
        except Refusal as error:
            self._refused_ns = self._refused_ns or now_ns
            if error.code not in IN_PASSING or now_ns - self._refused_ns > PATIENCE_S * clock.NS:
                raise
            return
        self._refused_ns = 0
        self._repeat_ns = now_ns + round(self._stale_s / REPEATS * clock.NS)

    def _begin_going(self, client: Client, value: float, future: "Future[Reading]") -> None:
        self._leave("another position was requested")
        client.acquire()  # this repeats no set-point that another client has stopped
        client.send(value)
        now_ns = clock.monotonic_ns()
        self._held, self._repeat_ns = value, now_ns
        self._going = _Going(value, future, now_ns + round(self.timeout_s * clock.NS))

    def _begin_collecting(self, seconds: float, future: "Future[Reading]") -> None:
        end_ns = clock.monotonic_ns() + round((seconds + self.timeout_s) * clock.NS)
        self._collecting.append(_Collecting(seconds, future, end_ns, []))

    def _judge(self, samples: NDArray[Any]) -> None:
        """Check whether the stage has arrived, within tolerance for settle_s."""
        going = self._going
        if going is None:
            return
        place = samples["measured"] if self.by == "gauge" else model_place(samples)
        meant = samples["target"] == going.value
        near = meant & (np.abs(place - going.value) <= self.tolerance)
        if self.by == "model":  # without a reading the stage's position is unknown
            near &= np.isfinite(samples["measured"])
            going.blind = bool(meant.any()) and not np.isfinite(samples["measured"]).any()
        for i, (sample, is_near) in enumerate(zip(samples, near.tolist(), strict=True)):
            if not is_near:
                going.near_since_ns, going.near = 0, []
                continue
            at_ns = int(sample["scheduled_ns"])
            going.near_since_ns = going.near_since_ns or at_ns
            going.near.append(samples[i : i + 1])
            if at_ns - going.near_since_ns >= self.settle_s * clock.NS:
                self._going = None
                self._arrived(going)
                return

    def _arrived(self, going: "_Going") -> None:
        """Report the position, and whether the gauge confirms it."""
        there = mean_of(np.concatenate(going.near), self._wall_offset_ns)
        noise = NOISES * there.spread / math.sqrt(max(there.samples, 1))
        agrees = there.finite and abs(there.error) <= self.tolerance + noise
        if there.finite and not agrees:
            log.warning(
                "%s: at %g %s by the %s, but the gauge reads %+.3g %s from it (tolerance %.2g %s); "
                'by="gauge" waits for the gauge',
                *(self.name, going.value, self.unit, self.by, there.error, self.unit),
                *(self.tolerance, self.unit),
            )
        _settle(going.future, replace(there, by=self.by, agrees=agrees))

    def _collect(self, samples: NDArray[Any]) -> None:
        for one in list(self._collecting):
            one.parts.append(samples)
            first, last = one.parts[0]["scheduled_ns"][0], samples["scheduled_ns"][-1]
            if last - first >= (one.seconds - self.period_s) * clock.NS:
                self._collecting.remove(one)
                whole = np.concatenate(one.parts)
                until = whole["scheduled_ns"] - first <= max(one.seconds, 0.0) * clock.NS
                _settle(one.future, mean_of(whole[until], self._wall_offset_ns))

    def _look_at_the_clock(self) -> None:
        now_ns = clock.monotonic_ns()
        if self._going is not None and now_ns > self._going.end_ns:
            blind = "; the gauge gives no valid reading" if self._going.blind else ""
            self._leave(
                f"not within {self.tolerance:g} {self.unit} of {self._going.value:g} after "
                f"{self.timeout_s:g} s, {WORDS[self.by]}{blind}"
            )
        for one in [one for one in self._collecting if now_ns > one.end_ns]:
            self._collecting.remove(one)
            _settle(one.future, error=NotNow("no telemetry arrived"))

    def _fly(
        self,
        client: Client,
        t_s: NDArray[np.float64],
        value: NDArray[np.float64],
        stops: int,
        future: "Future[Flight]",
    ) -> None:
        """Play a trajectory until its end or the next stop. stops: number of stops requested before
        the trajectory was."""
        self._leave("a trajectory was requested")
        self._held = None
        parts: list[NDArray[Any]] = []

        def look(*_: Any) -> None:
            self._stops.check(stops)

        def take(samples: NDArray[Any]) -> None:
            parts.append(samples)
            look()

        self._stream.close()
        try:
            look()
            played = client.play(t_s, value, progress=look, on_samples=take)
        except Stopped:
            client.stop()
            raise NotNow("the trajectory was stopped") from None
        finally:
            self._listen(client)
        samples = np.concatenate(parts) if parts else NOTHING
        samples = Tracking(played.tracking.first_seq, played.tracking.expected).add(samples)
        if played.completed:
            self._held, self._repeat_ns = float(value[-1]), 0
        wall_ns = samples["scheduled_ns"] + self._wall_offset_ns
        _settle(future, Flight(played, samples, wall_ns * 1e-9))

    def _stop(self, client: Client, done: "Future[None]") -> None:
        self._held = None
        client.stop()
        self._leave("it was stopped")
        _settle(done)

    def _leave(self, why: str) -> None:
        if self._going is not None:
            going, self._going = self._going, None
            why = f"{going.value:g} {self.unit} not reached: {why}"
            _settle(going.future, error=NotNow(why))

    def _fail(self, why: str) -> None:
        """Fail all pending futures with `why`."""
        self._leave(why)
        for one in self._collecting:
            _settle(one.future, error=NotNow(why))
        self._collecting = []

    _stream: TelemetryStream


def _settle(future: "Future[Any]", result: Any = None, error: BaseException | None = None) -> None:
    """Set a future's result or exception, unless its owner has cancelled it."""
    with suppress(InvalidStateError):
        if error is not None:
            future.set_exception(error)
        else:
            future.set_result(result)


def _end(
    stops: Stops,
    jobs: "queue.SimpleQueue[Any]",
    thread: threading.Thread,
    process: int,
) -> None:
    """Close a positioner that the program did not close; does nothing in a forked child."""
    if os.getpid() == process and thread is not threading.current_thread():
        stops.add()
        jobs.put(None)
        thread.join()
