"""The faults of the chaos tests that only several axes have: faults of one axis, faults of all.

As in faults.py: each one is applied to a running rig (AxesRig: x and y play, z rests), returns what
happened, and raises AssertionError if the daemon does not do what it must. After each of them the
rig checks that z never moved and that y kept to range and slew.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from tests.rigs.chaos.axes_rig import AxesRig
from tests.rigs.chaos.rig import StoodStill, samples_since, until
from tests.rigs.processes import ATTEMPTS, say_repeated

from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.group import Group
from dehyst.daemon.rings.records import Flag, State
from dehyst.models.errors import DehystError


def _states(rig: AxesRig, axis: str, since_ns: int = 0) -> set[State]:
    samples = rig.samples() if axis == "x" else rig.samples_of(axis)
    samples = samples[samples["scheduled_ns"] >= since_ns] if samples.size else samples
    return {State(int(s)) for s in np.unique(samples["state"])} if samples.size else set()


def _check_x_undisturbed(rig: AxesRig, since_ns: int = 0) -> None:
    samples = samples_since(max(since_ns, rig.since_ns), rig.heard("x"))
    assert set(np.diff(samples["seq"])) == {1}, "telemetry of x has a gap"
    states = {State(int(s)) for s in np.unique(samples["state"])}
    assert states == {State.RUNNING}, f"x was disturbed: {states}"


def _judged(rig: AxesRig, part: Callable[[], None], check: Callable[[int], None]) -> None:
    """Do a part of a fault, then check what was undisturbed since its beginning [ns]. If something
    was disturbed, but the loop stood still (the amplifier may then time out, and a glide begins),
    it is repeated. Raises StoodStill after ATTEMPTS of them."""
    why = StoodStill()
    for attempt in range(ATTEMPTS):
        if attempt:
            say_repeated("a fault of one axis", str(why))
        rig.until_running()
        begun_ns = time.monotonic_ns()
        part()
        try:
            return check(begun_ns)
        except AssertionError:
            try:
                rig.check_never_still(samples_since(begun_ns, rig.heard("x")))
            except StoodStill as still:
                why = still
            else:
                raise
    raise why


@contextmanager
def _y_alone(rig: AxesRig) -> Iterator[Client]:
    """Yield a client of the test's own that commands y; the one that played it is stopped
    meanwhile."""
    rig.end_beside()
    try:
        with Client("chaos-y", rig.address, label="test") as client:
            client.take_over()
            yield client
    finally:
        rig.start_beside()


def gauge_of_y(rig: AxesRig, seconds: float = 1.5) -> str:
    """the gauge of y reads NaN, then its cable is pulled"""
    for order in ({"fault": "nan"}, {"fault": "unplug", "device": "ksg101"}):
        rig.bench_order(**order, axis="y", for_s=seconds)
        until(lambda: _flags(rig, "y") & Flag.SENSOR_INVALID, 10.0, "the flag of y")
        until(
            lambda: np.isfinite(rig.samples_of("y")["measured"][-1]), 30.0, "the gauge of y is back"
        )
        time.sleep(0.3)
    assert _states(rig, "y") == {State.RUNNING}, _states(rig, "y")
    flags = np.bitwise_or.reduce(rig.samples_of("z")["flags"]) | rig.flags()
    assert not flags & Flag.SENSOR_INVALID, "x or z is flagged for the gauge of y"
    _check_x_undisturbed(rig)
    return "y flagged, played on open loop; x and z not disturbed"


def _flags(rig: AxesRig, axis: str) -> int:
    samples = rig.samples_of(axis)
    return int(np.bitwise_or.reduce(samples["flags"])) if samples.size else 0


def y_beyond_reach(rig: AxesRig) -> str:
    """y is sent beyond its reach"""
    with _y_alone(rig) as client:
        refused = ""
        try:
            client.send(1e3)
        except Refusal as refusal:
            refused = refusal.code
        assert refused == "unreachable", refused or "taken"
        for far in (1e3, -1e3):
            end = time.monotonic() + 1.5
            while time.monotonic() < end:
                client.send(far, allow_unreachable=True)
                time.sleep(0.2)
            until(lambda: _flags(rig, "y") & Flag.UNREACHABLE, 10.0, "the flag of y")
    assert not rig.flags() & Flag.UNREACHABLE, "x is flagged for y"
    _check_x_undisturbed(rig)
    return "refused; where it insists held at the limit, flagged; x and z not disturbed"


def amplifier_gone(rig: AxesRig, seconds: float = 1.5) -> str:
    """serial cable of the amplifier pulled: that of all axes"""
    rig.bench_order(fault="unplug", device="mdt693b", for_s=seconds)
    for axis in "xyz":
        until(lambda a=axis: State.FAULT in _states(rig, a), 20.0, f"{axis} faults")
    for axis in "xyz":
        until(lambda a=axis: _last_state(rig, a) != State.FAULT, 30.0, f"{axis} is back")
    assert "DeviceGone" in rig.events(), rig.events()
    return "all three fault, all come back; x and y are approached anew"


def _last_state(rig: AxesRig, axis: str) -> State:
    samples = rig.samples() if axis == "x" else rig.samples_of(axis)
    return State(int(samples["state"][-1])) if samples.size else State.START


def leases_of_two(rig: AxesRig) -> str:
    """x and y are commanded by a client each, a third plays on all three axes"""

    def undisturbed(since_ns: int) -> None:
        _check_x_undisturbed(rig, since_ns)
        rig.check_undisturbed("y", since_ns)

    _judged(rig, lambda: _third_refused(rig), undisturbed)
    return "refused whole, with the name of who commands; z's lease is free, x and y play on"


def _third_refused(rig: AxesRig) -> None:
    t_s = np.arange(0.0, 2.0, 0.01)
    targets = {axis: np.full(t_s.size, 6.0) for axis in "xyz"}
    with Group("chaos", None, rig.address, label="third") as group:
        for order in (group.acquire, lambda: group.play(t_s, targets), lambda: group.send(
            dict.fromkeys("xyz", 6.0)
        )):  # fmt: skip
            reported: DehystError | None = None
            try:
                order()
            except DehystError as refusal:
                reported = refusal
            assert isinstance(reported, Refusal), reported or "all three may be commanded"
            assert reported.code == "lease-taken"
            assert "mover" in str(reported), reported
    assert rig.others["z"].client.status().gateway.lease_client == 0, "the lease of z is held"
    time.sleep(0.5)


def knob_of_y(rig: AxesRig) -> str:
    """the readback of y's channel alone contradicts what was set"""

    def undisturbed(since_ns: int) -> None:
        assert State.FAULT not in _states(rig, "z", since_ns), "z faults for y"
        _check_x_undisturbed(rig, since_ns)

    _judged(rig, lambda: _turn_the_knob_of_y(rig), undisturbed)
    return "y faults until the two agree; x and z not disturbed"


def _turn_the_knob_of_y(rig: AxesRig) -> None:
    begun_ns = time.monotonic_ns()
    rig.bench_order(amplifier={"readback_error_v": 150.0, "readback_error_axis": "y"})
    until(lambda: State.FAULT in _states(rig, "y", begun_ns), 20.0, "y faults")
    time.sleep(1.0)
    rig.bench_order(clear=True)
    until(lambda: _last_state(rig, "y") != State.FAULT, 30.0, "y is back")


AXES: tuple[Callable[[AxesRig], str], ...] = (
    gauge_of_y, y_beyond_reach, amplifier_gone, leases_of_two, knob_of_y,
)  # fmt: skip
