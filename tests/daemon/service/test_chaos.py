"""The chaos test: while a trajectory runs, real processes are killed and stopped, real ptys pulled,
disks filled and messages forged. The amplifier emulator's own log is the evidence of the output.

A daemon suffers one fault after another: each must leave it ready for the next. After a fault that
failed, everything is rebuilt, so that the next one is judged by itself.
"""

from collections.abc import Callable, Iterator

import pytest
from tests.rigs.chaos import commands as chaos_commands
from tests.rigs.chaos import faults
from tests.rigs.chaos import pairs as chaos_pairs
from tests.rigs.chaos.kept import KeptRig

FLOODS = (chaos_commands.flood, chaos_commands.stranger_floods)
DAEMONS = 3
"""Run in parallel, each with its share of the faults: they mostly wait."""
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


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KeptRig]:
    kept = KeptRig(lambda: tmp_path_factory.mktemp("chaos"))
    yield kept
    kept.close()


@pytest.mark.parametrize("fault", ALL)
def test_fault(rig: KeptRig, fault: Callable[..., str]) -> None:
    if reason := faults.why_not(fault):
        pytest.skip(reason)
    options: dict[str, float] = {}
    if fault in FLOODS:  # the benchmark floods for longer, on a machine of its own
        options = {"seconds": 2.0, "processes": 1}
    assert rig.inflict(fault, **options).rows > 0
