"""The slow checks next to the loop: the amplifier's report, and whether the processes make
progress."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.loop.readback import IN_A_ROW, ReadbackCheck

MS = 1_000_000


def lagging(volts: np.ndarray, tau_s: float, period_s: float, offset_v: float) -> np.ndarray:
    """Return what an ADC with a lag and an offset reports for these set-points."""
    seen, out = volts[0], np.empty(volts.size)
    for i, v in enumerate(volts):
        seen += -np.expm1(-period_s / tau_s) * (v - seen)
        out[i] = seen + offset_v
    return out


@given(
    tau_s=st.floats(0.02, 0.25),
    offset_v=st.floats(-0.3, 0.3),
    slew=st.floats(1.0, 4000.0),
    seed=st.integers(0, 1000),
)
def test_a_healthy_unit_is_never_doubted(
    tau_s: float, offset_v: float, slew: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    goals = np.repeat(rng.uniform(0, 150, 12), rng.integers(20, 400))
    volts = np.empty(goals.size)
    now_v = goals[0]
    for i, goal in enumerate(goals):
        now_v += np.clip(goal - now_v, -slew * 0.01, slew * 0.01)
        volts[i] = now_v
    reports = lagging(volts, tau_s, 0.01, offset_v)
    check = ReadbackCheck(2.0, float(volts[0]))
    for i in range(volts.size):
        now_ns = (i + 1) * 10 * MS
        check.wrote(now_ns, float(volts[i]))
        if check.due(now_ns, moving=True):
            assert check.judge(float(reports[i])) == ""
    assert not check.doubtful


@pytest.mark.parametrize("wrong_v", [-5.0, 30.0, float("nan")])
def test_a_report_that_disagrees_is_doubted_after_three_and_believed_after_three(
    wrong_v: float,
) -> None:
    check = ReadbackCheck(2.0, 10.0)
    verdicts = [check.judge(10.0 + wrong_v) for _ in range(IN_A_ROW + 2)]
    assert verdicts == [""] * (IN_A_ROW - 1) + ["disagrees", "", ""]
    verdicts = [check.judge(10.2) for _ in range(IN_A_ROW + 1)]
    assert verdicts == [""] * (IN_A_ROW - 1) + ["agrees", ""]
    assert not check.doubtful


def test_one_stray_report_is_forgiven_and_asked_about_again_soon() -> None:
    check = ReadbackCheck(2.0, 10.0)
    assert check.due(10_000 * MS, moving=True)
    assert check.judge(90.0) == ""
    assert not check.due(10_100 * MS, moving=True)
    assert check.due(10_300 * MS, moving=True)
    assert check.judge(10.0) == ""
    assert not check.due(10_900 * MS, moving=True)
