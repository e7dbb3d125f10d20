"""The faults of the chaos tests: each one is applied to a running rig and returns what happened.

A fault function raises AssertionError if the daemon does not do what it must. For all of them, the
caller checks range and slew of the output with the amplifier's own log.
"""

import os
import resource
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.rigs.chaos.rig import (
    APPROACH_V_PER_S,
    MAX_V,
    MOVER_V_PER_S,
    RAMP,
    RATE_HZ,
    SAFE_V,
    SLEW,
    STEP_NS,
    Rig,
    lives,
    readable_rows,
    until,
)
from tests.rigs.output import check_range, check_speed, during
from tests.rigs.processes import TIMEOUT_S

from dehyst.daemon.rings.records import Flag, State

# -- processes ------------------------------------------------------------------------------------


def kill_core(rig: Rig) -> str:
    """kill -9 of the loop's process"""
    restarts = rig.status().gateway.restarts_of_core
    rig.kill("core")
    begun_ns = time.monotonic_ns()  # it may be back before the gateway calls it silent
    until(lambda: rig.status().gateway.restarts_of_core > restarts, 60.0, "the core is back")
    rig.check_ramped(begun_ns)
    return f"output ramped to {SAFE_V:g} V, core started again"


def kill_core_hold(rig: Rig) -> str:
    """kill -9 of the loop's process, on_fault = "hold" """
    assert rig.mover is not None
    restarts = rig.status().gateway.restarts_of_core
    os.kill(rig.mover.pid, signal.SIGSTOP)  # nobody commands the core that comes back
    rig.kill("core")
    begun_ns = time.monotonic_ns()
    until(lambda: rig.status().gateway.restarts_of_core > restarts, 60.0, "the core is back")
    rig.check_held(begun_ns)
    rig.mover.kill()
    rig.mover.wait(5.0)
    rig.start_mover()
    return "output held where it was, core started again there"


def unplug_hold(rig: Rig) -> str:
    """serial cable of the amplifier pulled, on_fault = "hold" """
    assert rig.mover is not None
    os.kill(rig.mover.pid, signal.SIGSTOP)
    rig.bench_order(fault="unplug", device="mdt693b", for_s=1.0)
    rig.until_state(State.FAULT)
    begun_ns = time.monotonic_ns()
    rig.until_event("actuator: back", 30.0)
    rig.until_state(State.READY)
    time.sleep(0.5)
    rig.check_held(begun_ns)
    rig.mover.kill()
    rig.mover.wait(5.0)
    rig.start_mover()
    return "fault, reconnected, output held where it was"


def kill_gateway(rig: Rig) -> str:
    """kill -9 of the network's process"""
    before, assert_run = rig.pid("gateway"), rig.status().run
    rig.kill("gateway")
    until(lambda: rig.status().gateway.pid != before, 60.0, "the gateway is back")
    assert rig.status().run == assert_run, "the loop was disturbed"
    rig.until_running(30.0)
    samples = rig.samples()
    assert set(np.diff(samples["seq"])) == {1}, "telemetry has a gap"
    return "loop not disturbed, telemetry without a gap"


def kill_client(rig: Rig) -> str:
    """kill -9 of the commanding client"""
    begun_ns = time.monotonic_ns()
    assert rig.mover is not None
    rig.mover.kill()
    rig.mover.wait(5.0)
    rig.until_event("holding", 20.0)
    rig.until_state(State.READY, 20.0)
    assert abs(rig.last()["volts"] - SAFE_V) < 0.01
    rig.check_held_then_ramped(begun_ns)
    rig.start_mover()
    return f"held, then ramped to {SAFE_V:g} V"


def hang_core(rig: Rig) -> str:
    """the loop's process hangs (SIGSTOP, for good)"""
    restarts = rig.status().gateway.restarts_of_core
    pid = rig.kill("core", signal.SIGSTOP)
    begun_ns = time.monotonic_ns()
    rig.until_event("does not respond")
    until(lambda: not lives(pid), 20.0, "the hanging process is killed")
    killed_ns = time.monotonic_ns()
    until(lambda: "core hangs; killing it" in rig.words("run"), 5.0, "the same in words")
    rig.check_held(begun_ns, killed_ns - 50 * STEP_NS)  # detected some time after it happened
    until(lambda: rig.status().gateway.restarts_of_core > restarts, 60.0, "the core is back")
    rig.check_ramped(begun_ns)
    return f"killed after {(killed_ns - begun_ns) * 1e-9:.0f} s, ramped to {SAFE_V:g} V, restarted"


