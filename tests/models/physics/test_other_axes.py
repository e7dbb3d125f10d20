"""How coupling from another axis is reported: whose displacement or drive, and in which unit."""

import pytest

from dehyst.models.physics.coupling import Coupling


@pytest.mark.parametrize(
    ("channel", "begin", "unit"),
    [
        ("axis.y", "The displacement of axis y moves", "um/um"),
        ("axis.y.drive", "The drive of axis y moves", "um/v"),
        ("u2_v", "The channel u2_v moves", "um/v"),
        ("force_n", "The channel force_n moves", "um/n"),
    ],
)
def test_whose_motion_it_is(channel: str, begin: str, unit: str) -> None:
    one = Coupling(channel, 0.0, "um", "v")
    assert one.limit_unit == unit
    assert one.describe({"gain_um_per_unit": (0.025, unit)}).startswith(begin)
