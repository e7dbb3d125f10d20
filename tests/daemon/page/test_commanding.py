"""What ends a command of the page: real loop, gateway and sessions."""

import threading
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import Bench, wait_until

from dehyst.daemon import clock
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.questions import PATIENCE_S
from dehyst.daemon.page.commanding import Commander
from dehyst.daemon.page.watching import Watch

pytestmark = pytest.mark.processes


def test_a_command_that_is_still_connecting_when_all_axes_are_stopped_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path)
    connecting, go_on = threading.Event(), threading.Event()

    class Slow(Client):
        def __init__(self, *args: object) -> None:
            connecting.set()
            go_on.wait(60.0)
            super().__init__(*args)  # type: ignore[arg-type]

    try:
        bench.start_gateway()
        bench.client().close()
        watch = Watch(bench.address, "dehyst", "bench", "")
        monkeypatch.setattr("dehyst.daemon.page.commanding.Client", Slow)
        said: list[str] = []
        commander = Commander(watch, "somebody", lambda text, _: said.append(text))
        begun = bench.loop.seq
        commander.go(6.0, 30.0, False)
        assert connecting.wait(60.0)
        commander.end_task()
        go_on.set()
        wait_until("it has connected", lambda: commander.number != 0)
        wait_until("a second passes", lambda: bench.loop.seq > begun + 200)
        assert np.isnan(bench.loop.samples(begun)["target"]).all()
        commander.close()
        watch.close()
    finally:
        bench.close()


def test_a_stop_waits_while_the_gateway_restarts(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    try:
        bench.start_gateway()
        bench.client().close()
        watch = Watch(bench.address, "dehyst", "bench", "")
        wait_until("the page follows", lambda: watch.model is not None)
        bench.kill_gateway()
        begun_ns = clock.monotonic_ns()
        with pytest.raises(BusError):  # no gateway came
            watch.stop(at_once=False)
        assert clock.monotonic_ns() - begun_ns > 0.9 * PATIENCE_S * clock.NS
        watch.close()
    finally:
        bench.close()
