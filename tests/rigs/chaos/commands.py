"""The faults of the chaos tests that clients cause: wrong, old, huge and far too many commands.

As in faults.py: each one is applied to a running rig, returns what happened, and raises
AssertionError if the daemon does not do what it must.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from tests.rigs.chaos.rig import ROOT, Rig, until

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import Setpoint, Status
from dehyst.daemon.bus.session import Sender
from dehyst.daemon.bus.topics import SETPOINT, subject
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.clock import monotonic_ns
from dehyst.daemon.rings.records import State
from dehyst.models.errors import DehystError

FLOODERS = 3
EXCUSES = ("stall", "steal", "suspended", "preempted", "driver_io")
"""Causes of missed deadlines that are not the daemon's fault but the machine's, or that of the
emulated amplifier, which shares the processor with the flood."""


def two_clients(rig: Rig) -> str:
    """two clients that both command"""
    with Client(rig.name, rig.address, label="second") as second:
        reported: Refusal | None = None
        try:
            second.send(5.0)
        except Refusal as refusal:
            reported = refusal
    assert reported is not None, "both clients may command"
    assert reported.code == "lease-taken"
    assert "mover" in str(reported)
    until(rig.states, 10.0, "telemetry after it")
    assert rig.states() == {State.RUNNING}, "the first one was disturbed"
    return "the second learns who commands"


@contextmanager
def alone(rig: Rig) -> Iterator[Client]:
    """Yield a client of the test's own that holds the lease; the mover is stopped meanwhile."""
    assert rig.mover is not None
    rig.kill("client")
    rig.mover.wait(5.0)
    try:
        with Client(rig.name, rig.address, label="hostile") as client:
            client.take_over()
            yield client
    finally:
        rig.start_mover()


def _sender(rig: Rig, client: Client) -> Sender:
    key = client.keys.pubsub(subject(SETPOINT, client.unit), str(client.client))
    return client.bus.sender(key, SETPOINT)


def bad_setpoints(rig: Rig) -> str:
    """set-points from the past, out of order, repeated, NaN, out of range, wrong unit or schema"""
    with alone(rig) as client:
        client.send(6.0)
        good = client._setpoint(6.5, False)
        sender = _sender(rig, client)
        ahead = _like(good, sequence=1000)
        sender.put(encoding.encode(ahead))
        until(lambda: rig.target() == 6.5, 10.0, "the good one is followed")
        cases: dict[str, tuple[str, dict[str, Any]]] = {
            "out of order": ("old", {"sequence": 999, "value": 9.0}),
            "repeated": ("old", {"sequence": 1000, "value": 9.0}),
            "from the past": ("late", {"sent_ns": monotonic_ns() - 10**10}),
            "NaN": ("not-finite", {"value": float("nan")}),
            "out of range": ("unreachable", {"value": 1e4}),
            "other unit": ("unit", {"unit": "furlong"}),
            "other lease": ("no-lease", {"lease": 12345}),
            "other schema": ("bad-message", {}),
        }
        for name, (code, changes) in cases.items():
            rig.mark_fault()

            def refused(name: str = name, code: str = code, changes: Any = changes) -> bool:
                client.renew()  # the lease lasts for a second
                fresh = {"sequence": 10**6, "sent_ns": monotonic_ns()}
                payload = encoding.encode(_like(good, **{**fresh, **changes}))
                if name == "other schema":
                    payload = payload.replace(b"dehyst.setpoint", b"dehyst.setpoing")
                sender.put(payload)  # sent twice, because a set-point on the bus may be lost
                time.sleep(0.2)
                return code in rig.refusals()

            until(refused, 20.0, f"{name}: refusal {code}")
            _none_followed(rig)
        rig.mark_fault()
        client._sequence = 10**5
        client.send(6.0)  # a valid one is still accepted
        until(lambda: rig.target() == 6.0, 10.0, "the good one is followed")
        _none_followed(rig)
    codes = dict.fromkeys(code for code, _ in cases.values())
    return f"each refused by its code: {', '.join(codes)}"


def _none_followed(rig: Rig) -> None:
    """Check that no target since the mark is one of the refused ones, which are 9 um and more."""
    until(lambda: rig.samples().size, 10.0, "telemetry")
    targets = rig.samples()["target"]
    followed = targets[targets > 8.9]  # NaN while nothing is followed
    assert followed.size == 0, f"a wrong one was followed: {followed.max()}"


def _like(setpoint: Setpoint, **changes: object) -> Setpoint:
    values = {name: getattr(setpoint, name) for name in setpoint.__struct_fields__}
    return Setpoint(**{**values, **changes})


def long_message(rig: Rig) -> str:
    """a message of 10 MB"""
    with alone(rig) as client:
        pid = rig.pid("gateway")
        with suppress(DehystError):
            _sender(rig, client).put(b"x" * 10_000_000)
        time.sleep(0.5)
        until(lambda: rig.status().gateway.pid == pid, 20.0, "the gateway stands")
    return "dropped before it is read; the gateway goes on"


