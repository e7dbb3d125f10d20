"""Keeps the axes of one controller where they were sent, for programs that serve other clients.

    with HeldAxes(lambda: Group()) as axes:
        axes.go({"x": 4.0})                  # accepted; poll `axes.look()["x"].on_target`
        axes.fly(t_s, {"x": x_um}, repeat=0)
        axes.stop()                          # at once, from any thread

A dedicated thread uses the Group: it repeats each set-point before it expires and reads the
telemetry. When this program dies or closes, the daemon holds and ramps to its safe voltage, as it
does for every client that disconnects. A second connection is reserved for `stop`, so that a stop
never waits for anything else.
"""

import queue
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.group import Group
from dehyst.daemon.client.player import PATIENCE_S
from dehyst.daemon.client.readings import AxisView, AxisViews
from dehyst.daemon.client.staying import IN_PASSING, POLL_S, REPEATS, SHARE, Stopped, Stops
from dehyst.daemon.client.telemetry import TelemetryStream
from dehyst.daemon.closing import Closing
from dehyst.models.errors import BadInput, DehystError, NotNow

ANSWER_S = 10.0
"""How long a caller waits for the daemon's answer [s]; exceeds the client's own patience."""
STATUS_S = 1.0
"""Interval at which reach and state are requested [s]; a model change is seen after this."""


