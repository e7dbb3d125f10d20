"""The chaos test: real processes are killed and stopped, real ptys pulled, disks filled, messages
forged, while a trajectory runs. The amplifier emulator's own log is the witness of the output.

All faults are done to one daemon, one after another: each must leave it in order for the next.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.daemon import chaos_commands, chaos_pairs
from tests.daemon import chaos_faults as faults
from tests.daemon.chaos_rig import Rig

from dehyst.daemon.benchconfig import simulated_model
from dehyst.daemon.files import save_model

LONG = (faults.stop_core, faults.stop_gateway, faults.stop_client)
FLOODS = (chaos_commands.flood, chaos_commands.stranger_floods)
ALL = (
    *faults.DEVICES, *chaos_commands.COMMANDS, *faults.HOST, *faults.PROCESSES, *chaos_pairs.PAIRS,
)  # fmt: skip


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("chaos")
    model = folder / "identified.toml"
    save_model(simulated_model(), model)
    rig = Rig(folder, model)
    try:
        rig.run()
        yield rig
    finally:
        rig.close()


@pytest.fixture(scope="module")
def recording(rig: Rig) -> Path:
    path = rig.folder / "whole.csv"
    rig.record(path)
    return path


@pytest.mark.parametrize("fault", ALL, ids=lambda fault: fault.__name__)
def test_fault(rig: Rig, recording: Path, fault: Callable[..., str]) -> None:
    if reason := faults.why_not(fault):
        pytest.skip(reason)
    options: dict[str, float] = {"seconds": faults.SHORT_S} if fault in (*LONG, *FLOODS) else {}
    if fault in FLOODS:
        options["processes"] = 1  # the benchmark takes more, on a machine that is its own
    outcome = faults.inflict(rig, fault, recording, **options)
    assert outcome.rows > 0
