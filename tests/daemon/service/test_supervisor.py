"""`dehyst run` with real processes, ptys and signals: what ends, ends safely; what dies is
restarted.

The amplifier's own report is the evidence of the output.
"""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.rigs.processes import core, dehyst, simulated_config, until
from tests.rigs.service import SAFE_V, Service

from dehyst.daemon.config import load_config, load_controller
from dehyst.daemon.main import main
from dehyst.daemon.rings.records import State
from dehyst.daemon.service.supervisor import Supervisor

UNITS = Path(__file__).resolve().parents[3] / "systemd"


def test_an_end_as_asked_ramps_and_ends_with_0(service: Service) -> None:
    service.start()
    assert service.high() > 60.0
    assert service.end() == 0
    assert service.output() == pytest.approx(SAFE_V, abs=0.02)


def test_a_core_that_had_to_be_killed_at_the_end_leaves_the_output_safe_and_not_0(
    service: Service,
) -> None:
    service.start()
    assert service.high() > 60.0
    os.kill(service.core_pid(), signal.SIGSTOP)
    assert service.end() == 1  # after the ramp's own time and the margin
    assert "hangs; killing it" in service.words()
    assert service.output() == pytest.approx(SAFE_V, abs=0.02), service.words()
    assert service.core_pid() == 0


def test_a_core_that_dies_while_it_ramps_leaves_the_output_safe_and_not_0(
    service: Service,
) -> None:
    slow = service.config.read_text().replace("ramp_v_per_s = 200.0", "ramp_v_per_s = 20.0")
    service.config.write_text(slow)
    service.start()
    assert service.high() > 60.0
    assert service.supervisor is not None
    service.supervisor.send_signal(signal.SIGTERM)
    until(lambda: service.rings.state() is State.STOPPING, 20.0, "it ramps")
    os.kill(service.core_pid(), signal.SIGKILL)
    assert service.supervisor.wait(60.0) == 1
    assert service.output() == pytest.approx(SAFE_V, abs=0.02)


