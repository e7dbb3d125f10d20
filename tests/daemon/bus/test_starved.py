"""What the daemon publishes on a machine that is too busy to send it at once."""

import os
import subprocess
import sys

import pytest
from tests.rigs.gateway_bench import ROOT, environment, free_port, wait_until

from dehyst.daemon.bus.session import Bus

PAIRS = 100
ALL = [number.to_bytes(4, "big") for number in range(PAIRS)]
KEYS = ("starved/status", "starved/event")


def numbers(heard: list[tuple[str, bytes]], key: str) -> list[bytes]:
    return [payload[-4:] for of, payload in heard if of == key and payload]


@pytest.mark.skipif(not hasattr(os, "SCHED_IDLE"), reason="this system cannot starve threads")
def test_no_event_that_follows_a_status_is_lost() -> None:
    address = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "tests.rigs.starved_sender", address, "starved", str(PAIRS)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env=environment() | {"PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"},
    ) as daemon:  # fmt: skip
        assert daemon.stdin is not None
        assert daemon.stdout is not None
        assert daemon.stdout.readline() == b"ready\n"
        bus, heard = Bus.connect([address]), list[tuple[str, bytes]]()
        try:
            for key in KEYS:
                bus.listen(key, lambda key, payload: heard.append((key, payload)))
            wait_until("both are heard", lambda: {key for key, _ in heard} == set(KEYS))
            daemon.stdin.write(b"go\n")
            daemon.stdin.flush()
            wait_until("all is heard", lambda: all(numbers(heard, key) == ALL for key in KEYS), 5.0)
        finally:
            bus.close()
            daemon.stdin.close()
            daemon.wait(10.0)
