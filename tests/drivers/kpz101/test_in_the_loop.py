"""A KPZ101 and a KSG101 on ptys in the daemon's own loop, while their links and units fail."""

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.two_loops import Rig, setpoint

from dehyst.daemon.loop.status import PLACE
from dehyst.daemon.rings.records import Flag, State
from dehyst.drivers.emulated.apt_port import AptEmulator
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Faults, Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.kpz101 import Kpz101
from dehyst.drivers.ksg101 import Ksg101

names = (f"apt-{i}" for i in itertools.count())
PATIENCE_S = 20.0
SLEW_V = 4.0  # a sample: 4000 V/s at 1 kHz, in virtual time
UM_PER_V = 0.115


class Bench:
    """Both units, the loop that drives them, and every voltage that left the amplifier."""

    def __init__(self, folder: Path) -> None:
        self.outputs_v = [0.0]
        self.amplifier = AptEmulator(
            Kpz101Unit(Kpz101Knobs(), lambda volts, time_s: self.outputs_v.append(volts)),
            folder / "kpz101",
        )
        gauge = Ksg101Unit(Ksg101Knobs(), lambda time_s: UM_PER_V * self.outputs_v[-1])
        self.gauge = PtyServer(gauge, folder / "ksg101")
        for server in (self.amplifier, self.gauge):
            server.start()
        devices = (
            Kpz101.from_settings({"port": self.amplifier.port, "timeout_s": 0.1}),
            Ksg101.from_settings({"port": self.gauge.port, "timeout_s": 0.1}),
        )
        for device in devices:
            device.open()
        self.devices = devices
        self.loop = Rig(next(names), devices=devices)

    def play(self, um: float, samples: int = 40) -> np.ndarray:
        """Go there; the records since."""
        before = self.loop.monitor.samples
        return self.loop.play([setpoint(um)], samples, compiled=False)[before:]

    def until_whole(self, um: float) -> None:
        """Until both devices are back and the loop follows set-points."""
        end_s = time.monotonic() + PATIENCE_S
        status = self.loop.monitor.numbers
        while not (status[PLACE["actuator_ok"]] and status[PLACE["sensor_ok"]]):
            assert time.monotonic() < end_s, "it did not come back"
            self.play(um, 5)
            time.sleep(0.005)  # the reconnecting thread lives in real time
        for _ in range(20):  # set-points go stale after 100 samples
            records = self.play(um, 60)
        while State(records["state"][-1]) is not State.RUNNING:  # an answer came late again
            assert time.monotonic() < end_s, "it does not follow again"
            records = self.play(um, 60)

    def events(self) -> list[str]:
        return [str(event["text"]) for event in self.loop.rings["event"].read(0)[0]]

    def close(self) -> None:
        for device in self.devices:
            device.close()
        for server in (self.amplifier, self.gauge):
            server.stop()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


def amplifier_fault(**fault: Any) -> Callable[[Bench], None]:
    return lambda bench: bench.amplifier.fault(**fault)


def gauge_fault(**fault: Any) -> Callable[[Bench], None]:
    def switch(bench: Bench) -> None:
        unit = bench.gauge.unit
        bench.gauge.call(lambda: setattr(unit, "faults", Ksg101Faults(**fault)))

    return switch


def repair(bench: Bench) -> None:
    bench.amplifier.clear_faults()
    gauge_fault()(bench)
    for server in (bench.amplifier, bench.gauge):
        server.plug()


def check_no_jump(bench: Bench) -> None:
    assert np.abs(np.diff(bench.outputs_v)).max() <= SLEW_V * (1 + 1e-3)  # rounded to counts
    assert bench.outputs_v[-1] == pytest.approx(bench.devices[0].output(), abs=5e-3)


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (lambda bench: bench.amplifier.unplug(), "DeviceGone"),
        (amplifier_fault(mute=True), "DeviceTimeout"),
        (amplifier_fault(delay_s=0.3), "DeviceTimeout"),
        (amplifier_fault(stuck=True), "ProtocolError"),
    ],
    ids=["unplugged", "mute", "late", "stuck"],
)
def test_an_amplifier_that_fails_is_named_and_its_output_stays_and_goes_on_without_a_jump(
    bench: Bench, fault: Callable[[Bench], None], kind: str
) -> None:
    bench.play(9.0, 80)
    assert bench.outputs_v[-1] > 30.0
    fault(bench)
    records = bench.play(3.0, 30)
    assert State.FAULT in records["state"]
    assert np.any(records["flags"] & Flag.WRITE_FAILED)
    assert any(kind in text for text in bench.events()), bench.events()
    stood_v = bench.outputs_v[-1]
    bench.play(3.0, 30)
    assert bench.outputs_v[-1] == stood_v
    repair(bench)
    bench.until_whole(3.0)
    check_no_jump(bench)


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (lambda bench: bench.gauge.unplug(), "DeviceGone"),
        (gauge_fault(mute=True), "DeviceTimeout"),
    ],
    ids=["unplugged", "mute"],
)
def test_without_its_gauge_the_stage_goes_on_by_the_model_alone(
    bench: Bench, fault: Callable[[Bench], None], kind: str
) -> None:
    bench.play(9.0, 80)
    fault(bench)
    records = bench.play(3.0, 30)
    assert set(records["state"].tolist()) == {State.RUNNING}
    assert np.all(records["flags"][-10:] & Flag.SENSOR_INVALID)
    assert any(kind in text for text in bench.events()), bench.events()
    repair(bench)
    bench.until_whole(3.0)
    assert np.isfinite(bench.play(3.0, 5)["measured"][-1])
    check_no_jump(bench)


def test_bytes_that_are_no_message_do_not_stop_it(bench: Bench) -> None:
    bench.play(9.0, 60)
    bench.amplifier.fault(garbage=20)
    gauge_fault(garbage=20)(bench)
    records = bench.play(4.0, 60)
    assert set(records["state"].tolist()) == {State.RUNNING}
    assert np.all(np.isfinite(records["measured"]))


def test_another_unit_at_the_port_gets_no_voltage(bench: Bench) -> None:
    bench.play(9.0, 60)
    own = bench.amplifier.unit
    other = Kpz101Unit(Kpz101Knobs(serial_number=29999999, start_v=50.0, enabled=True))
    bench.amplifier.unplug()
    bench.play(3.0, 20)
    bench.amplifier.call(lambda: setattr(bench.amplifier, "unit", other))
    bench.amplifier.plug()
    end_s = time.monotonic() + PATIENCE_S
    while not any("29999999" in text for text in bench.events()):
        assert time.monotonic() < end_s, bench.events()
        bench.play(3.0, 5)
        time.sleep(0.005)
    assert (other.sets_done, other.output_v()) == (0, pytest.approx(50.0, abs=5e-3))
    bench.amplifier.unplug()
    bench.amplifier.call(lambda: setattr(bench.amplifier, "unit", own))
    bench.amplifier.plug()
    bench.until_whole(3.0)
    assert other.sets_done == 0
