"""A run folder that is removed under a running daemon is reported, and ends no healthy process."""

import os
import shutil
import signal
import time

import pytest
from tests.rigs.processes import until
from tests.rigs.service import SAFE_V, Service

from dehyst.daemon.service.heartbeat import CORE_HANG_S


def test_the_loop_outlives_its_folder_and_the_gateway(service: Service) -> None:
    service.start()
    with service.client() as client:
        gateway = client.status().gateway.pid
    service.high()
    core = service.core_pid()
    shutil.rmtree(service.folder / "run")
    until(lambda: "has gone" in service.words() or "have gone" in service.words(), 20.0, "a word")
    os.kill(gateway, signal.SIGKILL)
    end = time.monotonic() + CORE_HANG_S + 4.0
    while time.monotonic() < end:
        os.kill(core, 0)
        time.sleep(0.5)
    assert "core hangs" not in service.words()
    assert "core ended" not in service.words()
    assert service.end() == 0
    assert service.output() == pytest.approx(SAFE_V, abs=0.02)
