"""Units that speak APT on ptys in the daemon's own loop, while their links and units fail: a KPZ101
with a KSG101, a KPC101, and a channel of a BPC303. The latter two have their own gauges."""

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from msgspec import structs
from tests.rigs.two_loops import Rig, setpoint

from dehyst.daemon.loop.status import PLACE
from dehyst.daemon.rings.records import Flag, State
from dehyst.drivers.emulated.amplifiers import AptEmulator
from dehyst.drivers.emulated.kpc101_unit import RACK_KNOBS, Bpc303Unit, Kpc101Knobs, Kpc101Unit
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Faults, Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.kpc101 import Bpc303, Bpc303Sensor, Kpc101, Kpc101Sensor
from dehyst.drivers.kpz101 import Kpz101
from dehyst.drivers.ksg101 import Ksg101

names = (f"apt-{i}" for i in itertools.count())
PATIENCE_S = 60.0
TIMEOUT_S, LATE_S = 3.0, 3.5  # a busy machine answers later than a unit
SLEW_V = 4.0  # per sample: 4000 V/s at 1 kHz, in virtual time
UM_PER_V = 0.115
CHANNEL = 2  # of the rack

Kind = Literal["kpz101", "kpc101", "bpc303"]
DRIVERS: dict[Kind, tuple[Any, Any]] = {
    "kpz101": (Kpz101, Ksg101),
    "kpc101": (Kpc101, Kpc101Sensor),
    "bpc303": (Bpc303, Bpc303Sensor),
}
FOREIGN = {"kpz101": 29999999, "kpc101": 113999999, "bpc303": 71999999}


class Bench:
    """The units, the loop that drives them, and every voltage at the amplifier's output. gauge: its
    port, which is the amplifier's if the unit reads the gauge itself."""

    def __init__(self, folder: Path, kind: Kind) -> None:
        self.kind = kind
        self.outputs_v = [0.0]
        self.amplifier = AptEmulator(self.unit(), folder / "amplifier")
        self.gauge: PtyServer = self.amplifier
        if kind == "kpz101":
            gauge = Ksg101Unit(Ksg101Knobs(), lambda time_s: UM_PER_V * self.outputs_v[-1])
            self.gauge = PtyServer(gauge, folder / "gauge")
        for server in self.servers:
            server.start()
        own = {"channel": CHANNEL} if kind == "bpc303" else {}
        devices = tuple(
            driver.from_settings({"port": server.port, "timeout_s": TIMEOUT_S, **own})
            for driver, server in zip(DRIVERS[kind], (self.amplifier, self.gauge), strict=True)
        )
        for device in devices:
            device.open()
        self.devices = devices
        self.loop = Rig(next(names), devices=devices)

    @property
    def servers(self) -> tuple[PtyServer, ...]:
        return tuple(dict.fromkeys((self.amplifier, self.gauge)))

    def unit(self, **knobs: Any) -> Kpz101Unit | Bpc303Unit:
        """Return a unit that drives the stage. knobs: how it differs from the usual one."""

        def moved(channel: int, volts: float, time_s: float) -> None:
            if channel == (CHANNEL if self.kind == "bpc303" else 1):
                self.outputs_v.append(volts)

        def position(channel: int, time_s: float) -> float:
            return UM_PER_V * self.outputs_v[-1]

        if self.kind == "kpz101":
            return Kpz101Unit(Kpz101Knobs(**knobs), lambda volts, time_s: moved(1, volts, time_s))
        if self.kind == "kpc101":
            return Kpc101Unit(Kpc101Knobs(**knobs), moved, position)
        return Bpc303Unit(structs.replace(RACK_KNOBS, **knobs), moved, position)

    def play(self, um: float, samples: int = 40) -> np.ndarray:
        """Follow this set-point and return the records since."""
        before = self.loop.monitor.samples
        return self.loop.play([setpoint(um)], samples, compiled=False)[before:]

    def until_whole(self, um: float) -> None:
        """Wait until both devices are back and the loop follows set-points."""
        end_s = time.monotonic() + PATIENCE_S
        status = self.loop.monitor.numbers
        while not (status[PLACE["actuator_ok"]] and status[PLACE["sensor_ok"]]):
            assert time.monotonic() < end_s, ("it did not come back", self.events())
            self.play(um, 5)
            time.sleep(0.005)  # the reconnecting thread runs in real time
        for _ in range(20):  # set-points go stale after 100 samples
            records = self.play(um, 60)
        while State(records["state"][-1]) is not State.RUNNING:  # a reply was late again
            assert time.monotonic() < end_s, "it does not follow again"
            records = self.play(um, 60)

    def events(self) -> list[str]:
        return [str(event["text"]) for event in self.loop.rings["event"].read(0)[0]]

    def close(self) -> None:
        for device in self.devices:
            device.close()
        for server in self.servers:
            server.stop()


