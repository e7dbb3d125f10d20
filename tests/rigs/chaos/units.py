"""The rig of the chaos tests with another amplifier, and the faults that any serial one can have.

An MDT694B and a KPZ101 have a separate KSG101; a KPC101 and a BPC303 read their own gauge on the
same line, so that a fault of the amplifier's line also affects the gauge.
"""

import time
from pathlib import Path

from tests.rigs.chaos.faults import unplug
from tests.rigs.chaos.rig import Rig
from tests.rigs.processes import PATIENT, TIMEOUT_S

from dehyst.daemon.rings.records import Flag, State

UNITS = ("mdt694b", "kpz101", "kpc101", "bpc303")
PORTS = {"mdt694b": "mdt693b"}
"""The bench's name of the port, if it is not the driver's name."""
OWN_GAUGE = ("kpc101", "bpc303")
OWN_NUMBERS = {
    "mdt694b": 150226175403,
    "kpz101": 29000123,
    "kpc101": 113000123,
    "bpc303": 71000123,
}
GAUGE_NUMBER = 59000123
FOREIGN_NUMBER = 7
AWAY_S, FOREIGN_S = 1.0, 3.0
DEVICES = """\
actuator = {{driver = "{driver}", settings = {{port = "{port}", {patient}}}}}
sensor = {{driver = "{gauge}", settings = {{port = "{gauge_port}", {patient}}}}}"""
LATER_S = 1.5
"""A delay of an answer, longer than the time-out."""


class UnitRig(Rig):
    """The complete running rig with one of UNITS."""

    def __init__(self, folder: Path, model: Path, unit: str, on_fault: str = "ramp") -> None:
        self.unit, self.bench_options = unit, ("--amplifier", unit)
        self.port_name = PORTS.get(unit, unit)
        super().__init__(folder, model, on_fault)

    def devices(self) -> str:
        """Return the configuration's lines about the devices."""
        port = self.ports[self.port_name]
        own = self.unit in OWN_GAUGE
        return DEVICES.format(
            patient=PATIENT,
            driver=self.unit,
            port=port,
            gauge=self.unit if own else "ksg101",
            gauge_port=port if own else self.ports["ksg101"],
        )

    def exchange(self, serial_number: int) -> None:
        """Unplug the unit; the one plugged in after a while has this serial number."""
        self.bench_order(
            fault="unplug", device=self.port_name, for_s=AWAY_S, serial_number=serial_number
        )


def late(rig: UnitRig) -> str:
    """the unit answers 1.5 s late"""
    rig.bench_order(amplifier={"delay_s": LATER_S, **_replies(rig, 1000)}, for_s=2.0 * LATER_S)
    rig.until_state(State.FAULT)
    rig.until_event("actuator: back", 30.0)
    assert "within" in rig.events(), rig.events()  # the driver's message for a time-out
    return "fault (time-out), reconnected"


def damaged(rig: UnitRig) -> str:
    """random bytes in the unit's answers"""
    noise = True if rig.unit in PORTS else 20
    rig.bench_order(amplifier={"garbage": noise, **_replies(rig, 2)})
    time.sleep(TIMEOUT_S + 0.5)
    if State.FAULT in rig.states():
        rig.bench_order(clear=True)
        rig.until_event("actuator: back", 30.0)
        return "fault (protocol), reconnected"
    rig.until_running()
    return "passed over: the answers behind the noise are found"


def foreign(rig: UnitRig) -> str:
    """another unit plugged in for a while"""
    rig.exchange(FOREIGN_NUMBER)
    rig.until_state(State.FAULT)
    begun_ns, sets = time.monotonic_ns(), _sets(rig)  # not plugged in yet
    rig.until_event("another unit", 30.0)
    time.sleep(FOREIGN_S)
    assert "actuator: back" not in rig.events(), rig.events()
    assert _sets(rig) == sets, "the foreign unit was set"
    rig.check_held(begun_ns)
    rig.exchange(OWN_NUMBERS[rig.unit])
    rig.until_event("actuator: back", 30.0)
    return f"fault, named; nothing was set on it in {FOREIGN_S:g} s; its own unit is taken again"


def gauge_damaged(rig: Rig) -> str:
    """random bytes in the gauge's answers"""
    rig.bench_order(gauge={"garbage": 20})
    time.sleep(0.5)
    rig.until_running()
    assert State.FAULT not in rig.states()
    return "passed over, the loop goes on"


def gauge_foreign(rig: Rig) -> str:
    """another gauge plugged in for a while"""
    away = {"fault": "unplug", "device": "ksg101", "for_s": AWAY_S}
    rig.bench_order(**away, serial_number=FOREIGN_NUMBER)
    rig.until_event("another unit", 30.0)
    time.sleep(FOREIGN_S)
    assert rig.flags() & Flag.SENSOR_INVALID
    assert "sensor: back" not in rig.events(), rig.events()
    rig.bench_order(**away, serial_number=GAUGE_NUMBER)
    rig.until_event("sensor: back", 30.0)
    assert State.FAULT not in rig.states()
    return "named and not read, the loop goes on; its own gauge is taken again"


FAULTS = (unplug, late, damaged, foreign)
GAUGE_FAULTS = (gauge_damaged, gauge_foreign)
"""Faults of a KSG101; its other faults are in the rig of an MDT693B."""


def _replies(rig: UnitRig, count: int) -> dict[str, int]:
    """Return how many replies are affected: only an MDT694B needs that number."""
    return {"count": count} if rig.unit in PORTS else {}


def _sets(rig: UnitRig) -> int:
    return int(rig.bench_order()["sets"])
