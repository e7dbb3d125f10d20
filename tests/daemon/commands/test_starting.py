"""A daemon can be reached before it is ready: every remote command says so or waits."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.daemon.commands.test_remote import run, start
from tests.rigs.gateway_bench import Bench, wait_until

from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.gateway.core_rings import LAYOUTS
from dehyst.daemon.rings.records import State
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS
from dehyst.models.errors import NotNow


@pytest.fixture
def without_a_loop(tmp_path: Path) -> Iterator[Bench]:
    """A gateway whose loop has not been started yet."""
    bench = Bench(tmp_path, start=False)
    bench.has_loop = False
    try:
        bench.start_gateway()
        yield bench
    finally:
        bench.close()
        if hasattr(bench, "loop"):
            bench.loop.close()


def test_before_the_loop_runs_nothing_breaks_and_send_waits(without_a_loop: Bench) -> None:
    bench = without_a_loop
    code, out, err = run("status", bench=bench)
    assert (code, err) == (0, "")
    assert out.startswith("bench: starting")
    code, out, _ = run("watch", "--for", "1.5", bench=bench)
    assert code == 0
    assert out.startswith("starting")
    code, out, _ = run("watch", "--list", bench=bench)
    assert (code, out.split()) == (0, ["bench", "starting"])
    with Client("bench", bench.address) as client:
        with pytest.raises(Refusal, match="is starting"):
            client.send(4.0)
        with pytest.raises(NotNow, match="still starting"):
            client.wait_until_started(0.2)
    sender = start("send", "4", bench=bench)
    assert sender.stderr is not None
    assert "bench is starting; waiting" in sender.stderr.readline()
    bench.start_loop()
    wait_until("the loop runs", bench.loop.running, 240.0)
    _, err = sender.communicate(timeout=60)
    assert sender.returncode == 0, err
    assert "going to 4 um" in err


def test_a_loop_that_compiles_is_silent_and_starts(without_a_loop: Bench) -> None:
    bench = without_a_loop
    names = ("telemetry", "status", "event", "command")
    rings = {n: Ring.create(bench.config.directory / f"{n}.ring", LAYOUTS[n], 64) for n in names}
    said = np.zeros(1, STATUS)
    said["state"], said["period_ns"], said["time_ns"] = State.START, 5_000_000, 1
    rings["status"].push(said[0])
    with Client("bench", bench.address) as client:
        wait_until("it is heard", lambda: client.status().core_alive)
        wait_until("it is silent", lambda: not client.status().core_alive)
        code, out, _ = run("status", bench=bench)
        assert (code, "bench: starting" in out, "does not respond" in out) == (0, True, False)
        with pytest.raises(Refusal, match="is starting"):
            client.send(4.0)
    for ring in rings.values():
        ring.close()


def test_the_status_says_where_the_stage_is(shared: Bench) -> None:
    client = shared.client()
    client.send(4.0)

    def there() -> bool:
        at = client.status().gateway
        return at.target == 4.0 and abs(at.measured - 4.0) < 0.5

    wait_until("the stage is there", there)
    client.send(4.0)  # the set-point becomes stale after a second
    newest = client.history(0.2)
    assert client.status().volts == pytest.approx(newest["volts"][-1], abs=0.5)

    def shown() -> bool:
        client.send(4.0)
        return "target 4.0000 um, error" in run("status", bench=shared)[1]

    wait_until("the status shows it", shown)