EACH = pytest.mark.parametrize("bench", DRIVERS, indirect=True)
WITH_GAUGES = pytest.mark.parametrize("bench", ["kpc101", "bpc303"], indirect=True)


@pytest.fixture
def bench(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = Bench(tmp_path, getattr(request, "param", "kpz101"))
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
    if bench.gauge is not bench.amplifier:
        gauge_fault()(bench)
    for server in bench.servers:
        server.plug()


def check_no_jump(bench: Bench) -> None:
    assert np.abs(np.diff(bench.outputs_v)).max() <= SLEW_V * (1 + 1e-3)  # rounded to counts
    assert bench.outputs_v[-1] == pytest.approx(bench.devices[0].output(), abs=5e-3)


@EACH
@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (lambda bench: bench.amplifier.unplug(), "DeviceGone"),
        (amplifier_fault(mute=True), "DeviceTimeout"),
        (amplifier_fault(delay_s=LATE_S), "DeviceTimeout"),
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


@WITH_GAUGES
def test_without_the_gauge_that_the_unit_reads_itself_it_goes_on_by_the_model(
    bench: Bench,
) -> None:
    bench.play(9.0, 80)
    bench.amplifier.fault(gauge_pulled=True)
    records = bench.play(3.0, 60)
    assert set(records["state"].tolist()) == {State.RUNNING}
    assert np.all(records["flags"][-10:] & Flag.SENSOR_INVALID)
    assert bench.outputs_v[-1] < 30.0  # it follows the set-point
    repair(bench)
    bench.until_whole(3.0)
    assert np.isfinite(bench.play(3.0, 5)["measured"][-1])
    check_no_jump(bench)


@EACH
def test_bytes_that_are_no_message_do_not_stop_it(bench: Bench) -> None:
    bench.play(9.0, 60)
    bench.amplifier.fault(garbage=20)
    if bench.gauge is not bench.amplifier:
        gauge_fault(garbage=20)(bench)
    records = bench.play(4.0, 60)
    assert set(records["state"].tolist()) == {State.RUNNING}
    assert np.all(np.isfinite(records["measured"]))


@EACH
def test_another_unit_at_the_port_gets_no_voltage(bench: Bench) -> None:
    bench.play(9.0, 60)
    own, serial = bench.amplifier.unit, FOREIGN[bench.kind]
    other = bench.unit(serial_number=serial, start_v=50.0, enabled=True)
    bench.amplifier.unplug()
    bench.play(3.0, 20)
    bench.amplifier.call(lambda: setattr(bench.amplifier, "unit", other))
    bench.amplifier.plug()
    end_s = time.monotonic() + PATIENCE_S
    while not any(str(serial) in text for text in bench.events()):
        assert time.monotonic() < end_s, bench.events()
        bench.play(3.0, 5)
        time.sleep(0.005)
    assert (other.sets_done, other.output_v("y")) == (0, pytest.approx(50.0, abs=5e-3))
    bench.amplifier.unplug()
    bench.amplifier.call(lambda: setattr(bench.amplifier, "unit", own))
    bench.amplifier.plug()
    bench.until_whole(3.0)
    assert other.sets_done == 0