class HeldAxes(Closing):
    """Commands the axes of one controller and keeps them in place.

    connect: makes the Group, called twice; tolerance: distance that counts as on target, in the
    stage's unit (0: 0.2 % of the reach); settle_s: how long an axis must stay within it; by: what
    decides arrival, the model (open loop: the predicted motion is over) or the gauge. Raises what
    the client raises.
    """

    def __init__(
        self,
        connect: Callable[[], Group],
        *,
        tolerance: float = 0.0,
        settle_s: float = 0.05,
        by: Literal["model", "gauge"] = "model",
    ) -> None:
        self._tolerance, self._views = tolerance, AxisViews(settle_s, by)
        self._jobs: queue.SimpleQueue[Callable[[Group], None] | None] = queue.SimpleQueue()
        self._stop_lock = threading.Lock()
        self._held: dict[str, float] = {}
        self._repeat_ns = self._asked_ns = self._silent_since_ns = 0
        self._stops, self._stops_seen, self._order = Stops(), 0, threading.Lock()
        self._taken = False  # without a target: the lease is still renewed
        self._stopper = connect()
        ready: Future[None] = Future()
        self._thread = threading.Thread(target=self._live, args=(connect, ready), daemon=True)
        self._thread.start()
        try:
            ready.result()
        except BaseException:
            self._stopper.close()
            raise
        self.name = self._stopper.name

    # -- from any thread -------------------------------------------------------------------------

    def look(self) -> dict[str, AxisView]:
        """Return the present state of each axis."""
        return self._views.look()

    def go(self, targets: Mapping[str, float]) -> None:
        """Go to a target per axis and stay; return when the daemon has accepted all of them. Raises
        BadInput outside the reach (nothing is sent), Refusal, NotNow."""
        before = self._stops.count
        self._call(lambda group: self._go(group, dict(targets), before))

    def take(self) -> None:
        """Take the command lease without moving, and keep it. Raises Refusal if another client
        holds it."""
        self._call(self._take)

    def fly(self, t_s: ArrayLike, targets: Mapping[str, ArrayLike], repeat: int = 1) -> None:
        """Start a trajectory, (n,) times [s] and (n,) targets per axis, played `repeat` times (0:
        until stopped), and stay at its end. Raises BadInput outside the reach, NotNow."""
        t = np.array(t_s, float)
        values = {axis: np.array(of_axis, float) for axis, of_axis in targets.items()}
        begun: Future[None] = Future()
        for axis, of_axis in values.items():
            self._check_reach(axis, float(of_axis.min()), float(of_axis.max()))
        with self._order:
            before = self._stops.count
            self._jobs.put(lambda group: self._fly(group, t, values, repeat, before, begun))
        _wait_for(begun)

    def stop(self) -> None:
        """Stop all axes at once; they then stay where the model predicts them to be."""
        self._stop_now()
        self._call(self._stay_here, stops=True)

    def let_go(self) -> None:
        """Stop all axes and give up the lease: the daemon holds, then ramps to its safe voltage."""
        self._stop_now()
        self._call(self._let_go, stops=True)

    def close(self) -> None:
        """Release the axes and close the connections. Safe to call twice."""
        self._stops.add()
        self._jobs.put(None)
        self._thread.join()
        with self._stop_lock:
            self._stopper.close()

    # -- the thread ------------------------------------------------------------------------------

    def _stop_now(self) -> None:
        """Stop all axes. An axis whose stop was not answered is not kept any longer."""
        self._stops.add()
        try:
            with self._stop_lock:
                self._stopper.stop()
        except DehystError as error:
            why = f"a stop was not answered: {error}"
            self._jobs.put(lambda _: self._lose(why))
            raise

    def _call(self, job: Callable[[Group], None], stops: bool = False) -> None:
        """Have the thread do a job, and wait for its end. stops: it also ends what was requested
        after the stop that preceded this call."""
        done: Future[None] = Future()

        def guarded(group: Group) -> None:
            if not done.set_running_or_notify_cancel():
                return  # its caller has learned that it failed
            try:
                job(group)
            except Exception as error:  # the caller gets it through the future
                done.set_exception(error)
            else:
                done.set_result(None)

        if not self._thread.is_alive():
            raise NotNow("the connection to the controller is closed")
        with self._order:
            if stops:
                self._stops.add()
            self._jobs.put(guarded)
        _wait_for(done)

    def _live(self, connect: Callable[[], Group], ready: "Future[None]") -> None:
        try:
            with connect() as group:
                configs = [c.config().setpoint for c in group.clients.values()]
                self._stale_s = min(min(one.stale_s, one.lease_s) for one in configs)
                self._streams = {axis: c.stream() for axis, c in group.clients.items()}
                self._ask(group)
                ready.set_result(None)
                while self._turn(group):
                    pass
                with suppress(DehystError):
                    self._stop_now()
        except BaseException as error:
            if ready.done():
                raise
            ready.set_exception(error)

    def _turn(self, group: Group) -> bool:
        """Run one turn of the thread; return False when it should end."""
        try:
            job = self._jobs.get_nowait()
        except queue.Empty:
            job = _do_nothing
        if job is None:
            return False
        try:
            job(group)
            self._stay(group)
            if clock.monotonic_ns() - self._asked_ns > STATUS_S * clock.NS:
                self._ask(group)
            self._silent_since_ns = 0
        except DehystError as error:
            # the gateway may be restarting; else another client commands
            passing = isinstance(error, BusError) or getattr(error, "code", "") in IN_PASSING
            now_ns = clock.monotonic_ns()
            self._silent_since_ns = self._silent_since_ns or now_ns
            if not passing or now_ns - self._silent_since_ns > PATIENCE_S * clock.NS:
                self._lose(str(error))
        self._listen(POLL_S)
        return True

    def _ask(self, group: Group) -> None:
        """Request the reach and period of each axis."""
        self._asked_ns = clock.monotonic_ns()
        for axis, status in group.status().items():
            low, high = status.reach_min, status.reach_max
            tolerance = self._tolerance or SHARE * (high - low)
            period_s = status.period_ns * 1e-9
            reach = {"unit": status.unit, "low": low, "high": high}
            self._views.change(axis, period_s=period_s, tolerance=tolerance, **reach)

    def _lose(self, why: str) -> None:
        for axis in self._held:
            self._views.change(axis, lost=why, moving=False, on_target=False, flying=False)
        self._held.clear()
        self._taken = False

    def _stay(self, group: Group) -> None:
        """Repeat the set-points before they expire, unless a stop has just been requested; without
        set-points, renew the lease."""
        now_ns = clock.monotonic_ns()
        if now_ns < self._repeat_ns or self._stops.count != self._stops_seen:
            return
        if self._held:
            group.send(self._held, allow_unreachable=True)  # checked before; the model may change
        elif self._taken:
            for client in group.clients.values():
                client.renew()
        else:
            return
        self._repeat_after(now_ns)

    def _repeat_after(self, now_ns: int) -> None:
        self._repeat_ns = now_ns + round(self._stale_s / REPEATS * clock.NS)

    def _check_reach(self, axis: str, low: float, high: float) -> None:
        view = self.look()[axis]
        if not (np.isfinite(low) and np.isfinite(high)):
            raise BadInput(f"axis {axis}: a target is NaN or infinite")
        if low < view.low or high > view.high:
            raise BadInput(
                f"axis {axis}: {low if low < view.low else high:g} {view.unit} cannot be reached: "
                f"the range is {view.low:g} to {view.high:g}"
            )

    def _take(self, group: Group) -> None:
        group.acquire()
        self._taken = True
        for axis in group.clients:
            self._views.change(axis, lost="", **({} if axis in self._held else {"asked": np.nan}))

    def _go(self, group: Group, targets: dict[str, float], before: int) -> None:
        """Send targets. before: number of stops requested before these targets were."""
        for axis, value in targets.items():
            self._check_reach(axis, value, value)
        self._check_stopped(before)
        group.acquire()  # this repeats no set-point that another client has stopped
        group.send(targets)
        self._hold(targets)

    def _check_stopped(self, before: int) -> None:
        """Raise NotNow if more than `before` stops have been requested."""
        try:
            self._stops.check(before)
        except Stopped:
            raise NotNow("it was stopped") from None
        self._stops_seen = before

    def _hold(self, targets: Mapping[str, float]) -> None:
        for axis, value in targets.items():
            self._held[axis] = value
            self._views.expect(axis, value)
        self._repeat_after(clock.monotonic_ns())

    def _stay_here(self, group: Group) -> None:
        """Hold the axes that were held at the position that the model now predicts."""
        self._stops_seen = self._stops.count
        self._listen(POLL_S)
        here = {
            axis: float(np.clip(view.predicted, view.low, view.high))
            for axis, view in self.look().items()
            if axis in self._held and np.isfinite(view.predicted)
        }
        self._held.clear()
        for axis in here:
            self._views.change(axis, flying=False)
        if here:
            try:
                group.acquire()  # the stop was sent by another connection
                group.send(here, allow_unreachable=True)
            except DehystError as error:
                for axis in here:
                    self._views.change(axis, lost=str(error), moving=False, on_target=False)
                raise
            self._hold(here)

    def _let_go(self, group: Group) -> None:
        """Give up the lease: the axes have no target any more."""
        self._stops_seen = self._stops.count
        self._lose("")
        for axis in group.clients:
            self._views.change(axis, asked=np.nan, lost="")
        for client in group.clients.values():
            client.give_up()

    def _listen(self, timeout_s: float) -> None:
        for place, (axis, stream) in enumerate(self._streams.items()):
            samples = stream.read(timeout_s if place == 0 else 0.0)
            if samples.size:
                self._views.hear(axis, samples, self._held.get(axis))

    def _fly(
        self,
        group: Group,
        t_s: NDArray[np.float64],
        values: dict[str, NDArray[np.float64]],
        repeat: int,
        before: int,
        begun: "Future[None]",
    ) -> None:
        """Play a trajectory to its end or to the next stop. before: number of stops requested
        before the trajectory was."""
        if not begun.set_running_or_notify_cancel():
            return  # its caller has learned that it failed
        others = {axis: value for axis, value in self._held.items() if axis not in values}

        def look(*_: Any) -> None:
            self._stops.check(before)
            if not begun.done():
                for axis in values:
                    self._held[axis] = float(values[axis][-1])
                    self._views.change(axis, flying=True, moving=True, on_target=False, lost="")
                begun.set_result(None)
            self._listen(0.0)
            if others and clock.monotonic_ns() >= self._repeat_ns:
                group.send(others, allow_unreachable=True)
                self._repeat_after(clock.monotonic_ns())

        why = ""
        try:
            self._check_stopped(before)
            played = group.play(t_s, values, progress=look, repeat=repeat)
            why = next((p.reason for p in played.values() if not p.completed), "")
        except Stopped:
            if not begun.done():
                begun.set_exception(NotNow("it was stopped"))
        except Exception as error:
            if not begun.done():
                begun.set_exception(error)
            why = str(error)
        if self._stops.count != before:
            self._stay_here(group)
            return
        for axis in values:
            self._views.change(axis, flying=False, moving=False)
        if begun.done() and not begun.exception() and not why:
            ends = {axis: float(of_axis[-1]) for axis, of_axis in values.items()}
            group.send(ends, allow_unreachable=True)
            self._hold(ends)
        elif why:
            for axis in values:
                self._held.pop(axis, None)
                self._views.change(axis, lost=why)

    _streams: dict[str, TelemetryStream]
    _stale_s: float


def _wait_for(done: "Future[None]") -> None:
    """Wait for the answer to a request. Raises its exception, or NotNow if there is no answer; a
    job that is then still waiting for its turn is never done."""
    try:
        done.result(ANSWER_S)
        return
    except TimeoutError:
        late = f"the controller did not answer within {ANSWER_S:g} s"
        if done.cancel():
            raise NotNow(f"{late}; it was not done") from None
    try:
        done.result(ANSWER_S)  # it has begun
    except TimeoutError:
        raise NotNow(late) from None


def _do_nothing(_: Group) -> None:
    """Do nothing, in a turn without a job."""
