"""What a new user types in the first hour: refusals are explained, and nothing surprises."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.daemon.commands.test_remote import ENV
from tests.rigs.axes_bench import AxesBench
from tests.rigs.gateway_bench import Bench, free_port, wait_until
from tests.rigs.processes import EmulatedBench, dehyst
from tests.rigs.stage_model import kept_model

from dehyst.daemon.bench import emulated as emulated_bench
from dehyst.daemon.bench.simulated import write_bench
from dehyst.daemon.client.played_summary import about_the_machine
from dehyst.daemon.client.player import Played
from dehyst.daemon.client.tracking import Tracking
from dehyst.daemon.config import load_config
from dehyst.daemon.files.models import load_model
from dehyst.daemon.loop import process
from dehyst.daemon.main import main
from dehyst.drivers.interface import DeviceNotFound, DeviceTimeout, DriverError, ProtocolError
from dehyst.models.modelfile import dumps


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--range", "100", "0"], "give the lowest voltage first"),
        (["--range", "5", "5"], "give the lowest voltage first"),
        (["--range", "0", "100", "--slew", "-1"], "a rate in V/s, greater than 0"),
        (["--range", "0", "100", "--rate", "0"], "--rate 0: a sampling rate in Hz, above 0"),
        (["--range", "0", "100", "--rate", "1e9"], "--rate 1e+09: a sampling rate in Hz"),
    ],
)
def test_config_init_refuses_nonsense_in_words(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "init", *words]) == 2
    err = capsys.readouterr().err
    assert says in err
    assert err.count("\n") == 1


def test_keys_a_second_time_names_the_key_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["keys", str(tmp_path / "keys"), "--controller", "stage-1", "--host", "127.0.0.1"]
    assert main(command) == 0
    before = (tmp_path / "keys" / "stage-1" / "key.pem").read_bytes()
    capsys.readouterr()
    assert main([*command, "--client", "anna"]) == 2
    err = capsys.readouterr().err
    assert "has a key already" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "keys" / "anna").exists()
    assert (tmp_path / "keys" / "stage-1" / "key.pem").read_bytes() == before


@pytest.mark.parametrize("kind", ["model", "configuration"])
def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path, kind: str, shared: Bench) -> None:
    if kind == "model":
        path = tmp_path / "stage.model.toml"
        text = (shared.path.parent / "model.toml").read_text()
        path.write_text(text, encoding="utf-8-sig")
        assert dumps(load_model(path)) == dumps(load_model(shared.path.parent / "model.toml"))
        return
    (tmp_path / "model.toml").write_text((shared.path.parent / "model.toml").read_text())
    path = tmp_path / "stage.toml"
    path.write_text(shared.path.read_text(), encoding="utf-8-sig")
    assert load_config(path).name == shared.config.name


class Flaky:
    """Stands in for the devices of an axis: opening fails `times` times; counts what is left
    open."""

    def __init__(self, error: DriverError | None, times: int) -> None:
        self.error, self.times, self.opened, self.tried = error, times, 0, 0

    def open(self) -> None:
        self.tried += 1
        if self.error is not None and self.tried <= self.times:
            raise self.error
        self.opened += 1

    def close(self) -> None:
        self.opened -= 1


@pytest.mark.parametrize(
    ("error", "times", "opens"),
    [
        (DeviceTimeout("late"), 1, True),
        (DeviceTimeout("late"), 2, True),
        (ProtocolError("out of step"), 1, True),
        (DeviceTimeout("silent"), 9, False),
        (DeviceNotFound("not plugged in"), 1, False),
    ],
)
def test_one_late_reply_at_the_start_is_asked_again(
    error: DriverError, times: int, opens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "joined", lambda devices: [])
    monkeypatch.setattr(process, "PAUSE_S", 0.0)
    core = process.Core.__new__(process.Core)
    axes = [Flaky(None, 0), Flaky(error, times), Flaky(None, 0)]
    for axis in axes:
        axis.actuator = type("Link", (), {"device": None})()  # type: ignore[attr-defined]
    core.axes = axes  # type: ignore[assignment]
    if opens:
        core._open_patiently()
        assert [axis.opened for axis in axes] == [1, 1, 1]
        return
    with pytest.raises(type(error)):
        core._open_patiently()
    assert [axis.opened for axis in axes] == [0, 0, 0]
    assert axes[1].tried == (1 if isinstance(error, DeviceNotFound) else process.ATTEMPTS)


@pytest.mark.parametrize(("missed", "busy"), [(0, False), (9, False), (30, True)])
def test_errors_of_a_busy_machine_are_not_called_the_stages(missed: int, busy: bool) -> None:
    tracking = Tracking(0, 1000)
    tracking.samples, tracking.missed = 1000, missed
    played = Played(True, "", 1, 1.0, "um", tracking, 0, "running")
    assert ("machine was too busy" in about_the_machine(played)) == busy


def test_a_second_run_on_the_same_address_is_refused_at_once(shared: Bench) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", "run", "--listen", shared.address],
        env=ENV, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "is in use" in done.stderr
    assert "--listen tcp/127.0.0.1:" in done.stderr
    assert done.stderr.count("\n") == 1


def test_run_speaks_at_once_and_brings_its_emulated_bench_back(tmp_path: Path) -> None:
    folder = tmp_path / "bench"
    bench = EmulatedBench(tmp_path)
    emulated_bench.note_bench(folder, [])
    address = f"tcp/127.0.0.1:{free_port()}"
    config = write_bench(tmp_path, bench.ports, "stage-1", address, kept_model())
    bench.close()
    assert not Path(bench.ports["mdt693b"]).exists()
    with open(tmp_path / "run.txt", "wb") as words:
        run = dehyst("run", "--config", str(config), stdout=words, stderr=words)
    try:
        said = lambda: (tmp_path / "run.txt").read_text()  # noqa: E731
        ready = lambda: "ready: clients reach stage-1" in said()  # noqa: E731
        wait_until("it is ready", lambda: ready() or run.poll() is not None, 60.0)
        assert ready(), said()
        first, second, *_ = said().splitlines()
        assert first == f"dehyst run: starting stage-1 with {config}"
        assert second == f"dehyst run: starting its emulated bench: dehyst emulate --dir {folder}"
    finally:
        run.send_signal(signal.SIGTERM)
        assert run.wait(60.0) == 0
    assert not Path(bench.ports["mdt693b"]).exists()


def test_scan_takes_rate_and_reach_of_a_daemon_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raster = tmp_path / "raster.csv"
    command = ["scan", "raster", "--size", "2", "2", "--lines", "4", "-o", str(raster)]
    bench = AxesBench(tmp_path, "xy")
    try:
        bench.start_gateway()
        assert main([*command, "--connect", bench.address]) == 0
        assert "reach, slew and rate are those of stage-1" in capsys.readouterr().err
    finally:
        bench.close()
    t_s = np.genfromtxt(raster, delimiter=",", names=True)["t_s"]
    assert np.allclose(np.diff(t_s), 0.005)
    nobody = f"tcp/127.0.0.1:{free_port()}"
    assert main([*command, "--force", "--connect", nobody]) == 2
