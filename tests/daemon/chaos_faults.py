"""The faults of the chaos tests: each one is done to a running rig and says what happened.

A fault function raises AssertionError where the daemon does not do what it must. Range and slew
of the output are checked by the caller, from the amplifier's own log, for all of them.
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
from tests.daemon.chaos_rig import SAFE_V, Rig, check_output, readable_rows, until

from dehyst.daemon.records import Flag, State

# -- processes ------------------------------------------------------------------------------------


def kill_core(rig: Rig) -> str:
    """kill -9 of the loop's process"""
    restarts = rig.status().gateway.restarts_of_core
    rig.kill("core")
    rig.until_event("says nothing")
    until(lambda: rig.status().gateway.restarts_of_core > restarts, 60.0, "the core is back")
    time_ns, volts = rig.output()
    volts = volts[time_ns >= rig.since_ns]
    assert np.abs(volts - SAFE_V).min() < 0.01, "the output never came to its safe voltage"
    return f"output ramped to {SAFE_V:g} V, core started again"


def kill_core_hold(rig: Rig) -> str:
    """kill -9 of the loop's process, on_fault = "hold" """
    assert rig.mover is not None
    restarts = rig.status().gateway.restarts_of_core
    os.kill(rig.mover.pid, signal.SIGSTOP)  # nobody commands the core that comes back
    rig.kill("core")
    held = rig.bench_order()["output_v"]
    until(lambda: rig.status().gateway.restarts_of_core > restarts, 60.0, "the core is back")
    assert rig.bench_order()["output_v"] == held, "the output moved"
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
    held = rig.bench_order()["output_v"]
    rig.until_event("actuator: back", 30.0)
    rig.until_state(State.READY)
    time.sleep(0.5)
    assert rig.bench_order()["output_v"] == held, "the output moved"
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
    rig.kill("client")
    assert rig.mover is not None
    rig.mover.wait(5.0)
    rig.until_event("holding", 20.0)
    rig.until_state(State.READY, 20.0)
    assert abs(rig.last()["volts"] - SAFE_V) < 0.01
    rig.start_mover()
    return f"held, then ramped to {SAFE_V:g} V"


@contextmanager
def stopped(rig: Rig, name: str) -> Iterator[None]:
    """SIGSTOP within, SIGCONT behind."""
    pid = rig.kill(name, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def stop_core(rig: Rig, seconds: float = 5.0) -> str:
    """SIGSTOP of the loop's process"""
    with stopped(rig, "core"):
        time.sleep(0.2)  # a command that was on its way arrives
        before = rig.bench_order()["output_v"]
        time.sleep(seconds)
        assert rig.bench_order()["output_v"] == before
    rig.until_event("stood still", 20.0)
    until(lambda: rig.flags() & Flag.MISSED, 10.0, "missed deadlines")
    if seconds > 3.0:
        until(lambda: "says nothing" in rig.events(), 10.0, "the gateway's word of it")
    return f"output held for {seconds:g} s, then glided to the target"


def stop_gateway(rig: Rig, seconds: float = 5.0) -> str:
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
    with stopped(rig, "client"):
        time.sleep(seconds)
        if seconds > 4.5:  # the trajectory sent ahead lasts 3 s
            rig.until_event("run dry", 5.0)
    return "trajectory played on as far as it was sent, then held"


# -- amplifier ------------------------------------------------------------------------------------


def unplug(rig: Rig, seconds: float = 1.5) -> str:
    """serial cable of the amplifier pulled"""
    rig.bench_order(fault="unplug", device="mdt693b", for_s=seconds)
    rig.until_state(State.FAULT)
    rig.until_event("actuator: back", 30.0)
    assert "DeviceGone" in rig.events()
    return "fault, reconnected"


def hang(rig: Rig, seconds: float = 1.0) -> str:
    """amplifier hangs"""
    rig.bench_order(amplifier={"hang": True}, for_s=seconds)
    rig.until_state(State.FAULT)
    rig.until_event("actuator: back", 30.0)
    assert "DeviceTimeout" in rig.events()
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
    rig.until_event("where", 30.0)
    rig.until_state(State.FAULT)
    time.sleep(0.3)
    before = rig.bench_order()["output_v"]
    time.sleep(1.0)
    assert rig.bench_order()["output_v"] == before, "the output moved in doubt"
    rig.bench_order(clear=True)
    rig.until_event("reports what was set again", 20.0)
    return "fault: nothing written until the two agreed again"


# -- sensor ---------------------------------------------------------------------------------------


def sensor_stuck(rig: Rig, seconds: float = 6.0) -> str:
    """sensor stuck"""
    rig.bench_order(fault="stuck", for_s=seconds)
    rig.until_event("has not changed", seconds + 5.0)
    until(lambda: rig.flags() & Flag.MISMATCH, 5.0, "the mismatch flag")
    rig.bench_order(clear=True)
    rig.until_event("dehyst diagnose", 20.0)
    kept = sorted((rig.folder / "run" / "mismatch").glob("*.csv"))
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
    rig.bench_order(fault="late", late_s=late_s, for_s=1.0)
    until(lambda: rig.flags() & Flag.MISSED, 10.0, "missed deadlines")
    time.sleep(1.0)
    assert rig.status().missed_by.get("driver_io", 0) > 0
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


def disk_read_only(rig: Rig) -> str:
    """disk becomes read-only while recording, and where the watch keeps its recordings"""
    kept = rig.folder / "run" / "mismatch"
    with journalled_disk() as disk:
        path = disk / "run.csv"
        process = rig.record(path, name="record-ro")
        own = kept.with_name("mismatch-before")
        if kept.exists():
            kept.rename(own)
        kept.symlink_to(disk)
        try:
            # what the kernel does when the disk fails: read-only at once, open files included
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
            rig.bench_order(fault="stuck", for_s=6.0)
            rig.until_event("is not kept", 20.0)
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
    """An ext4 file system of 4 MB in a file. Needs the right to mount, and mkfs.ext4."""
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
    """A file system of 256 kB. Needs the right to mount."""
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
    """Why this machine does not let the fault be done; "": it does."""
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
    kill_core, kill_gateway, kill_client, stop_core, stop_gateway, stop_client,
)  # fmt: skip
DEVICES: tuple[Callable[[Rig], str], ...] = (
    unplug, hang, garbage, half_reply, other_dialect, readback,
    sensor_stuck, sensor_invalid, sensor_range, sensor_late, sensor_unplug,
)  # fmt: skip
HOST: tuple[Callable[[Rig], str], ...] = (disk_full, file_limit, disk_read_only, clock_stepped,
                                          model_files)  # fmt: skip
SHORT_S = 2.0
"""How long the test suite stops a process; the benchmark does it for 5 s."""


@dataclass(frozen=True)
class Outcome:
    """One row of the table. most_v, slew: of the output while it happened; state: at the end of
    the fault; seconds: until the trajectory ran again."""

    fault: str
    happened: str
    most_v: float
    slew: float
    seconds: float
    rows: int


def inflict(rig: Rig, fault: Callable[..., str], recording: Path, **options: float) -> Outcome:
    """Do one fault to a running rig and wait until the trajectory runs again. AssertionError
    where anything that must hold does not."""
    rig.mark()
    begun = time.monotonic()
    happened = fault(rig, **options)
    rig.until_running(60.0)
    seconds = time.monotonic() - begun
    rows = readable_rows(recording)
    most_v, slew = check_output(*rig.output(), rig.fault_ns)
    return Outcome((fault.__doc__ or "").strip(), happened, most_v, slew, seconds, rows)
