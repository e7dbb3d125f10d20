"""The units, checked by systemd's own tools if they are installed."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

UNITS = Path(__file__).resolve().parents[2] / "systemd"
SERVICES = (
    "dehyst.service",
    "dehyst-gateway.service",
    "dehyst-page.service",
    "dehyst-epics.service",
    "dehyst-doctor.service",
)
EXPOSURE = 2.0

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed"
)


@needs_systemd
def test_verify_has_nothing_to_say(tmp_path: Path) -> None:
    """Unknown keys are only reported on stderr, with exit code 0."""
    executable = Path(sys.executable).with_name("dehyst")
    for name in SERVICES:
        text = (UNITS / name).read_text().replace("/opt/dehyst/bin/dehyst", str(executable))
        (tmp_path / name).write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *(str(tmp_path / s) for s in SERVICES)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    complaints = [line for line in done.stderr.splitlines() if "dehyst" in line]
    assert complaints == []
    assert done.returncode == 0


@needs_systemd
@pytest.mark.parametrize("name", SERVICES)
def test_exposure(name: str) -> None:
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", "--no-pager", str(UNITS / name)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", done.stdout)
    assert found, done.stderr
    assert float(found.group(1)) <= EXPOSURE


def test_units_run_commands_that_exist_and_their_own_user() -> None:
    from dehyst.daemon.main import COMMANDS

    for name in SERVICES:
        text = (UNITS / name).read_text()
        for command in re.findall(r"/opt/dehyst/bin/dehyst (\w+)", text):
            assert command in COMMANDS
        assert "User=dehyst" in text
        assert "CPUSchedulingPolicy" not in text  # helper threads would inherit it
        for promise in (
            "Type=notify",
            "WatchdogSec=",
            "NoNewPrivileges=yes",
            "StartLimitIntervalSec=0",
        ):
            assert promise in text
    assert "ExecStopPost=" in (UNITS / "dehyst.service").read_text()
    assert "BindsTo=dehyst.service" in (UNITS / "dehyst-gateway.service").read_text()


def test_what_guards_the_output_comes_before_what_serves_clients() -> None:
    """The loop and `safe` come first, then the gateway, then servers for people and programs, and
    the doctor last: the order equals that of the processes of `dehyst run`."""
    from dehyst.daemon.loop.timing.realtime import NICE

    nice = {}
    for name in SERVICES:
        found = re.search(r"^Nice=(-?[0-9]+)$", (UNITS / name).read_text(), re.M)
        assert found, f"{name} has no priority"
        nice[name] = int(found.group(1))
    loop, gateway, page, epics, doctor = (nice[name] for name in SERVICES)
    assert loop < gateway < 0 < min(page, epics) <= max(page, epics) < doctor
    assert NICE["safe"] < NICE["core"] <= NICE["run"] < NICE["gateway"] < 0 < NICE["page"]


def test_a_process_of_a_terminal_leaves_the_priority_of_that_terminal_alone() -> None:
    """The kernel weighs all processes of one session together."""
    group = Path("/proc/self/autogroup")
    if not group.exists():
        pytest.skip("this kernel does not group by sessions")
    code = (
        "import os, sys; from pathlib import Path\n"
        "from dehyst.daemon.loop.timing.realtime import take_place\n"
        "group = Path('/proc/self/autogroup'); before = group.read_text()\n"
        "if os.fork() == 0: take_place('page'); os._exit(0)\n"
        "os.wait(); member = group.read_text() == before\n"
        "take_place('page'); print(member, group.read_text() != before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True,
        start_new_session=True, env={"PYTHONPATH": str(UNITS.parent / "src")},
    )  # fmt: skip
    assert done.stdout.split() == ["True", "True"]
