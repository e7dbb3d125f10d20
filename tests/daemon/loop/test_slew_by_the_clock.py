"""The slew limit in real time: in any window, of whatever length, the output moves by at most the
slew rate times that length, plus one step; late samples are not caught up.

In virtual time for both loops, and on the emulated bench by the amplifier's own log.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.rigs.output import check_speed
from tests.rigs.processes import EmulatedBench, Rings, core, until
from tests.rigs.stage_model import kept_model
from tests.rigs.two_loops import PERIOD_NS, Rig, VirtualClock, setpoint

from dehyst.daemon.files.models import save_model
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.records_in_memory import SETTINGS
from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand
from dehyst.drivers.interface import DeviceTimeout
from dehyst.drivers.simulated.devices import SimulatedActuator, SimulatedSensor

SLEW_V_PER_S = 4000.0
DAC_STEP_V = 2.75e-3
LATE_NS = (5000, 5000, 16_500_000, 5000, 300_000, 5000, 5000, 2_400_000, 900_000, 5000, 40_000_000)


def worst_excess(time_s: NDArray[np.float64], volts: NDArray[np.float64], slew: float) -> float:
    """Return by how many volts the worst of all windows exceeds slew times its length."""
    worst = 0.0
    for way in (volts, -volts):
        ahead = way - slew * time_s
        worst = max(worst, float((ahead - np.minimum.accumulate(ahead)).max()))
    return worst


def test_the_measure_finds_what_was_found() -> None:
    """`worst_excess` finds 10 V in 4.9 ms, 5.1 V more than 1000 V/s allows; comparing neighbouring
    samples would find this only by chance."""
    t = np.array([0.0, 10.0, 26.5, 31.4, 41.0]) * 1e-3
    v = np.array([0.0, 10.0, 19.0, 29.0, 38.0])
    assert worst_excess(t, v, 1000.0) == pytest.approx(0.0051 * 1000.0)
    assert worst_excess(t, v, 4000.0) == 0.0


@pytest.mark.parametrize("compiled", [False, True])
def test_late_samples_are_not_caught_up_with(compiled: bool) -> None:
    rig = Rig(f"late-{compiled}", lateness_ns=LATE_NS)
    batches = []
    for i in range(40):
        batch = np.zeros(1, COMMAND)
        batch["kind"], batch["value"] = LoopCommand.SETPOINT, (10.0, 1.0)[i % 2]
        batches.append(batch)
    rig.stepper.table.kept[SETTINGS]["approach_um_per_s"] = 1e5
    records = rig.play(batches, 60, compiled)
    assert np.ptp(records["volts"]) > 50.0
    assert (records["flags"] & Flag.SLEW > 0).sum() > 100
    step_v = SLEW_V_PER_S * PERIOD_NS * 1e-9
    time_s = records["actual_ns"] * 1e-9
    assert worst_excess(time_s, records["volts"], SLEW_V_PER_S) <= step_v * 1.01


class SlowAmplifier(SimulatedActuator):
    """An amplifier whose output changes somewhere within a call: after the request's delay and
    before the reply."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.clock: VirtualClock | None = None
        self.random = np.random.default_rng(4)
        self.log: list[tuple[int, float]] = []

    def write(self, volts: float) -> None:
        """Delay the request or the reply now and then."""
        super().write(volts)
        if self.clock is not None:
            there, back = self.random.choice((300_000, 350_000, 800_000)), 200_000
            self.clock.now_ns += int(there)
            self.log.append((self.clock.now_ns, volts))
            self.clock.now_ns += int(back + self.random.choice((0, 50_000, 500_000)))


def slow_rig(kind: type[SlowAmplifier], stage: str) -> tuple[Any, Rig]:
    """Return the amplifier and its rig; set-points are approached as fast as the slew limit
    allows."""
    settings = {"stage": stage, "period_s": PERIOD_NS * 1e-9}
    amplifier = kind.from_settings(settings)
    devices = amplifier, SimulatedSensor.from_settings(settings)
    for device in devices:
        device.open()
    rig = Rig(stage, devices=devices)
    amplifier.clock = rig.clock
    rig.stepper.table.kept[SETTINGS]["approach_um_per_s"] = 1e5
    return amplifier, rig


def test_no_window_holds_more_when_calls_take_longer_and_shorter() -> None:
    amplifier, rig = slow_rig(SlowAmplifier, "slow")
    rig.play([setpoint((10.0, 1.0)[i % 2]) for i in range(40)], 60, compiled=False)
    time_ns, volts = (np.array(column) for column in zip(*amplifier.log, strict=True))
    assert np.ptp(volts) > 50.0
    assert volts.size > 1500
    step_v = SLEW_V_PER_S * PERIOD_NS * 1e-9
    check_speed(time_ns, volts, SLEW_V_PER_S, step_v)
    moved = np.abs(np.diff(volts)).sum() / ((time_ns[-1] - time_ns[0]) * 1e-9)
    assert moved > 0.3 * SLEW_V_PER_S  # not met by standing still


