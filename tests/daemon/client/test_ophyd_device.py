"""The ophyd-async device over the bus, under bluesky's RunEngine, with a real loop and gateway."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import Bench, environment, may_lack, started_bench

pytest.importorskip("ophyd_async", reason="ophyd-async is not installed")
pytestmark = pytest.mark.processes
PLAN = """
import sys
import numpy as np
import bluesky.plan_stubs as bps, bluesky.plans as bp
from bluesky.run_engine import RunEngine
from ophyd_async.core import init_devices
from dehyst.client import Client
from dehyst.daemon.client.positioner import Positioner
from dehyst.ophyd import Stage

engine, seen = RunEngine({}), []
engine.subscribe(lambda name, doc: seen.append((name, doc)))
with init_devices():
    stage = Stage(lambda: Positioner(lambda: Client("bench", sys.argv[1])), name="stage")
engine(bp.scan([stage], stage, 3.0, 5.0, 3))
events = [doc["data"] for name, doc in seen if name == "event"]
assert [e["stage-setpoint"] for e in events] == [3.0, 4.0, 5.0], events
assert all(abs(e["stage-readback"] - e["stage-setpoint"]) < 0.5 for e in events), events
t_s = np.arange(400) / 200

def fly():
    yield from bps.open_run()
    yield from bps.prepare(stage, (t_s, 4.0 + np.sin(np.pi * t_s)), wait=True)
    yield from bps.kickoff(stage, wait=True)
    yield from bps.complete(stage, wait=True)
    yield from bps.close_run()

engine(fly())
np.save("flown.npy", stage.flown.samples)
stage.close()
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("bench")) as bench:
        yield bench


def test_bluesky_scans_and_flies_it(bench: Bench, tmp_path: Path) -> None:
    plan = tmp_path / "plan.py"
    plan.write_text(PLAN)
    begun = bench.loop.seq
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(plan), bench.address],
        env=environment(), cwd=tmp_path, text=True, capture_output=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    flown = np.load(tmp_path / "flown.npy")
    assert flown.size > 380 - may_lack(flown)
    targets = bench.loop.samples(begun)["target"]
    assert np.nanmax(targets) == 5.0
    assert any(np.isclose(targets, 4.0 + np.sin(np.pi * 100 / 200)))