def hang_gateway(rig: Rig) -> str:
    """the network's process hangs (SIGSTOP, for good)"""
    run = rig.status().run
    pid = rig.kill("gateway", signal.SIGSTOP)
    begun = time.monotonic()
    until(lambda: not lives(pid), 40.0, "the hanging process is killed")
    seconds = time.monotonic() - begun
    until(lambda: "gateway hangs; killing it" in rig.words("run"), 5.0, "the same in words")
    until(lambda: rig.status().gateway.pid != pid, 60.0, "the gateway is back")
    assert rig.status().run == run, "the loop was disturbed"
    return f"killed after {seconds:.0f} s and started again, loop not disturbed"


@contextmanager
def stopped(rig: Rig, name: str) -> Iterator[None]:
    """Send SIGSTOP at the beginning of the block and SIGCONT at its end."""
    pid = rig.kill(name, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def check_glide(rig: Rig, stop: Callable[[], None]) -> None:
    """Check that nothing moves the output while `stop` runs, and that the output then glides: no
    step is larger than the ramp's plus what the trajectory itself needs.

    Repeated if there was nothing to glide: the trajectory happened to return to its earlier place,
    or the mover had given it up and begun another one, which is approached. The pause differs from
    attempt to attempt: every 3.2 s two of the trajectory's three waves are where they were.
    """
    why = []
    for attempt in range(16):
        time.sleep(0.37 * (attempt % 4))
        rig.until_running()
        played = rig.status().trajectory
        stop()
        resumed_ns = time.monotonic_ns()
        rig.until_running()
        time.sleep(0.5)
        samples = rig.samples()
        samples = samples[samples["scheduled_ns"] >= resumed_ns]
        goes_on = rig.status().trajectory == played  # a glide is flagged as an approach, too
        why.append((np.unique(samples["state"]), goes_on, samples[:1][["target", "measured"]]))
        if np.unique(samples["state"]).tolist() == [State.RUNNING] and goes_on:
            rig.check_steps(RAMP / RATE_HZ, MOVER_V_PER_S, resumed_ns - 20 * STEP_NS)
            if abs(samples["target"][0] - samples["measured"][0]) > 1.5:
                return
    raise AssertionError(f"the trajectory had never gone far while the loop stood still: {why}")


def stop_core(rig: Rig, seconds: float = 2.0, silent_s: float = 4.0) -> str:
    """SIGSTOP of the loop's process"""

    def stand_still(for_s: float = seconds) -> None:
        with stopped(rig, "core"):
            begun_ns = time.monotonic_ns()
            time.sleep(for_s)
            rig.check_held(begun_ns)

    check_glide(rig, stand_still)
    rig.until_event("the loop paused", 20.0)
    until(lambda: rig.flags() & Flag.MISSED, 10.0, "missed deadlines")
    stand_still(silent_s)
    rig.until_event("does not respond", 10.0)
    return f"output held for {seconds:g} s and {silent_s:g} s, then glided to the target"


def stop_gateway(rig: Rig, seconds: float = 4.0) -> str:
    """SIGSTOP of the network's process"""
    run = rig.status().run
    with stopped(rig, "gateway"):
        time.sleep(seconds)
    rig.until_running(30.0)
    assert rig.status().run == run
    assert set(np.diff(rig.samples()["seq"])) == {1}, "telemetry has a gap"
    return "loop not disturbed, telemetry caught up without a gap"


def stop_client(rig: Rig, seconds: float = 5.0) -> str:
    """SIGSTOP of the commanding client"""
    begun_ns = time.monotonic_ns()
    with stopped(rig, "client"):
        time.sleep(seconds)
        rig.until_event("run dry", 5.0)  # points sent ahead last 3 s
        rig.until_state(State.READY, 10.0)
    resumed_ns = time.monotonic_ns()
    rig.check_held_then_ramped(begun_ns)
    rig.until_running(30.0)
    rig.check_steps(0.0, APPROACH_V_PER_S, resumed_ns)
    return "trajectory played on as far as it was sent, held, ramped; then approached anew"


# -- amplifier ------------------------------------------------------------------------------------


def unplug(rig: Rig, seconds: float = 1.5) -> str:
    """serial cable of the amplifier pulled"""
    rig.bench_order(fault="unplug", device=rig.port_name, for_s=seconds)
    rig.until_state(State.FAULT)
    rig.until_event("actuator: back", 30.0)
    assert "DeviceGone" in rig.events(), rig.events()
    return "fault, reconnected"


def hang(rig: Rig, seconds: float = 3.0 * TIMEOUT_S) -> str:
    """amplifier hangs"""
    rig.bench_order(amplifier={"hang": True}, for_s=seconds)
    rig.until_state(State.FAULT)
    rig.until_event("actuator: back", 30.0)
    within = f"within {TIMEOUT_S:g} s"  # the driver's words for a time-out
    assert within in rig.events(), rig.events()
    return "fault (time-out), reconnected"


def garbage(rig: Rig, count: int = 2) -> str:
    """amplifier answers garbage"""
    rig.bench_order(amplifier={"garbage": True, "count": count})
    rig.until_state(State.FAULT)
    rig.bench_order(clear=True)
    rig.until_event("actuator: back", 30.0)
    return "fault (protocol), reconnected"


def half_reply(rig: Rig, count: int = 2) -> str:
    """amplifier sends half a reply"""
    rig.bench_order(amplifier={"half": True, "count": count})
    rig.until_state(State.FAULT)
    rig.bench_order(clear=True)
    rig.until_event("actuator: back", 30.0)
    return "fault, reconnected"


def other_dialect(rig: Rig) -> str:
    """another firmware after the reconnection"""
    for dialect in ("1.05", "1.10"):
        rig.mark_fault()
        rig.bench_order(fault="unplug", device="mdt693b", for_s=0.5, dialect=dialect)
        rig.until_event("actuator: back", 30.0)
        rig.until_running(30.0)
    return "dialect detected anew, twice"


def readback(rig: Rig) -> str:
    """readback disagrees with the set-point"""
    rig.bench_order(amplifier={"readback_error_v": 150.0})
    rig.until_event("V was set", 30.0)
    rig.until_state(State.FAULT)
    begun_ns = time.monotonic_ns() + 30 * STEP_NS
    time.sleep(1.3)
    rig.check_held(begun_ns)
    rig.bench_order(clear=True)
    rig.until_event("agrees with the set-point again", 20.0)
    return "fault: nothing written until the two agreed again"


# -- sensor ---------------------------------------------------------------------------------------


def sensor_stuck(rig: Rig, seconds: float = 6.0) -> str:
    """sensor stuck"""
    until(lambda: not rig.status().gateway.mismatch, 40.0, "the watch reports no mismatch")
    rig.bench_order(fault="stuck", for_s=seconds)
    rig.until_event("has not changed", seconds + 5.0)
    until(lambda: rig.flags() & Flag.MISMATCH, 5.0, "the mismatch flag")
    rig.bench_order(clear=True)
    rig.until_event("dehyst diagnose", 20.0)
    kept = sorted(rig.kept.glob("*.csv"))
    assert readable_rows(kept[-1]) > 50
    return "mismatch flag, event names the sensor, recording around it kept"


def sensor_invalid(rig: Rig, kind: str = "nan", seconds: float = 1.0) -> str:
    """sensor reads NaN"""
    rig.bench_order(fault=kind, for_s=seconds)
    until(lambda: rig.flags() & Flag.SENSOR_INVALID, 10.0, "the sensor flag")
    assert State.FAULT not in rig.states()
    return "readings flagged as invalid, the loop goes on"


def sensor_range(rig: Rig) -> str:
    """sensor out of its range"""
    return sensor_invalid(rig, "range")


def sensor_late(rig: Rig, late_s: float = 0.04) -> str:
    """sensor answers late"""
    before = rig.status().missed_by.get("driver_io", 0)
    rig.bench_order(fault="late", late_s=late_s, for_s=1.0)
    until(lambda: rig.flags() & Flag.MISSED, 10.0, "missed deadlines")
    until(lambda: rig.status().missed_by.get("driver_io", 0) > before, 10.0, "counted there")
    return "missed deadlines counted under driver_io"


def sensor_unplug(rig: Rig, seconds: float = 1.0) -> str:
    """serial cable of the sensor pulled"""
    rig.bench_order(fault="unplug", device="ksg101", for_s=seconds)
    until(lambda: rig.flags() & Flag.SENSOR_INVALID, 10.0, "the sensor flag")
    rig.until_event("sensor: back", 30.0)
    assert State.FAULT not in rig.states()
    return "readings flagged as invalid, reconnected, the loop goes on"


# -- disk, clock, model file ----------------------------------------------------------------------


def disk_full(rig: Rig) -> str:
    """disk full while recording"""
    with small_disk() as disk:
        path = disk / "full.csv"
        process = rig.record(path, name="record-full")
        filler = disk / "filler"
        with open(filler, "wb", buffering=0) as file:
            while True:
                try:
                    file.write(b"x" * 4096)
                except OSError:
                    break
        assert process.wait(30.0) == 2, rig.words("record-full")
        words = rig.words("record-full").strip().splitlines()
        assert "No space left" in words[-1], words
        assert path.read_bytes().endswith(b"\n")
        rows = readable_rows(path)
    return f"recording ends with one line of words; {rows} rows before it read back"


def file_limit(rig: Rig) -> str:
    """file size limit reached while recording"""
    path = rig.folder / "limit.csv"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    process = rig.record(path, name="record-limit")
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (path.stat().st_size + 5000, limits[1]))
    assert process.wait(30.0) == 2, rig.words("record-limit")
    assert path.read_bytes().endswith(b"\n")
    return f"recording ends with one line of words; {readable_rows(path)} rows before it read back"