def test_a_long_ramp_is_waited_for(
    tmp_path: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The time allowed grows with the configured ramp; this is computed, not waited for."""
    path = simulated_config(tmp_path, 100.0, model)
    text = path.read_text()
    path.write_text(text.replace("ramp_v_per_s = 200.0", "ramp_v_per_s = 1.0"))
    assert load_config(path).longest_ramp_s == 145.0  # from 150 V to 5 V
    assert Supervisor(load_controller(path), path, print).patience_s > 145.0 + 10.0
    assert main(["run", "--check", str(path)]) == 0
    said = capsys.readouterr().err
    assert "145 s" in said
    assert "TimeoutStopSec=90" in said
    assert "TimeoutStopSec=90\n" in (UNITS / "dehyst.service").read_text()
    path.write_text(text)
    assert main(["run", "--check", str(path)]) == 0
    assert "TimeoutStopSec" not in capsys.readouterr().err


def test_systemd_is_asked_for_time_while_core_and_safe_ramp(
    tmp_path: Path, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = service.config.read_text()
    service.config.write_text(text.replace("ramp_v_per_s = 200.0", "ramp_v_per_s = 20.0"))
    said: list[str] = []

    def hear() -> str:
        try:
            while True:
                said.append(manager.recv(4096).decode())
        except BlockingIOError:
            return "\n".join(said)

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        with core(service.config) as process:
            service.high()
            hear()
            said.clear()
            process.send_signal(signal.SIGTERM)
            down = lambda: abs(service.rings.last()["volts"] - SAFE_V) < 0.01  # noqa: E731
            until(lambda: down() or process.poll() is not None, 60.0, "the ramp is over")
            assert process.wait(60.0) == 0
        assert hear().count("EXTEND_TIMEOUT_USEC=15000000") >= 2  # repeated each second
        assert "STOPPING=1" in next(one for one in said if "EXTEND_TIMEOUT_USEC" in one)
        with core(service.config) as process:
            service.high()
            process.kill()
            process.wait(10.0)
        said.clear()
        volts = service.output()
        safe = dehyst("safe", "--config", str(service.config))
        safe.communicate(timeout=60)
        asked = re.search(r"EXTEND_TIMEOUT_USEC=(\d+)", hear())
        assert asked
        assert int(asked.group(1)) * 1e-6 > (volts - SAFE_V) / 20.0
    unit = (UNITS / "dehyst.service").read_text()
    assert "NotifyAccess=exec\n" in unit  # otherwise messages of ExecStopPost= would not count


def test_both_killed_at_once_while_high_the_units_last_command_makes_it_safe(
    service: Service, capsys: pytest.CaptureFixture[str]
) -> None:
    """If supervisor and core are killed at once, the unit's ExecStopPost= command alone makes the
    output safe. The test prints the time; tests.benchmarks.daemon.kills judges it, without byte
    code too."""
    service.start()
    volts = service.high(13.4, 117.0)
    assert volts > 115.0
    pid = service.core_pid()
    assert service.supervisor is not None
    os.kill(service.supervisor.pid, signal.SIGKILL)
    os.kill(pid, signal.SIGKILL)
    service.supervisor.wait(10.0)
    until(lambda: not service.core_pid(), 10.0, "the core has gone")
    assert service.output() > 115.0
    found = re.search(r"^ExecStopPost=\S+/dehyst (.*)$", (UNITS / "dehyst.service").read_text(),
                      re.MULTILINE)  # fmt: skip
    assert found
    arguments = found.group(1).replace("/etc/dehyst/stage.toml", str(service.config)).split()
    begun = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", *arguments],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    took = time.monotonic() - begun
    assert done.returncode == 0, done.stderr
    assert service.output() == pytest.approx(SAFE_V, abs=0.02)
    with capsys.disabled():
        print(f" {volts:.0f} V to {SAFE_V:g} V in {took:.2f} s, "
              f"of which the ramp takes {(volts - SAFE_V) / 200.0:.2f} s ", end="")  # fmt: skip


def test_events_carry_their_time_and_belong_to_their_run(service: Service) -> None:
    service.start()
    assert service.high() > 60.0
    until(lambda: "ready: clients" in service.words(), 60.0, "ready")
    os.kill(service.core_pid(), signal.SIGKILL)
    until(lambda: service.words().count("the loop runs") == 2, 60.0, "the second run")
    assert service.end() == 0
    lines = [line for line in service.words().splitlines() if "the loop runs" in line]
    assert len(lines) == 2
    assert all(re.match(r"dehyst run: \d\d:\d\d:\d\d the loop runs", line) for line in lines)
    service.start()  # a new supervisor does not report earlier runs
    until(lambda: service.words().count("the loop runs") >= 3, 60.0, "the third run")
    time.sleep(1.0)
    assert service.words().count("the loop runs") == 3


def test_a_gateway_without_its_port_is_said_and_the_daemon_is_not_ready(
    tmp_path: Path, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the gateway's port is taken, the daemon reports that it is not ready, also to
    `systemctl status` through sd_notify, and the loop is not disturbed."""
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(str(tmp_path / "notify"))
    manager.setblocking(False)
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    states: list[str] = []

    def shown() -> str:
        """Return the newest STATUS= of the supervisor."""
        try:
            while True:
                said = manager.recv(4096).decode().splitlines()
                states.extend(s for s in said if s.startswith(("STATUS=ready", "STATUS=not ready")))
        except BlockingIOError:
            return states[-1] if states else ""

    with manager, socket.socket() as squatter:
        squatter.bind(("127.0.0.1", service.port))
        squatter.listen()
        service.start()

        def tried() -> bool:
            return bool(shown()) and service.words().count("not ready: gateway ended") >= 3

        until(tried, 90.0, "three tries")
        pauses = [float(p) for p in re.findall(r"next try in ([\d.]+) s", service.words())]
        assert pauses == sorted(pauses)
        assert pauses[2] > pauses[0]
        assert "cannot listen on" in service.words()
        assert "dehyst run: ready" not in service.words()
        assert shown().startswith("STATUS=not ready: gateway ended with code 2")
        assert "STATUS=ready" not in states
        assert service.rings.state() is State.READY  # the loop itself is not disturbed
        squatter.close()
        until(lambda: shown() == "STATUS=ready", 60.0, "ready when the port is free")
        # systemd is notified before the line is written
        until(lambda: "dehyst run: ready" in service.words(), 10.0, "the same in words")
        with service.client() as client:
            status = client.status()
            assert status.core_alive
            assert status.gateway.starts_refused >= 3
            assert status.gateway.unreachable_s > sum(pauses[:2])
            assert "cannot listen on" in status.gateway.refused_because
        os.kill(status.gateway.pid, signal.SIGKILL)  # the next one had no refused start
        until(lambda: service.words().count("listens at") == 2, 60.0, "the next gateway")
        with service.client() as client:
            assert client.status().gateway.starts_refused == 0


@pytest.mark.parametrize("command", ["core", "gateway"])
def test_who_was_started_by_a_supervisor_that_has_gone_ends_at_once(
    tmp_path: Path, model: Path, command: str
) -> None:
    """A process ends at once if its supervisor died before the kernel could be asked to signal its
    children."""
    with subprocess.Popen(["true"]) as gone:
        gone.wait()
    path = simulated_config(tmp_path, 100.0, model)
    done = subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", command, "--config", str(path)],
        env={**os.environ, "DEHYST_SUPERVISED": str(gone.pid)}, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 128 + signal.SIGTERM
    assert not (tmp_path / "run").exists()


def test_sighup_while_the_core_starts_reloads_once_it_runs(service: Service) -> None:
    service.start()
    assert service.supervisor is not None
    first = service.core_pid()
    os.kill(first, signal.SIGKILL)
    for _ in range(10):  # all of them before the second run can have a handler
        service.supervisor.send_signal(signal.SIGHUP)
        time.sleep(0.02)
    until(lambda: service.core_pid() not in (0, first), 60.0, "the second run")
    until(lambda: "model reloaded" in service.words(), 20.0, "the reload is not forgotten")
    assert service.words().count("core ended") == 1


def test_a_storm_of_sighups_takes_one_thread_and_few_reloads(service: Service) -> None:
    service.start()
    pid = service.core_pid()
    service.high()
    threads = len(list(Path(f"/proc/{pid}/task").iterdir()))
    most, sent, begun = 0, 0, time.monotonic()
    while time.monotonic() < begun + 4.0 or sent <= 100:
        os.kill(pid, signal.SIGHUP)
        sent += 1
        most = max(most, len(list(Path(f"/proc/{pid}/task").iterdir())))
        if sent % 20 == 0:
            service.hold_high()
        time.sleep(0.01)
    time.sleep(1.5)
    lasted_s = time.monotonic() - begun
    assert most <= threads + 2  # one for the reload, one that a library may start
    reloads = service.rings.events().count("model reloaded")
    assert 1 <= reloads <= lasted_s + 1.5  # with a second's rest after each
    records = service.rings.read("telemetry")
    assert (records["state"] != State.FAULT).all()


def test_a_full_disk_at_the_start_is_said_and_it_comes_when_there_is_room(
    service: Service,
) -> None:
    run = service.folder / "run"
    run.mkdir(mode=0o700)
    if os.system(f"mount -t tmpfs -o size=1m,mode=700 none {run} 2>/dev/null"):
        pytest.skip("needs the right to mount a small disk")
    try:
        with open(service.log, "ab") as words:
            service.supervisor = dehyst(
                "run", "--config", str(service.config), stdout=words, stderr=words
            )
        until(lambda: service.words().count("make room") >= 2, 120.0, "it is said, and tried again")
        assert service.supervisor.poll() is None
        assert not list(run.glob("*.new"))
        os.system(f"mount -o remount,size=64m {run}")
        until(lambda: service.rings.last() is not None, 120.0, "samples")
        assert "Traceback" not in service.words()
        assert service.end() == 0
    finally:
        service.close()
        os.system(f"umount -l {run}")
