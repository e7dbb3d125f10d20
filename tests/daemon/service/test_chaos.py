"""The chaos test: real processes are killed and stopped, real ptys pulled, disks filled, messages
forged, while a trajectory runs. The amplifier emulator's own log is the witness of the output.

Faults are done to a daemon one after another: each must leave it in order for the next. Behind
one that failed everything is built anew, so that the next one is judged by itself.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.rigs.chaos import commands as chaos_commands
from tests.rigs.chaos import faults
from tests.rigs.chaos import pairs as chaos_pairs
from tests.rigs.chaos.rig import Rig
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model

FLOODS = (chaos_commands.flood, chaos_commands.stranger_floods)
DAEMONS = 3
"""Side by side, each with its share of the faults: they mostly wait."""
FAULTS = (
    *faults.DEVICES,
    *faults.HOST,
    *chaos_pairs.PAIRS,
    *chaos_commands.COMMANDS,
    *faults.PROCESSES,
)
ALL = [
    pytest.param(
        fault,
        id=fault.__name__,
        marks=pytest.mark.alone
        if fault in FLOODS
        else pytest.mark.xdist_group(f"chaos {number % DAEMONS}"),
    )
    for number, fault in enumerate(FAULTS)
]
pytestmark = pytest.mark.timing  # ramps, glides and slew are judged by the clock


class Rigs:
    """A running rig, and another one once it has been spoilt."""

    def __init__(self, place: Callable[[], Path]) -> None:
        self._place, self.rig = place, None

    def running(self) -> tuple[Rig, Path]:
        """The rig and the recording that runs beside everything."""
        if self.rig is None:
            folder = self._place()
            model = folder / "identified.toml"
            save_model(kept_model(), model)
            self.rig = Rig(folder, model)
            self.recording = folder / "whole.csv"
            self.rig.run()
            self.rig.record(self.recording)
        return self.rig, self.recording

    def close(self) -> None:
        """End it; the next one who asks gets another."""
        rig, self.rig = self.rig, None
        if rig is not None:
            rig.close()


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rigs]:
    rigs = Rigs(lambda: tmp_path_factory.mktemp("chaos"))
    yield rigs
    rigs.close()


@pytest.mark.parametrize("fault", ALL)
def test_fault(rigs: Rigs, fault: Callable[..., str]) -> None:
    if reason := faults.why_not(fault):
        pytest.skip(reason)
    options: dict[str, float] = {}
    if fault in FLOODS:  # the benchmark takes more, on a machine that is its own
        options = {"seconds": 2.0, "processes": 1}
    in_order = False
    try:
        outcome = faults.inflict(*rigs.running(), fault, **options)
        assert outcome.rows > 0
        in_order = True
    finally:
        if not in_order:
            rigs.close()
