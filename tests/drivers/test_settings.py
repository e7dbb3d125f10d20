"""The common reader of driver settings, and what every driver declares with it."""

import math
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, structs

from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.registry import list_plugins, list_settings
from dehyst.drivers.settings import Settings, list_keys, read_settings, read_values, unit_in_name


class Gauge(Settings, frozen=True):
    driver = "mygauge"

    port: Annotated[str, Meta(min_length=1, description="where it is")]
    axis: Annotated[Literal["x", "y"], Meta(description="which side")] = "x"
    timeout_s: Annotated[float, Meta(gt=0, le=10, description="longest wait")] = 0.1
    um_per_mv: Annotated[float, Meta(description="scale")] | None = None
    bits: Annotated[int, Meta(ge=8, le=32, description="of the converter")] = 16
    quick: Annotated[bool, Meta(description="less exact")] = False

    def check(self) -> None:
        if self.um_per_mv == 0:
            raise self.wrong("um_per_mv", "a number other than 0")


KEYS = "port, axis, timeout_s, um_per_mv, bits, quick"
GOOD = {"port": "/dev/x"}


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"prot": 3}, "unknown setting 'prot' (given: 3)"),
        ({"port": None}, "port = None must be a string that is not empty"),
        ({"port": ""}, "port = '' must be a string that is not empty"),
        ({"axis": "z"}, 'axis = \'z\' must be "x" or "y"'),
        ({"timeout_s": 0}, "timeout_s = 0 must be a number, above 0 and at most 10"),
        ({"timeout_s": 11.0}, "timeout_s = 11.0 must be a number, above 0 and at most 10"),
        ({"timeout_s": "1"}, "timeout_s = '1' must be a number, above 0 and at most 10"),
        ({"timeout_s": True}, "timeout_s = True must be a number, above 0 and at most 10"),
        ({"timeout_s": math.nan}, "timeout_s = nan must be a number, above 0 and at most 10"),
        ({"um_per_mv": math.nan}, "um_per_mv = nan must be a number;"),
        ({"um_per_mv": -math.inf}, "um_per_mv = -inf must be a number;"),
        ({"um_per_mv": 0.0}, "um_per_mv = 0.0 must be a number other than 0"),
        ({"bits": 16.5}, "bits = 16.5 must be a whole number from 8 to 32"),
        ({"bits": 7}, "bits = 7 must be a whole number from 8 to 32"),
        ({"quick": 1}, "quick = 1 must be true or false"),
    ],
)
def test_one_sentence_says_whose_key_is_wrong_what_is_allowed_and_which_keys_there_are(
    given: dict[str, Any], says: str
) -> None:
    with pytest.raises(DriverConfigError) as error:
        read_settings(Gauge, GOOD | given)
    assert str(error.value).startswith("mygauge: ")
    assert says in str(error.value) + ";"
    assert str(error.value).endswith(f"; known settings: {KEYS}")


def test_a_missing_key_is_named() -> None:
    with pytest.raises(DriverConfigError, match=r"mygauge: the setting port is missing.*known"):
        read_settings(Gauge, {})


def test_what_is_read_is_what_was_given() -> None:
    read = read_settings(Gauge, {"port": "a", "timeout_s": 2, "um_per_mv": -0.5, "quick": True})
    assert read == Gauge("a", "x", 2.0, -0.5, 16, True)
    assert type(read.timeout_s) is float
    assert read_values(Gauge, {"bits": 12}) == {"bits": 12}


def test_settings_made_in_a_program_are_checked_too_and_do_not_change() -> None:
    with pytest.raises(DriverConfigError, match="timeout_s"):
        Gauge("a", timeout_s=-1.0)
    with pytest.raises(DriverConfigError, match="bits"):
        structs.replace(Gauge("a"), bits=99)
    with pytest.raises(AttributeError):
        Gauge("a").bits = 9  # type: ignore[misc]


def test_keys_are_listed_with_type_default_unit_and_meaning() -> None:
    listed = {key.name: key for key in list_keys(Gauge)}
    assert list(listed) == KEYS.split(", ")
    timeout = listed["timeout_s"]
    assert (timeout.default, timeout.unit, timeout.meaning) == (0.1, "s", "longest wait")
    assert timeout.type == "a number, above 0 and at most 10"
    assert listed["port"].required
    assert listed["um_per_mv"].unit == "um per mV"
    assert listed["um_per_mv"].default is None


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("um_per_v_per_v", "um per V per V"),
        ("creep_gain_per_decade", "per decade"),
        ("resolution_bits", "bits"),
        ("max_rate_hz", "Hz"),
        ("stage", ""),
        ("s", "s"),
    ],
)
def test_the_unit_stands_in_the_name(name: str, unit: str) -> None:
    assert unit_in_name(name) == unit


def test_every_driver_here_declares_every_key_with_its_meaning() -> None:
    ours = [plugin for plugin in list_plugins() if plugin.package.startswith("dehyst ")]
    assert len(ours) >= 7
    for plugin in ours:
        keys = list_settings(plugin)
        assert keys, f"{plugin.name} declares no settings"
        assert [key.name for key in keys if not key.meaning] == []
        numbers = [key for key in keys if key.type.startswith("a number")]
        assert numbers, f"{plugin.name}: no numbers"
