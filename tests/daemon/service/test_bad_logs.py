"""Supervision does not depend on the log: the loop is killed and SIGTERM sent, wherever stdout and
stderr lead."""

import os
import signal
import time
from pathlib import Path

import pytest
from tests.rigs.bad_logs import BAD_LOGS
from tests.rigs.processes import dehyst, until
from tests.rigs.service import SAFE_V, Service


@pytest.mark.parametrize("kind", BAD_LOGS)
def test_the_loop_comes_back_and_the_end_is_heard(
    service: Service, kind: str, tmp_path: Path
) -> None:
    try:
        with BAD_LOGS[kind](tmp_path) as (file, spoil):
            service.supervisor = dehyst(
                "run", "--config", str(service.config), stdout=file, stderr=file
            )
            until(lambda: service.core_pid() and service.rings.last() is not None, 120.0, "samples")
            service.high()
            spoil()
            first = service.core_pid()
            os.kill(first, signal.SIGKILL)
            until(lambda: service.output() < SAFE_V + 0.02, 30.0, "a safe output")
            until(lambda: service.core_pid() not in (0, first), 60.0, "the next loop")
            until(lambda: service.rings.last() is not None, 60.0, "its samples")
            service.high()
            service.supervisor.send_signal(signal.SIGHUP)  # as a closing terminal does
            time.sleep(0.5)
            assert service.supervisor.poll() is None
            assert service.end() == 0
    except PermissionError as error:
        pytest.skip(str(error))
    assert service.output() == pytest.approx(SAFE_V, abs=0.02)
