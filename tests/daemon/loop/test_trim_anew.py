"""The trim on the simulated stage, after a loop that died and after a gauge that was wrong."""

import math

import numpy as np
import pytest
from tests.rigs.trim_anew import ON_TARGET_UM, die, drift, error_um, frozen, rig, wander
from tests.rigs.trimmed_stage import TrimmedStage

from dehyst.models.learning.freeze_reason import FreezeReason


@pytest.mark.parametrize("share", [0.0, 0.02, -0.02])
@pytest.mark.parametrize("after_s", [0.1, 0.5, 1.5])
def test_on_target_again_after_a_loop_that_died(share: float, after_s: float) -> None:
    """After a restart the trim brings the stage back on target, also if the reading is off by a
    share of the reach from some time after the restart on."""
    one = rig()
    low, high = one.reach
    for death in range(4):
        wander(one, 4.0, death)
        die(one)
        begun, off = one.now_ns, share * (high - low)

        def late(rig: TrimmedStage, reading: float, begun: int = begun, off: float = off) -> float:
            return reading + (off if rig.now_ns - begun > after_s * 1e9 else 0.0)

        one.go(0.5 * (low + high), 15.0, late)
        assert not frozen(one)
        assert abs(error_um(one, off)) < ON_TARGET_UM


def test_on_target_again_after_a_gauge_that_drifted_and_jumped_back() -> None:
    one = rig()
    drift(one, 3.0, 30.0)
    assert abs(error_um(one)) > 0.5  # indistinguishable from a stage that drifts
    one.go(0.5 * sum(one.reach), 12.0)
    assert not frozen(one)
    assert abs(error_um(one)) < ON_TARGET_UM
    said = [text for text in one.stepper.events if "trim" in text]
    assert "plausible" in said[-2]
    assert "resumes once the reading is settled" in said[-2]
    assert "the trim resumes" in said[-1]
    trim = one.telemetry["trim"]
    most = float(one.stepper.trim_setting["rate"][0]) * one.period_ns * 1e-9
    assert np.abs(np.diff(trim)).max() <= most * (1 + 1e-9)
    assert np.abs(trim).max() <= float(one.stepper.trim_setting["limit"][0])


@pytest.mark.parametrize("wrong", [1.0, -1.5, 3.0, 8.0, math.nan])
@pytest.mark.parametrize("moves", [False, True])
def test_a_gauge_that_stays_wrong_does_not_move_the_stage(wrong: float, moves: bool) -> None:
    one = rig()
    low, high = one.reach
    one.go(0.5 * (low + high), 5.0)
    before = one.records[-1]["trim"]
    for k in range(10):
        place = 0.5 * (low + high) + (3.0 * math.sin(k) if moves else 0.0)
        one.go(place, 3.0, lambda _, reading: reading + wrong)
    assert frozen(one)
    assert abs(one.records[-1]["trim"] - before) < 0.02
    said = int(one.stepper.trim["lasting"][0])
    assert said in (FreezeReason.JUMPED, FreezeReason.BEYOND, FreezeReason.NO_READING)
