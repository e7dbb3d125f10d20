"""A series of random faults: what a successful write() promises always holds."""

import contextlib
import random
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.interface import DriverError
from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.mdt693b.settings import Mdt693bConfig

STEP_V = 0.5
PATIENCE_S = 60.0
HALF_LSB_V = 2.75e-3 / 2 + 1e-9


def disturb(chance: random.Random, emulator: Mdt693bEmulator) -> str:
    """Switch on one random fault and return its name."""
    kind = chance.choice(
        ["delay", "mute", "hang", "half", "garbage", "stale", "noise", "stall", "unplug", "calm"]
    )
    match kind:
        case "delay":
            emulator.fault(count=chance.randint(1, 2), delay_s=chance.choice([0.03, 0.24, 0.45]))
        case "mute":
            emulator.fault(mute=True)
        case "hang":
            emulator.fault(hang=True)
        case "half":
            emulator.fault(count=1, half=True)
        case "garbage":
            emulator.fault(count=1, garbage=True)
        case "stale":
            stale = chance.choice([b"*", b">", b"!", b"CMD_NOT_DEFINED>", b"[ 12.00]\r>"])
            emulator.fault(count=1, after_reply=stale)
        case "noise":
            emulator.fault(count=1, before_reply=chance.choice([b"\0", b"\n", b"\xff", b"x"]))
        case "stall":
            emulator.stall_writes(True)
        case "unplug":
            emulator.unplug()
    return kind


def bring_up(connect: Callable[[], None], after: str) -> None:
    """Call until it succeeds: the time-outs here are short, and late replies may still arrive."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        with contextlib.suppress(DriverError):
            return connect()
    raise AssertionError(f"{after}: never came back")


def soak(folder, dialect: str, seed: int, steps: int) -> dict[str, int]:
    """Walk in small steps under faults; return how many writes succeeded and failed."""
    chance = random.Random(seed)
    moves: list[float] = []
    knobs = Mdt693bKnobs(
        dialect=dialect, latency_s=0.0, jitter_s=0.0, readback_lag_s=0.0, start_v=50.0, seed=seed
    )
    emulator = Mdt693bEmulator(folder / "port", knobs, lambda axis, v, t: moves.append(v))
    counts = {"written": 0, "failed": 0, "reconnected": 0}
    with emulator:
        moves.clear()
        config = Mdt693bConfig(emulator.port, timeout_s=0.15, write_timeout_s=0.09, idle_s=0.045)
        driver = Mdt693b(config, sleep=lambda seconds: None)
        bring_up(driver.open, "start")
        for _ in range(steps):
            # Faults accumulate: a late reply may come in while the next set is lost.
            fault = disturb(chance, emulator) if chance.random() < 0.7 else ""
            for _ in range(chance.randint(1, 3)):
                goal_v = round(driver.output() + chance.uniform(-STEP_V, STEP_V), 3)
                try:
                    driver.write(min(max(goal_v, 10.0), 140.0))
                except DriverError:
                    counts["failed"] += 1
                else:
                    counts["written"] += 1
                    true_v = emulator.output_v()
                    error = f"{fault}: {driver.output()} V acknowledged, output at {true_v} V"
                    assert abs(true_v - driver.output()) <= HALF_LSB_V, error
            if chance.random() < 0.3:
                time.sleep(chance.choice([0.0, 0.06, 0.3]))
            if chance.random() < 0.5:
                continue
            emulator.clear_faults()
            emulator.plug()
            if chance.random() < 0.5 or fault == "unplug":
                bring_up(driver.reconnect, fault)
                counts["reconnected"] += 1
        driver.close()
    jumps = [abs(b - a) for a, b in zip([50.0, *moves], moves, strict=False)]
    # A set with an unknown result may have been carried out; the next may start from before it.
    assert max(jumps) <= 3 * STEP_V + 0.5
    return counts


@pytest.mark.parametrize("dialect", ["1.05", "1.10"])
def test_no_fault_makes_the_driver_claim_what_is_not_so(tmp_path, dialect):
    """Six walks run in parallel, since they mostly wait; a failure's message names its fault."""
    seeds = range(1, 7)
    for seed in seeds:
        (tmp_path / str(seed)).mkdir()
    with ThreadPoolExecutor(3) as pool:
        walks = [pool.submit(soak, tmp_path / str(seed), dialect, seed, 25) for seed in seeds]
        counts = {seed: walk.result() for seed, walk in zip(seeds, walks, strict=True)}
    for seed, count in counts.items():
        assert count["written"] >= 10, f"seed {seed}: {count}"
        assert count["failed"] >= 5, f"seed {seed}: {count}"
        assert count["reconnected"] >= 1, f"seed {seed}: {count}"
