"""Which unit answers at a port."""

from pathlib import Path

import pytest

from dehyst.daemon.setup.units import ask_port, gauge_beside
from dehyst.drivers.emulated.kpc101_unit import Kpc101Unit
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bFaults
from dehyst.drivers.emulated.mdt693b_unit import Mdt693bUnit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import DeviceTimeout
from dehyst.drivers.mdt693b.link import NO_COMMAND


class Waking(Mdt693bUnit):
    """An amplifier that hears nothing until it has been asked once."""

    asked = False

    def feed(self, data: bytes) -> None:
        if self.asked:
            super().feed(data)
        self.asked |= NO_COMMAND in data


def test_a_unit_that_is_too_late_for_the_first_answer_is_found(tmp_path: Path) -> None:
    with PtyServer(Waking(), tmp_path / "port") as server:
        found = ask_port(server.port, "x")
        assert found is not None
        assert found.driver == "mdt693b"


class Hearing(Kpc101Unit):
    """A controller with its own gauge that does not answer its first requests."""

    deaf = 0

    def feed(self, data: bytes) -> None:
        if self.deaf and data:
            self.deaf -= 1
        else:
            super().feed(data)


def test_a_unit_that_is_there_is_opened_again_if_it_was_late_once(tmp_path: Path) -> None:
    unit = Hearing()
    with PtyServer(unit, tmp_path / "port") as server:
        found = ask_port(server.port, "x", (("actuator", "kpc101"),))
        assert found is not None
        unit.deaf = 1
        gauge = gauge_beside(found)
        assert gauge is not None
        assert unit.deaf == 0
        unit.deaf = 1000
        with pytest.raises(DeviceTimeout):
            gauge_beside(found)


def test_a_port_at_which_nothing_answers_has_no_unit(tmp_path: Path) -> None:
    unit = Mdt693bUnit()
    unit.faults = Mdt693bFaults(hang=True)
    with PtyServer(unit, tmp_path / "port") as server:
        assert ask_port(server.port, "x") is None
