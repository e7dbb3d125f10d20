"""Pairs of simultaneous faults for the chaos tests, where an owner would notice the combination."""

import os
import signal
import time
from collections.abc import Callable

import numpy as np
from tests.rigs.chaos.faults import check_glide
from tests.rigs.chaos.rig import SAFE_V, Rig, lives, until

from dehyst.daemon.rings.records import Flag, State


def unplug_without_gateway(rig: Rig) -> str:
    """amplifier unplugged while the network's process is dead"""
    before, run = rig.pid("gateway"), rig.status().run
    rig.bench_order(fault="unplug", device="mdt693b", for_s=2.0)
    rig.kill("gateway")
    until(lambda: rig.status().gateway.pid != before, 60.0, "the gateway is back")
    rig.until_event("actuator: back", 30.0)
    assert rig.status().run == run, "the loop was disturbed"
    rig.until_running(30.0)
    assert State.FAULT in rig.states()
    assert set(np.diff(rig.samples()["seq"])) == {1}, "telemetry has a gap"
    return "fault and recovery are known to the next gateway, telemetry without a gap"


def kill_core_unplugged(rig: Rig) -> str:
    """kill -9 of the loop's process while the amplifier is unplugged"""
    restarts = rig.status().gateway.restarts_of_core
    text = "could not be brought to its safe state"
    said = rig.words("run").count(text)
    rig.bench_order(fault="unplug", device="mdt693b")
    rig.until_state(State.FAULT)
    rig.kill("core")
    begun_ns = time.monotonic_ns()
    until(lambda: rig.words("run").count(text) > said, 60.0, "it is said")
    rig.bench_order(clear=True)
    until(lambda: rig.status().gateway.restarts_of_core > restarts, 90.0, "the core is back")
    rig.check_ramped(begun_ns)
    return f"output at {SAFE_V:g} V as soon as it could be reached, core started again"


def kill_both(rig: Rig) -> str:
    """kill -9 of loop and network at once"""
    gateway, core = rig.pid("gateway"), rig.pid("core")
    for pid in (gateway, core):
        os.kill(pid, signal.SIGKILL)
    until(lambda: not lives(gateway) and not lives(core), 5.0, "both are gone")
    begun_ns = time.monotonic_ns()
    until(lambda: rig.status().gateway.pid != gateway, 60.0, "the gateway is back")
    until(lambda: rig.status().core_alive and rig.status().pid != core, 60.0, "the core is back")
    rig.check_ramped(begun_ns)
    return f"output ramped to {SAFE_V:g} V, both started again"


def kill_supervisor(rig: Rig) -> str:
    """kill -9 of `dehyst run` itself"""
    pids = [rig.pid("core"), rig.pid("gateway")]
    rig.daemon.kill()
    rig.daemon.wait(5.0)
    begun_ns = time.monotonic_ns()
    until(lambda: not any(map(lives, pids)), 60.0, "loop and network end with it")
    assert abs(rig.bench_order()["output_v"] - SAFE_V) < 0.01
    rig.check_ramped(begun_ns)
    rig.daemon = rig.start("run", "--config", str(rig.config), name="run")
    return f"loop and network end with it, output ramped to {SAFE_V:g} V; started again by hand"


def hub_unplugged(rig: Rig) -> str:
    """amplifier and sensor unplugged together"""
    rig.bench_order(fault="unplug", device="both", for_s=1.5)
    rig.until_state(State.FAULT)
    rig.until_event("actuator: back", 30.0)
    rig.until_event("sensor: back", 30.0)
    return "fault, both reconnected"


def sensor_lost_while_reloading(rig: Rig) -> str:
    """sensor unplugged while a broken model file is loaded"""
    good = rig.model.read_text()
    rig.bench_order(fault="unplug", device="ksg101", for_s=1.5)
    try:
        rig.model.write_text(good[: len(good) // 2])
        os.kill(rig.daemon.pid, signal.SIGHUP)
        rig.until_event("reload refused", 20.0)
    finally:
        rig.model.write_text(good)
    until(lambda: rig.flags() & Flag.SENSOR_INVALID, 10.0, "the sensor flag")
    rig.until_event("sensor: back", 30.0)
    assert State.FAULT not in rig.states()
    return "old model stays, readings flagged as invalid, reconnected"


def stop_both(rig: Rig, seconds: float = 2.0) -> str:
    """SIGSTOP of loop and network at once"""
    pids = [rig.pid("gateway"), rig.pid("core")]

    def stand_still() -> None:
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        begun_ns = time.monotonic_ns()
        try:
            time.sleep(seconds)
            rig.check_held(begun_ns)
        finally:
            for pid in pids:
                os.kill(pid, signal.SIGCONT)

    check_glide(rig, stand_still)
    assert set(np.diff(rig.samples()["seq"])) == {1}, "telemetry has a gap"
    return "output held, then glided to the target; telemetry without a gap"


PAIRS: tuple[Callable[[Rig], str], ...] = (
    unplug_without_gateway, kill_core_unplugged, hub_unplugged, sensor_lost_while_reloading,
    stop_both, kill_both, kill_supervisor,
)  # fmt: skip
