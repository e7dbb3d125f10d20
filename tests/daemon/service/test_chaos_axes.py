"""The chaos test with three axes on one amplifier: the faults that only several axes have.

x and y play, nobody commands z; the amplifier's own log of every channel is the evidence. `python
-m tests.benchmarks.daemon.chaos --axes 3` applies the rest of the table to axis x of three.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.rigs.chaos import axes, faults
from tests.rigs.chaos.axes_rig import AXES, AxesRig
from tests.rigs.chaos.rig import StoodStill

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.files.models import save_model
from dehyst.drivers.simulated.axes import settings_by_axis

pytestmark = pytest.mark.timing  # ramps and slew are judged by the clock


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[AxesRig, Path]]:
    folder = tmp_path_factory.mktemp("chaos-axes")
    models = {axis: folder / f"identified-{axis}.toml" for axis in AXES}
    for axis, stage in settings_by_axis(AXES, {}).items():
        save_model(simulated_model(stage), models[axis])
    rig = AxesRig(folder, models)
    try:
        rig.run()
        rig.record(folder / "whole.csv")
        yield rig, folder / "whole.csv"
    finally:
        rig.close()


@pytest.mark.parametrize("fault", [axes.leases_of_two, axes.knob_of_y, axes.amplifier_gone])
def test_fault(running: tuple[AxesRig, Path], fault: Callable[..., str]) -> None:
    try:
        assert faults.inflict(*running, fault).rows > 0
    except StoodStill as error:
        pytest.skip(str(error))
