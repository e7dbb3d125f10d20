"""The example programs run as they are, against a gateway at their default address."""

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
def test_example_runs(bench: Bench, arguments: list[str], says: str) -> None:
    bench.client()
    # only address and duration differ from what a user runs
    path = ROOT / "docs" / "examples" / arguments[0]
    text = path.read_text().replace("Client(", f"Client(connect={bench.address!r}, ", 1)
    text = text.replace("tcp/127.0.0.1:7447", bench.address)
    text = text.replace("5.0", "0.5").replace("10.0", "0.5")
    done = subprocess.run(
        [sys.executable, "-c", text, *arguments[1:]],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert says in done.stdout
