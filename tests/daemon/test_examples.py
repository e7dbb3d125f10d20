"""The example programs against the gateway that $DEHYST_CONNECT names, and without one."""

import os
import subprocess
import sys

import pytest
from tests.rigs.gateway_bench import ROOT, Bench

PROGRAMS = [
    (["setpoint_client.py"], "measured"),
    (["telemetry_subscriber.py"], "largest error"),
    (["telemetry_subscriber.py", "--plain"], "samples, "),
]


@pytest.mark.parametrize(("arguments", "says"), PROGRAMS)
def test_example_runs(shared: Bench, arguments: list[str], says: str) -> None:
    shared.client()
    done = run(arguments, shared.address)
    assert done.returncode == 0, done.stderr
    assert says in done.stdout


@pytest.mark.parametrize(
    ("arguments", "address"),
    [*((arguments, "tcp/127.0.0.1:9") for arguments, _ in PROGRAMS), (PROGRAMS[0][0], "foo")],
)
def test_without_a_daemon_it_ends_in_one_line(arguments: list[str], address: str) -> None:
    done = run(arguments, address)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1
    assert address in done.stderr


def run(arguments: list[str], address: str) -> "subprocess.CompletedProcess[str]":
    """Run an example as a user does, but for a shorter time; the environment gives the address."""
    text = (ROOT / "docs" / "examples" / arguments[0]).read_text()
    text = text.replace("5.0", "0.5").replace("10.0", "0.5")
    return subprocess.run(
        [sys.executable, "-c", text, *arguments[1:]],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "DEHYST_CONNECT": address},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