def until_flagged(rig: Rig, text: str) -> None:
    """Freeze the reading repeatedly until the watch reports this text: a watch that has just begun
    to learn is not certain yet."""
    for _ in range(8):
        # a mismatch is reported once: an earlier fault's must be over before another one is
        until(lambda: not rig.status().gateway.mismatch, 40.0, "the watch reports no mismatch")
        rig.bench_order(fault="stuck", for_s=9.0)
        end = time.monotonic() + 12.0
        while time.monotonic() < end:
            if text in rig.events():
                return
            time.sleep(0.05)
    raise AssertionError(f"the watch does not say {text!r}; heard: {rig.events()!r}")


def disk_read_only(rig: Rig) -> str:
    """disk becomes read-only while recording, and where the watch keeps its recordings"""
    kept = rig.kept
    with journalled_disk() as disk:
        path = disk / "run.csv"
        process = rig.record(path, name="record-ro")
        own = kept.with_name("mismatch-before")
        if kept.exists():
            kept.rename(own)
        kept.symlink_to(disk)
        try:
            # the kernel does this when the disk fails: read-only at once, including open files
            subprocess.run(["mount", "-o", "remount,abort", str(disk)], check=True)
            assert process.wait(30.0) == 2
            words = rig.words("record-ro").strip().splitlines()
            assert "Read-only" in words[-1], words
            rows = readable_rows(path)
            refused = rig.start(
                "record", "-o", str(disk / "b.csv"), "--for", "1", name="record-ro2"
            )
            assert refused.wait(30.0) == 2
            assert "Read-only" in rig.words("record-ro2")
            until_flagged(rig, "is not kept")
            assert "Read-only" in rig.events()
        finally:
            rig.bench_order(clear=True)
            kept.unlink()
            if own.exists():
                own.rename(kept)
    assert State.FAULT not in rig.states()
    return f"recording ends with one line of words, {rows} rows read back; the watch says it too"


