"""A loop that is killed or suspended is reported within a second, and the first reading at once."""

import math
import os
import signal
import time
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from tests.rigs.gateway_bench import Bench, noted_pauses, wait_until

from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.core_rings import CoreRings, has_ended, is_suspended
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.gateway.publisher import Publisher, Served
from dehyst.daemon.gateway.refused_starts import RefusedStarts
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.status import positioning

AT_MOST_S = 1.0
"""By docs/topics.md."""


@pytest.mark.timing
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_loop_that_does_not_run_is_reported_within_a_second(bench: Bench, number: int) -> None:
    client = bench.client()
    assert client.status().core_alive
    with noted_pauses() as pauses:
        os.kill(bench.loop.process.pid, number)
        begun = time.monotonic()
        wait_until("the status says so", lambda: not client.status().core_alive)
        took_s = time.monotonic() - begun
    assert took_s < AT_MOST_S + max(pauses)
    os.kill(bench.loop.process.pid, signal.SIGCONT)
    if number == signal.SIGSTOP:
        wait_until("it is back", lambda: client.status().core_alive)


def test_a_process_that_runs_is_neither_ended_nor_suspended() -> None:
    assert not has_ended(os.getpid())
    assert not is_suspended(os.getpid())
    assert has_ended(2**22 + 1)  # more than the kernel gives


class Stand:
    """Stands in for the bus, which is not used."""

    def sender(self, *_: Any) -> Any:
        return self

    def put(self, *_: Any) -> None:
        """Publish nothing."""


def test_a_difference_is_reported_as_soon_as_there_is_a_reading(tmp_path: Path) -> None:
    """The loop itself reports once a second, first in a sample that may have no reading yet."""
    bench, stand = Bench(tmp_path, start=False), cast(Any, Stand())
    served = Served("bench", (), 0, RefusedStarts(), lambda: (0, 0))
    publisher = Publisher(
        bench.config, stand, Keys("dehyst", "bench"), CoreRings(tmp_path),
        Admission("um", 10.0, 2.0, Lease(10**9)), served,
    )  # fmt: skip
    publisher._record["differs"] = math.nan
    samples = np.zeros(40, TELEMETRY)
    samples["seq"], samples["predicted"], samples["measured"] = np.arange(40), 3.0, math.nan
    publisher.history.restart(1)
    publisher.history.add(samples[:20])
    assert "gives no reading" in positioning(publisher.status(1))
    samples["measured"][21:] = 3.25  # of the 20 newest, one has none
    publisher.history.add(samples[20:])
    assert publisher.status(1).differs == pytest.approx(0.25)
    assert "the gauge is +0.25" in positioning(publisher.status(1))
