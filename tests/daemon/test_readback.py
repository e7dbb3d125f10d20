"""The slow checks beside the loop: the amplifier's report, and whether the processes move."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.pulse import CORE_HANG_S, GATEWAY_HANG_S, Pulse
from dehyst.daemon.readback import IN_A_ROW, ReadbackCheck
from dehyst.daemon.records import TELEMETRY
from dehyst.daemon.ring import Ring

MS = 1_000_000


def lagging(volts: np.ndarray, tau_s: float, period_s: float, offset_v: float) -> np.ndarray:
    """What an ADC with a lag and an offset reports of these set-points."""
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


def looked(pulse: Pulse, seconds: float, begin_s: float, act: object = None) -> list[bool]:
    """Look twice a second; [core was called hanging, gateway was called hanging]."""
    found = [False, False]
    for i in range(round(2 * seconds)):
        if callable(act):
            act()
        core, gateway = pulse.hanging(round((begin_s + 0.5 * i) * 1e9))
        found = [found[0] or core, found[1] or gateway]
    return found


def test_a_process_that_stands_still_is_called_hanging(tmp_path: Path) -> None:
    pulse = Pulse(tmp_path)
    assert looked(pulse, 60.0, 0.0) == [False, False]  # nothing there yet
    ring = Ring.create(tmp_path / "telemetry.ring", TELEMETRY, 64)
    assert looked(pulse, 60.0, 100.0) == [False, False]  # a core that is still compiling
    record = np.zeros(1, TELEMETRY)[0]

    def both_move() -> None:
        ring.push(record)
        ring.taken(ring.head)

    assert looked(pulse, 60.0, 200.0, both_move) == [False, False]
    assert pulse.beats
    assert looked(pulse, CORE_HANG_S - 1.0, 300.0) == [False, False]
    assert looked(pulse, 2.0, 300.0 + CORE_HANG_S - 1.0) == [True, False]
    assert looked(pulse, GATEWAY_HANG_S + 2.0, 400.0, lambda: ring.push(record)) == [False, True]


def test_a_machine_that_stood_still_is_no_hanging_process(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "telemetry.ring", TELEMETRY, 64)
    ring.push(np.zeros(1, TELEMETRY)[0])
    pulse = Pulse(tmp_path)
    assert pulse.hanging(0) == (False, False)
    assert pulse.hanging(3_600_000_000_000) == (False, False)
