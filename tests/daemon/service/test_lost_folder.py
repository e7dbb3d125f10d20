"""A run folder that is removed under a running daemon is reported, and ends no healthy process."""

import os
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.processes import until
from tests.rigs.service import SAFE_V, Service
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model
from dehyst.daemon.service.heartbeat import CORE_HANG_S


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    save_model(kept_model(), tmp_path / "model.toml")
    service = Service(tmp_path, tmp_path / "model.toml")
    try:
        yield service
    finally:
        service.close()


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
