"""The chaos test with each serial amplifier, and with a gauge reader: while a trajectory runs, its
cable is pulled, its answers come late and damaged, and another unit is put in its place."""

from collections.abc import Callable, Iterator

import pytest
from tests.rigs.chaos import units
from tests.rigs.chaos.kept import KeptRig

pytestmark = pytest.mark.timing  # slew is judged by the clock


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, KeptRig]]:
    def of(unit: str) -> KeptRig:
        return KeptRig(
            lambda: tmp_path_factory.mktemp(unit),
            lambda folder, model: units.UnitRig(folder, model, unit),
        )

    kept = {unit: of(unit) for unit in units.UNITS}
    yield kept
    for one in kept.values():
        one.close()


@pytest.mark.parametrize(
    ("unit", "fault"),
    [
        pytest.param(unit, fault, marks=pytest.mark.xdist_group(f"chaos {unit}"))
        for unit in units.UNITS
        for fault in (*units.FAULTS, *(units.GAUGE_FAULTS if unit == "kpz101" else ()))
    ],
)
def test_fault_of_a_unit(
    rigs: dict[str, KeptRig], unit: str, fault: Callable[[units.UnitRig], str]
) -> None:
    assert rigs[unit].inflict(fault).rows > 0