@contextmanager
def journalled_disk() -> Iterator[Path]:
    """Yield an ext4 file system of 4 MB in a file. Needs the right to mount, and mkfs.ext4."""
    with tempfile.TemporaryDirectory(prefix="dehyst-disk-") as folder:
        image, place = Path(folder) / "image", Path(folder) / "disk"
        place.mkdir()
        with open(image, "wb") as file:
            file.truncate(4 << 20)
        for command in (["mkfs.ext4", "-q", "-F", image], ["mount", "-o", "loop", image, place]):
            subprocess.run(command, check=True, capture_output=True)
        try:
            yield place
        finally:
            subprocess.run(["umount", "-l", place], check=False, capture_output=True)


@contextmanager
def small_disk() -> Iterator[Path]:
    """Yield a file system of 256 kB. Needs the right to mount."""
    with tempfile.TemporaryDirectory(prefix="dehyst-disk-") as folder:
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", folder],
            check=True,
            capture_output=True,
        )
        try:
            yield Path(folder)
        finally:
            subprocess.run(["umount", "-l", folder], check=False, capture_output=True)


def why_not(fault: Callable[..., str]) -> str:
    """Return why this machine does not allow the fault; "" if it does."""
    disks = {disk_full: small_disk, disk_read_only: journalled_disk}
    try:
        with disks.get(fault, nullcontext)():
            return ""
    except FileNotFoundError as error:
        return f"{error.filename} is missing"
    except (OSError, subprocess.CalledProcessError):
        return "needs the right to mount a small disk"


