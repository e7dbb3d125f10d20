"""Whatever interrupts or kills `acquire` and `record`, what was recorded is kept, complete and
readable.

Real processes and signals on the emulated bench.
"""

import fcntl
import os
import pty
import select
import signal
import subprocess
import termios
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.processes import EmulatedBench, core, dehyst, end, until
from tests.rigs.service import Service
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.drivers.emulated.control import ask
from dehyst.models.recording import Recording

RATE_HZ, START_V = 100.0, 20.0
READBACK_V = 0.5
"""Accuracy [V] of the output that a unit reports, and so of returning to it."""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.toml"
    save_model(kept_model(), path)
    return path


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedBench]:
    """The bench for the tests of `acquire`; all of them but the last leave the output where it
    was."""
    bench = EmulatedBench(tmp_path_factory.mktemp("bench"), "--start-v", str(START_V))
    yield bench
    bench.close()


def at_v(bench: EmulatedBench) -> float:
    """Return the output [V] that the amplifier reports."""
    return float(ask(bench.ports["control"], {})["output_v"])


def test_acquire_ended_before_its_first_sample_writes_nothing(
    bench: EmulatedBench, tmp_path: Path, model: Path
) -> None:
    before_v, t_s = at_v(bench), np.arange(0.0, 10.0, 0.01)
    write_recording(tmp_path / "drive.csv", t_s, {"u_v": 60.0 + 5.0 * np.sin(t_s)})
    config = bench.config(RATE_HZ, model)
    process = dehyst("acquire", str(tmp_path / "drive.csv"), "--config", str(config),
                     "-o", str(tmp_path / "rec.csv"), "--exercise", "60")  # fmt: skip
    until(lambda: at_v(bench) > 54.0, 120.0, "it exercises the stage")
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60.0)
    assert process.returncode == 2
    assert "nothing was recorded: it was interrupted" in said
    assert not (tmp_path / "rec.csv").exists()
    assert at_v(bench) == pytest.approx(before_v, abs=READBACK_V)


class Terminal:
    """A terminal that a process controls, and whose output is read and dropped."""

    def __init__(self) -> None:
        self._ours, self.theirs = pty.openpty()
        self._closing = threading.Event()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        while not self._closing.is_set():
            if select.select([self._ours], [], [], 0.01)[0]:
                os.read(self._ours, 4096)
        os.close(self._ours)

    def close(self) -> None:
        """Hang up. The kernel then sends SIGHUP, and each later write fails."""
        self._closing.set()
        self._reader.join()


def test_acquire_whose_terminal_is_closed(
    bench: EmulatedBench, tmp_path: Path, model: Path
) -> None:
    """The terminal of `acquire` is closed in the midst of the drive, as a lost ssh closes it: every
    later print fails, and the progress bar's too."""
    before_v, t_s = at_v(bench), np.arange(0.0, 60.0, 0.01)
    write_recording(tmp_path / "drive.csv", t_s, {"u_v": 60.0 + 40.0 * (t_s / 60.0)})
    output, config = tmp_path / "rec.csv", bench.config(RATE_HZ, model)
    terminal = Terminal()
    process = dehyst(
        "acquire", str(tmp_path / "drive.csv"), "--config", str(config), "-o", str(output),
        "--exercise", "0", stdout=terminal.theirs, stderr=terminal.theirs, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(2, termios.TIOCSCTTY, 0),
    )  # fmt: skip
    os.close(terminal.theirs)
    try:
        until(lambda: at_v(bench) > 62.0, 120.0, "three seconds of the drive")
        terminal.close()
        assert process.wait(60.0) == 1
    finally:
        terminal.close()
        process.kill()
        process.wait(10.0)
    assert at_v(bench) == pytest.approx(before_v, abs=READBACK_V)
    assert read_recording(output, need_displacement=True).t_s[-1] > 2.5


