"""Further channels: a temperature that the model's drift depends on, read through a real driver."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.drivers.iio.test_sensor import device
from tests.rigs.processes import Rings, core, simulated_config, until
from tests.rigs.stage_model import kept_model

from dehyst.daemon.config import ChannelConfig, parse_config
from dehyst.daemon.files.models import save_model
from dehyst.daemon.loop.channels import Channels
from dehyst.drivers.interface import DeviceNotFound
from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Block

PER_K_UM, REFERENCE_C = 0.1, 20.0


def thermometer(folder: Path) -> ChannelConfig:
    """Configure a converter's temperature channel at 20 degrees; its file holds thousandths."""
    device(folder, in_temp_raw="20000", in_temp_scale="1.0")
    settings = {"path": str(folder), "channel": "temp", "um_per_mv": 0.001}
    return ChannelConfig(driver="iio", settings=settings, every_s=0.05)


def set_to(folder: Path, text: str) -> None:
    """Overwrite the file in place, as the kernel does: the driver keeps the channel's file open."""
    with (folder / "in_temp_raw").open("r+") as file:
        file.write(text)
        file.truncate()


def test_values_arrive_scaled_and_a_failure_keeps_the_last(tmp_path: Path) -> None:
    config = thermometer(tmp_path / "iio")
    seen: list[tuple[str, float]] = []
    said: list[str] = []
    channels = Channels({"temp_c": config}, lambda *v: seen.append(v), said.append)
    try:
        channels.read("temp_c")
        assert seen == [("temp_c", pytest.approx(20.0))]
        set_to(tmp_path / "iio", "busy\n")
        for _ in range(3):
            channels.read("temp_c")
        assert len(seen) == 1
        assert len(said) == 1
        assert "ProtocolError" in said[0]
        assert "last value is kept" in said[0]
        set_to(tmp_path / "iio", "8388607\n")  # the end of the converter's range: no reading
        channels.read("temp_c")
        assert len(seen) == 1
        set_to(tmp_path / "iio", "21500\n")
        channels.read("temp_c")
        assert seen[-1] == ("temp_c", pytest.approx(21.5))
        assert said[-1] == "channel temp_c: back"
    finally:
        channels.close()


def test_a_channel_that_never_answered_is_not_said_to_stay(tmp_path: Path) -> None:
    said: list[str] = []
    channels = Channels({"temp_c": thermometer(tmp_path / "iio")}, lambda *_: None, said.append)
    try:
        set_to(tmp_path / "iio", "busy\n")
        channels.read("temp_c")
        assert said[0].endswith("not compensated")
    finally:
        channels.close()


def test_a_channel_that_is_not_there_is_an_error_at_the_start(tmp_path: Path) -> None:
    config = ChannelConfig(driver="iio", settings={"path": str(tmp_path / "none")})
    with pytest.raises(DeviceNotFound, match="none"):
        Channels({"temp_c": config}, lambda *_: None, lambda _: None)


def test_the_configuration_names_a_wrong_key(tmp_path: Path) -> None:
    text = simulated_config(tmp_path, 500.0, tmp_path / "m.toml").read_text()
    parse_config(text + '[channels.temp_c]\ndriver = "iio"\n')
    with pytest.raises(BadInput, match=r"every.*channels"):
        parse_config(text + '[channels.temp_c]\ndriver = "iio"\nevery = 1.0\n')
    with pytest.raises(BadInput, match="every_s"):
        parse_config(text + '[channels.temp_c]\ndriver = "iio"\nevery_s = 0.0\n')


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_the_running_core_follows_a_temperature(tmp_path: Path, engine: str) -> None:
    """The drive compensates the expansion: hysteresis plus expansion stay at the set-point."""
    own, folder = tmp_path / "own.toml", tmp_path / "iio"
    bare = kept_model()
    numbers = {"gain_per_k": 0.0, "expansion_um_per_k": PER_K_UM, "reference_c": REFERENCE_C}
    save_model(replace(bare, blocks=(Block("drift", "stage", numbers, "temp_c"),)), own)
    config = simulated_config(tmp_path, 500.0, own, f'engine = "{engine}"')
    thermometer(folder)
    with config.open("a") as file:
        file.write(
            f"""[channels.temp_c]
driver = "iio"
every_s = 0.05
[channels.temp_c.settings]
path = "{folder}"
channel = "temp"
um_per_mv = 0.001
"""
        )
    with core(config):
        rings = Rings(tmp_path)
        rings.drive(9.0, lambda last: last["target"] == 9.0)
        assert "not compensated" not in rings.events()
        before = float(rings.last()["volts"])
        set_to(folder, "25000\n")
        rings.drive(9.0, lambda last: last["volts"] < before - 1.0)
        rings.drive(9.0, lambda _: np.ptp(rings.read("telemetry")["volts"][-50:]) == 0.0)
        volts = rings.read("telemetry")["volts"]
        set_to(folder, "broken\n")
        until(lambda: "last value is kept" in rings.events(), 20, "the failure is reported")
        after = rings.drive(9.0, lambda last: last["target"] == 9.0)["volts"]
    drift_um = PER_K_UM * (25.0 - REFERENCE_C)
    path = np.concatenate([[0.0], volts])
    assert simulate_hysteresis(bare.hysteresis, path, 1 / 500)[-1] + drift_um == pytest.approx(
        9.0, abs=0.02
    )
    assert after == volts[-1]
