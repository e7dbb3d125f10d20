"""A third-party client of the MDT693B, mdt69x from the package index, talking to the emulated unit.
Differences and their known causes: docs/other-mdt693b-clients.md."""

import contextlib
import importlib.util
import io
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.emulated.pty_device import serve

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(importlib.util.find_spec("mdt69x") is None, reason="no mdt69x"),
]
AS_IT_EXPECTS = {"echo": False, "bare_numbers": True, "compatibility_prompt": b"*"}
EXACT = {"readback_noise_v": 0.0, "readback_offset_v": 0.0, "readback_lag_s": 0.0}


@contextlib.contextmanager
def unit(folder: Path, **knobs: Any) -> Iterator[Mdt693bEmulator]:
    emulator = Mdt693bEmulator(folder / "amplifier", Mdt693bKnobs(**{**EXACT, **knobs}))
    emulator.plug()
    stop = threading.Event()
    serving = threading.Thread(target=serve, args=([emulator], stop))
    serving.start()
    try:
        yield emulator
    finally:
        stop.set()
        emulator.wake()
        serving.join()
        emulator.stop()


def controller(folder: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own source causes some warnings
        import mdt69x

        return mdt69x.Controller(str(folder / "amplifier"))


def everything(amplifier: Any, volts: Callable[[str], float]) -> None:
    """Set and read everything that works in the present mode."""
    assert amplifier.set_x_voltage(10) == 1
    assert volts("x") == pytest.approx(10, abs=2e-3)
    assert amplifier.set_all_voltage(5) == 1
    assert [volts(axis) for axis in "xyz"] == pytest.approx([5, 5, 5], abs=2e-3)
    assert amplifier.set_xyz_voltage(1, 2, 3) == 1
    assert amplifier.get_xyz_voltage() == pytest.approx([1, 2, 3], abs=6e-3)
    assert amplifier.set_x_voltage(500) == -1
    assert volts("x") == pytest.approx(1, abs=2e-3)
    assert (amplifier.get_x_voltage_min(), amplifier.get_x_voltage_max()) == (0.0, 150.5)
    assert amplifier.get_switch_limit() == 150.0
    assert amplifier.get_echo_status() == 0
    numbers = ("intensity", "rotary_mode", "push_mode", "master_scan_state")
    assert [getattr(amplifier, f"get_{name}")() for name in numbers] == [15, 0, 0, 0]
    assert amplifier.get_serial_number() == "15022617540"  # it cuts off the last digit
    assert amplifier.get_name().strip() == "MDT693B"
    with contextlib.redirect_stdout(io.StringIO()) as said:
        amplifier.get_id()
    assert "Firmware Version: 1.10" in said.getvalue()


def test_in_the_modern_dialect_everything_works(tmp_path: Path) -> None:
    with unit(tmp_path, **AS_IT_EXPECTS) as emulator:
        amplifier = controller(tmp_path)
        assert amplifier.get_compatibility() == 1  # it opens every unit in this mode
        everything(amplifier, emulator.output_v)
        assert amplifier.set_compatibility_off() == 1
        assert amplifier.get_compatibility() == 0
        everything(amplifier, emulator.output_v)
        assert amplifier.get_x_voltage() == pytest.approx(1, abs=6e-3)
        amplifier.close()


def test_the_emulated_unit_as_it_is_takes_its_sets(tmp_path: Path) -> None:
    with unit(tmp_path, echo=False) as emulator:
        amplifier = controller(tmp_path)
        amplifier.set_compatibility_off()
        assert amplifier.set_x_voltage(12.5) == 1
        assert emulator.output_v("x") == pytest.approx(12.5, abs=2e-3)
        assert amplifier.get_x_voltage() == pytest.approx(12.5, abs=6e-3)
        with pytest.raises(ValueError, match="invalid literal"):
            amplifier.get_intensity()  # because of the brackets
        amplifier.close()


@pytest.mark.parametrize("dialect", ["1.09", "1.10"])
def test_a_unit_with_echo_is_none_to_it(tmp_path: Path, dialect: str) -> None:
    with unit(tmp_path, dialect=dialect), pytest.raises(OSError, match="isn't correct"):
        controller(tmp_path)


def test_in_the_legacy_dialect_it_can_set_and_not_read(tmp_path: Path) -> None:
    """It reads up to the first asterisk, and there every reply begins with one."""
    with unit(tmp_path, dialect="1.05", echo=False) as emulator:
        amplifier = controller(tmp_path)
        assert amplifier.set_x_voltage(10) == 1
        assert emulator.output_v("x") == pytest.approx(10, abs=2e-3)
        with pytest.raises(Exception, match="Could convert"):
            amplifier.get_x_voltage_max()
        amplifier.close()