def clock_stepped(rig: Rig) -> str:
    """wall clock stepped by a year, back, and by an hour"""
    run = rig.status().run
    for offset_s in (365 * 86400.0, -3600.0, 0.0):
        rig.step_wall_clock(offset_s)
        until(
            lambda want=offset_s: abs(rig.status().wall_ns * 1e-9 - time.time() - want) < 60.0,
            10.0,
            "the daemon's label follows the wall clock",
        )
    samples = rig.samples()
    assert rig.status().run == run
    assert set(np.diff(samples["seq"])) == {1}
    assert {State(int(s)) for s in np.unique(samples["state"])} == {State.RUNNING}
    assert rig.refusals() == set()
    return "only the labels moved"


def model_files(rig: Rig) -> str:
    """model file broken, truncated, gone, swapped while it is loaded"""
    good = rig.model.read_text()
    broken = {
        "truncated": good[: len(good) // 2],
        "empty": "",
        "other format": good.replace("format = 1", "format = 99"),
        "not text": "\0\0\0",
    }
    for text in broken.values():
        count = rig.events().count("reload refused")
        rig.model.write_text(text)
        os.kill(rig.daemon.pid, signal.SIGHUP)
        until(lambda n=count: rig.events().count("reload refused") > n, 20.0, "the refusal")
    end = time.monotonic() + 1.5
    while time.monotonic() < end:  # swapped while it is loaded
        for text in (good, broken["truncated"]):
            rig.model.write_text(text)
            os.kill(rig.daemon.pid, signal.SIGHUP)
            time.sleep(0.01)
    time.sleep(0.5)
    rig.model.write_text(good)
    count = rig.events().count("model reloaded")
    os.kill(rig.daemon.pid, signal.SIGHUP)
    until(lambda: rig.events().count("model reloaded") > count, 30.0, "the reload")
    assert State.FAULT not in rig.states()
    return "broken ones refused in words, the old model stayed; the good one was swapped in"


PROCESSES: tuple[Callable[[Rig], str], ...] = (
    kill_core, kill_gateway, kill_client, stop_core, stop_gateway, stop_client, hang_core,
    hang_gateway,
)  # fmt: skip
DEVICES: tuple[Callable[[Rig], str], ...] = (
    unplug, hang, garbage, half_reply, other_dialect, readback,
    sensor_stuck, sensor_invalid, sensor_range, sensor_late, sensor_unplug,
)  # fmt: skip
HOST: tuple[Callable[[Rig], str], ...] = (disk_full, file_limit, disk_read_only, clock_stepped,
                                          model_files)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """One row of the table. beyond_v: the largest movement beyond slew x length in any window
    during the fault (a step of SLEW / RATE_HZ is allowed); seconds: until the trajectory ran again;
    rows: of the recording made at the same time."""

    fault: str
    happened: str
    beyond_v: float
    seconds: float
    rows: int


def inflict(rig: Rig, recording: Path, fault: Callable[..., str], **options: float) -> Outcome:
    """Apply one fault to a running rig and wait until the trajectory runs again. Raises
    AssertionError if any required property does not hold."""
    rig.mark()
    begun = time.monotonic()
    happened = fault(rig, **options)
    rig.until_running(60.0)
    seconds = time.monotonic() - begun
    rows = readable_rows(recording)
    time_ns, volts = during(*rig.output(), rig.fault_ns)
    check_range(volts, 0.0, MAX_V)
    beyond_v = check_speed(time_ns, volts, SLEW, SLEW / RATE_HZ)
    rig.judge(fault)
    return Outcome((fault.__doc__ or "").strip(), happened, beyond_v, seconds, rows)