class HangingAmplifier(SlowAmplifier):
    """Now and then it carries out a large step long after the call has timed out, just before the
    unit answers again."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.steps, self.hung, self.late = 0, 0, 0.0

    def write(self, volts: float) -> None:
        # a full step, in the direction of the ramp that follows
        self.steps += bool(self.log) and volts < self.log[-1][1] - 3.9
        if self.clock is None or self.steps < 5:
            SimulatedActuator.write(self, volts)
            if self.clock is not None:
                self.log.append((self.clock.now_ns, volts))
            return
        self.steps, self.late = 0, volts
        self.hung += 1
        self.clock.now_ns += 3 * PERIOD_NS
        raise DeviceTimeout("no answer")

    def reconnect(self) -> None:
        super().reconnect()
        assert self.clock is not None
        SimulatedActuator.write(self, self.late)
        self.log.append((self.clock.now_ns, self.late))


@pytest.fixture
def back_at_the_third_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that is down is reconnected as usual, but without a thread of its own."""

    def came_back(link: DeviceLink) -> bool:
        link.errors += 1
        if link.errors % 3:
            return False
        link.device.reconnect()
        link.ok = True
        return True

    monkeypatch.setattr(DeviceLink, "down", lambda link, error: setattr(link, "ok", False))
    monkeypatch.setattr(DeviceLink, "came_back", came_back)


class MisreportingAmplifier(SlowAmplifier):
    """Fails once; from then on its output is 0.2 V below what it reports, as an ADC would."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.failed_at = 0

    def write(self, volts: float) -> None:
        SimulatedActuator.write(self, volts)
        if self.clock is not None:
            self.log.append((self.clock.now_ns, volts))
            if len(self.log) == 200:
                self.failed_at = len(self.log)
                raise DeviceTimeout("no answer")

    def output(self) -> float:
        return super().output() + (0.2 if self.failed_at else 0.0)


@pytest.mark.usefixtures("back_at_the_third_look")
def test_a_reported_voltage_is_not_written_back() -> None:
    """Back again at about 100 V, the output ramps to 5 V in steps of 0.4 V. The reported voltage is
    not written before the first step: that would move the output by the error of the report."""
    amplifier, rig = slow_rig(MisreportingAmplifier, "misreporting")
    rig.play([setpoint(10.0)], 500, compiled=False)
    volts = np.array([v for _, v in amplifier.log])
    stood, ramp = volts[amplifier.failed_at - 1], volts[amplifier.failed_at :]
    assert stood > 50.0
    assert ramp[0] == pytest.approx(stood + 0.2 - 0.4, abs=1e-9)
    assert np.all(np.diff(ramp) < 0)


@pytest.mark.usefixtures("back_at_the_third_look")
def test_no_window_holds_more_where_a_command_is_carried_out_late() -> None:
    amplifier, rig = slow_rig(HangingAmplifier, "hanging")
    # back again, it ramps at once: together with the late step this exceeds the limit
    rig.play([setpoint((10.0, 1.0)[i % 2]) for i in range(60)], 60, compiled=False)
    assert amplifier.hung >= 5
    time_ns, volts = (np.array(column) for column in zip(*amplifier.log, strict=True))
    assert np.ptp(volts) > 40.0
    check_speed(time_ns, volts, SLEW_V_PER_S, SLEW_V_PER_S * PERIOD_NS * 1e-9)


def test_the_amplifiers_own_log_while_the_gauge_is_late(tmp_path: Path) -> None:
    save_model(kept_model(), tmp_path / "model.toml")
    bench = EmulatedBench(tmp_path)
    try:
        config = bench.config(100.0, tmp_path / "model.toml")
        text = config.read_text().replace("slew_v_per_s = 4000.0", "slew_v_per_s = 1000.0")
        config.write_text(text.replace("[setpoint]", "[setpoint]\napproach_um_per_s = 1000.0"))
        rings = Rings(tmp_path)
        with core(config):
            bench.control(fault="late", late_s=0.0165, for_s=6.0)
            end = time.monotonic() + 7.0
            while time.monotonic() < end:
                for value in (9.0, 2.0):
                    rings.command(LoopCommand.SETPOINT, value)
                    time.sleep(0.11)
            until(lambda: rings.last("status")["missed"] > 5, 20.0, "missed deadlines")
        time_ns, volts = bench.output()
    finally:
        bench.close()
    assert np.ptp(volts) > 50.0
    assert worst_excess(time_ns * 1e-9, volts, 1000.0) <= 1000.0 * 0.01 + DAC_STEP_V
