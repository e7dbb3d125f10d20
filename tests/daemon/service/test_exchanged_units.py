"""Two amplifiers of one kind swap ports: no voltage is ever set on the one that is unknown here."""

from pathlib import Path

import pytest
from tests.rigs.exchange import FOREIGN, FOREIGN_V, WAYS, Exchanged, TwoUnits
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model
from dehyst.daemon.main import main


@pytest.mark.parametrize("blank", [False, True], ids=["serial-number", "blank"])
@pytest.mark.parametrize("way", WAYS)
def test_the_foreign_unit_is_never_moved(tmp_path: Path, way: str, blank: bool) -> None:
    save_model(kept_model(), tmp_path / "model.toml")
    rig = Exchanged(tmp_path, tmp_path / "model.toml", blank)
    try:
        status = WAYS[way](rig)
        sets, volts = rig.foreign()
        assert (sets, volts) == (0, pytest.approx(FOREIGN_V, abs=0.01)), rig.words()
        assert status in (1, 2), rig.words()  # it did not end as asked
        if way in ("at_start", "in_motion", "loop_dead"):
            assert "another unit is plugged in" in rig.words()
            assert "dehyst config pin" in rig.words()
    finally:
        rig.close()


def test_pin_accepts_the_unit_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`dehyst config pin` accepts the connected unit and replaces the serial number that the
    configuration names; until then `dehyst safe` refuses the unit and does not move it."""
    save_model(kept_model(), tmp_path / "model.toml")
    rig = Exchanged(tmp_path, tmp_path / "model.toml", blank=False)
    try:
        text = rig.config.read_text()
        port = f'port = "{rig.units.port}"'
        rig.config.write_text(text.replace(port, f'{port}, serial_number = "150226175403"'))
        assert main(["config", "pin", "--config", str(rig.config)]) == 0
        rig.units.exchange()
        assert main(["safe", "--config", str(rig.config)]) == 2
        assert rig.foreign() == (0, pytest.approx(FOREIGN_V, abs=0.01))
        assert main(["config", "pin", "--config", str(rig.config)]) == 0
        assert f'serial_number = "{FOREIGN}"' in rig.config.read_text()
        assert rig.foreign() == (0, pytest.approx(FOREIGN_V, abs=0.01))
        capsys.readouterr()
        assert main(["safe", "--config", str(rig.config)]) == 0
        assert rig.foreign()[1] == pytest.approx(5.0, abs=0.02)
    finally:
        rig.close()


def test_a_new_configuration_names_the_unit_that_can_be_reached(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    units = TwoUnits(tmp_path, blank=False)
    try:
        command = ["config", "init", "--range", "0", "100", "--set", f"port={units.port}"]
        assert main(command) == 0
        assert 'serial_number = "150226175403"' in capsys.readouterr().out
        assert units.ask(0, "state")["sets"] == 0
    finally:
        units.close()