# the last one leaves the output where it is
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_acquire_ended_in_the_midst(
    bench: EmulatedBench, tmp_path: Path, model: Path, number: int
) -> None:
    before_v, t_s = at_v(bench), np.arange(0.0, 60.0, 0.01)
    drive = 60.0 + 40.0 * (t_s / 60.0)  # the drive's value shows how far it came
    write_recording(tmp_path / "drive.csv", t_s, {"u_v": drive})
    output = tmp_path / "rec.csv"
    config = bench.config(RATE_HZ, model)
    process = dehyst("acquire", str(tmp_path / "drive.csv"), "--config", str(config),
                     "-o", str(output), "--exercise", "0")  # fmt: skip
    until(lambda: at_v(bench) > 62.0, 120.0, "three seconds of the drive")
    process.send_signal(number)
    _, said = process.communicate(timeout=60.0)
    assert "Traceback" not in said
    assert not list(tmp_path.glob(".*.part"))
    if number == signal.SIGKILL:
        assert not output.exists()  # complete or absent
        return
    assert process.returncode == 1
    assert "interrupted" in said
    recording = read_recording(output, need_displacement=True)
    assert recording.displacement is not None
    assert recording.t_s[-1] > 2.5
    assert 61.5 < recording.drive[-1] < 90.0
    written = np.interp(recording.t_s[:-1], t_s, drive)  # in force at the next reading
    assert np.median(np.abs(recording.drive[1:] - written)) < 0.01  # except for late samples
    assert (np.diff(recording.drive) >= 0).all()
    assert np.isfinite(recording.displacement).mean() > 0.9
    assert at_v(bench) == pytest.approx(before_v, abs=READBACK_V)  # back where it was


def missing(t_s: np.ndarray) -> int:
    """Return the number of the loop's deadlines between the first and the last of these times that
    are not among them."""
    return round((t_s[-1] - t_s[0]) * RATE_HZ) + 1 - t_s.size


def sampled_meanwhile(service: Service, recording: Recording) -> np.ndarray:
    """Return the deadlines [s] in the loop's ring from the recording's first to its last row, which
    are found by their readings."""
    samples = service.rings.read("telemetry")
    t_s, readings = samples["scheduled_ns"] * 1e-9, samples["measured"]
    for first in range(t_s.size):
        rows = np.searchsorted(t_s, t_s[first] + recording.t_s - 0.5 / RATE_HZ)
        if rows[-1] < t_s.size and np.allclose(
            readings[rows], recording.displacement, rtol=0.0, atol=1e-6, equal_nan=True
        ):
            return t_s[first : rows[-1] + 1]
    raise AssertionError("the loop's ring has no such readings")


def test_record_interrupted_and_killed(tmp_path: Path, model: Path) -> None:
    service = Service(tmp_path, model)
    try:
        service.start()
        service.client().close()
        address = f"tcp/127.0.0.1:{service.port}"
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
        paths = [tmp_path / f"rec-{int(number)}.csv" for number in numbers]
        processes = [dehyst("record", "-o", str(p), "--connect", address) for p in paths]
        for number, path, process in zip(numbers, paths, processes, strict=True):
            until(lambda p=path: p.exists() and p.stat().st_size > 20_000, 60.0, "rows")
            os.kill(process.pid, number)
            _, said = process.communicate(timeout=30.0)
            assert "Traceback" not in said
            assert process.returncode == {signal.SIGKILL: -9}.get(number, 0)
            recording = read_recording(path, need_displacement=True)
            assert recording.t_s.size > 100
            assert (np.diff(recording.t_s) > 0).all()
            # nothing is missing that the loop has sampled
            assert missing(recording.t_s) <= missing(sampled_meanwhile(service, recording))
    finally:
        service.close()


def test_record_beside_a_gateway_that_knows_no_loop_yet(tmp_path: Path, model: Path) -> None:
    """`record` waits for the units until a loop runs; if it is interrupted before that, it leaves
    no file."""
    service = Service(tmp_path, model)
    gateway = dehyst("gateway", "--config", str(service.config))
    try:
        with service.client() as client:
            assert client.status().drive_unit == ""
        path = tmp_path / "rec.csv"
        record = ("record", "-o", str(path), "--connect", f"tcp/127.0.0.1:{service.port}")
        process = dehyst(*record)
        assert process.stderr is not None
        assert "is starting; waiting until it is ready" in process.stderr.readline()
        with pytest.raises(subprocess.TimeoutExpired):  # it goes on waiting
            process.wait(1.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30.0)
        assert process.returncode == 130
        assert said.rstrip().endswith("interrupted")
        assert not path.exists()
        process = dehyst(*record, "--for", "1")
        with core(service.config):
            _, said = process.communicate(timeout=120.0)
        assert process.returncode in (0, 1), said
        assert read_recording(path, need_displacement=True).drive_unit == "v"
    finally:
        end(gateway)
        service.close()