def flood(rig: Rig, seconds: float = 5.0, processes: int = FLOODERS) -> str:
    """a flood of set-points from the client that commands"""
    with alone(rig) as client:
        client.send(6.0)
        taken = rig.status().gateway.commands

        def stop_in_the_midst() -> None:
            status = rig.status()
            who = status.gateway
            assert who.lease_client == client.client, f"the lease is lost: {who.rejected}"
            assert who.commands > taken + 100, "the newest is not taken"
            assert status.state == "running", f"{status.state}: {who.rejected}"
            with Client(rig.name, rig.address, label="second") as second:
                try:
                    second.acquire()
                except Refusal as refusal:
                    assert refusal.code == "lease-taken"  # noqa: PT017
                else:
                    raise AssertionError("the lease is lost")
                second.stop()  # answered in the middle of it

        said = _flooded(
            rig, client.client, client._lease, seconds, processes, stop_in_the_midst, client.renew
        )
        assert rig.status().state != "running", "the flood has undone the stop of another"
        client.acquire()
        client.send(6.0)
        rig.mark_fault()
        rig.client.stop()
        rig.until_state(State.HOLDING, 20.0)
    return f"{said}; newest taken, lease kept, a stop got through and held"


STOOD_STILL_NS = 100_000_000
"""Between two samples: ten periods. The loop has a real-time priority; no flood takes it away."""


def stranger_floods(rig: Rig, seconds: float = 5.0, processes: int = FLOODERS) -> str:
    """a flood of set-points from somebody who has no lease"""

    def refused() -> int:
        return rig.status().gateway.rejected.get("lease-taken", 0)

    for _ in range(3):  # while the machine itself stands still, the amplifier times out
        rig.until_running()
        begun_ns, before = time.monotonic_ns(), refused()

        def played_on(before: int = before) -> None:
            until(lambda: refused() > before + 100, 10.0, "refusals")

        said = _flooded(rig, 66, 1, seconds, processes, played_on)
        samples = rig.samples()
        samples = samples[samples["scheduled_ns"] > begun_ns]
        if np.diff(samples["actual_ns"]).max() < STOOD_STILL_NS:
            break
    states = {State(int(s)).name for s in np.unique(samples["state"])}
    assert states == {"RUNNING"}, f"{states}, {rig.events()}"
    assert np.all(np.isfinite(samples["target"])), "the trajectory ran dry"
    return f"{said}; all refused, the trajectory played on"


def _flooded(
    rig: Rig,
    client: int,
    lease: int,
    seconds: float,
    processes: int,
    during: Callable[[], None],
    meanwhile: Callable[[], None] = lambda: None,
) -> str:
    """Send set-points in this client's name from several processes; return a description."""
    key = rig.client.keys.pubsub(subject(SETPOINT, rig.client.unit), str(client))
    script = str(ROOT / "tests" / "rigs" / "chaos" / "flood.py")
    arguments = [rig.address, key, str(client), str(lease), str(seconds)]
    pids = (rig.pid("core"), rig.pid("gateway"))
    before = rig.status()
    flooders = [
        subprocess.Popen(
            [sys.executable, script, *arguments], env=rig.environment, cwd=ROOT,
            stdout=subprocess.PIPE, text=True,
        )
        for _ in range(processes)
    ]  # fmt: skip
    try:

        def begun() -> bool:
            meanwhile()  # the processes take a while to start
            return _of(rig.status()) > _of(before) + 2000

        until(begun, 60.0, "the flood")
        time.sleep(0.2 * seconds)
        memory = [_memory_mb(pid) for pid in pids]
        during()
        said = [flooder.communicate(timeout=60.0)[0].split() for flooder in flooders]
        after = rig.status()
        grown = max(_memory_mb(pid) - was for pid, was in zip(pids, memory, strict=True))
    finally:
        for flooder in flooders:
            flooder.kill()
            flooder.wait(5.0)
    offered = sum(int(count) / float(spent) for count, spent in said) * 1e-3
    assert (after.pid, after.gateway.pid) == pids, "a process did not survive"
    assert grown < 20.0, f"memory grew by {grown:.0f} MB"
    samples = rig.samples()
    assert set(np.diff(samples["seq"])) == {1}, "telemetry has a gap"
    missed = _own_missed(after) - _own_missed(before)
    assert missed <= 0.1 * samples.size, f"{missed} missed of {samples.size}: {after.missed_by}"
    heard = (_of(after) - _of(before)) / seconds * 1e-3
    return (
        f"{offered:.0f} kHz offered for {seconds:g} s by {processes} processes, "
        f"{heard:.0f} kHz read; {missed} deadlines missed by the loop, "
        f"memory grew by {max(0.0, grown):.0f} MB"
    )


def _of(status: Status) -> int:
    """Return the number of commands that the gateway has decided on or discarded."""
    return status.gateway.commands + status.gateway.rejected.get("flood", 0)


def _own_missed(status: Status) -> int:
    return status.missed - sum(status.missed_by.get(cause, 0) for cause in EXCUSES)


def _memory_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return 0.0


COMMANDS: tuple[Callable[[Rig], str], ...] = (
    two_clients, bad_setpoints, long_message, flood, stranger_floods,
)  # fmt: skip
