"""Rings are cut short and overwritten under a real daemon: nothing stops `dehyst safe`, damage is
reported and the ring replaced, and the processes continue."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.gateway_bench import follows
from tests.rigs.processes import dehyst, until
from tests.rigs.service import SAFE_V, Service

from dehyst.daemon.client.client import Client
from dehyst.models.errors import DehystError


def sent(client: Client) -> bool:
    """Return whether a set-point was accepted."""
    try:
        return client.send(4.0).ok
    except DehystError:
        return False


def damage(path: Path, how: str) -> None:
    """Damage a ring: cut it short, or overwrite its header or all of it with random bytes."""
    rng = np.random.default_rng(5)
    if how == "cut":
        os.truncate(path, 4096)
        return
    size = 128 if how == "header" else path.stat().st_size
    with open(path, "r+b") as file:
        file.write(rng.bytes(size))


@pytest.mark.parametrize("how", ["cut", "header", "all"])
def test_safe_and_a_new_start_with_a_damaged_ring(service: Service, how: str) -> None:
    service.start()
    assert service.high() > 60.0
    core = service.core_pid()
    assert service.supervisor is not None
    service.supervisor.kill()  # both, so that neither cleans up after the other
    os.kill(core, signal.SIGKILL)
    service.supervisor.wait(10.0)
    until(lambda: not service.core_pid(), 10.0, "the core has gone")
    for name in ("telemetry", "status", "event", "command"):
        damage(service.folder / "run" / f"{name}.ring", how)
    assert service.output() > SAFE_V + 10.0  # it may have begun to ramp down before the kill
    safe = dehyst("safe", "--config", str(service.config))
    _, words = safe.communicate(timeout=60)
    assert safe.returncode == 0, words
    assert "Traceback" not in words
    assert service.output() == pytest.approx(SAFE_V, abs=0.02)
    service.start()
    until(lambda: "not known" in service.rings.events(), 20.0, "the event")
    assert "telemetry.ring" in service.rings.events()
    assert "Traceback" not in service.words()


@pytest.mark.parametrize("name", ["status", "event", "telemetry", "command"])
def test_random_bytes_in_a_ring_that_is_in_use(service: Service, name: str) -> None:
    service.start()
    with service.client() as client:
        until(lambda: follows(client), 60.0, "the core follows commands")
        client.send(5.0)
        before = client.status()
        for _ in range(3):
            damage(service.folder / "run" / f"{name}.ring", "all")
            seen = client.status().time_ns
            until(lambda n=seen: client.status().time_ns > n, 20.0, "a status")
        until(lambda: f"{name}.ring was damaged" in service.words(), 20.0, "it is said")
        after = client.status()
        assert (after.pid, after.gateway.pid) == (before.pid, before.gateway.pid)
        assert after.core_alive
        stream = client.stream()
        until(
            lambda: sent(client) and 4.0 in stream.read(0.3)["target"],
            20.0,
            "the set-point is followed",
        )
    assert "Traceback" not in service.words()


@pytest.mark.parametrize("name", ["telemetry", "event"])
def test_a_ring_cut_short_in_use_costs_a_restart_at_most(service: Service, name: str) -> None:
    """A ring that is cut short in use costs at most a restart: if the loop accesses the missing
    part before it notices, the kernel ends it."""
    service.start()
    with service.client() as client:
        until(lambda: follows(client), 60.0, "the core follows commands")
        service.high()
        damage(service.folder / "run" / f"{name}.ring", "cut")

        def again() -> bool:
            if "was damaged" in service.words() or "core ended" in service.words():
                return status() is not None and status().core_alive
            return False

        def status() -> Any:
            try:
                return client.status()
            except DehystError:  # the gateway may have ended too
                return None

        until(again, 60.0, lambda: f"it goes on\n{service.words()}\n{status()}")
        until(lambda: status() is not None and status().state != "start", 20.0)
        stream = client.stream()
        until(
            lambda: sent(client) and 4.0 in stream.read(0.3)["target"],
            30.0,
            "the set-point is followed",
        )
    assert service.supervisor is not None
    assert service.supervisor.poll() is None
    assert "Traceback" not in service.words()
