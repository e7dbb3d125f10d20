"""Which unit answers at a port."""

from pathlib import Path

from dehyst.daemon.setup.units import ask_port
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bFaults
from dehyst.drivers.emulated.mdt693b_unit import Mdt693bUnit
from dehyst.drivers.emulated.pty_device import PtyServer
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


def test_a_port_at_which_nothing_answers_has_no_unit(tmp_path: Path) -> None:
    unit = Mdt693bUnit()
    unit.faults = Mdt693bFaults(hang=True)
    with PtyServer(unit, tmp_path / "port") as server:
        assert ask_port(server.port, "x") is None
