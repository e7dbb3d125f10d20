"""The units, checked by systemd's own tools where they are installed."""

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
    """Unknown keys are reported on stderr alone, with exit code 0."""
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
