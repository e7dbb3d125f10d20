"""The MDT693B driver through real pyserial on a real pty, with the emulated unit."""

import math
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest

from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverConfigError,
    OutOfRange,
    ProtocolError,
)
from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.mdt693b.codec import Dialect
from dehyst.drivers.mdt693b.settings import Mdt693bConfig, Mdt694bConfig, find_port
from dehyst.drivers.serial_port import PortInfo
from dehyst.drivers.settings import read_settings

FAST = {"latency_s": 0.0, "jitter_s": 0.0, "readback_lag_s": 0.0, "start_v": 20.0}
BOTH = pytest.mark.parametrize("dialect", ["1.05", "1.10"])


@pytest.fixture
def bench(tmp_path):
    """Make pairs of an emulator and an open driver; end them with the test."""

    @contextmanager
    def make(settings=None, **knobs):
        with Mdt693bEmulator(tmp_path / "port", Mdt693bKnobs(**FAST | knobs)) as emulator:
            table = {"port": emulator.port, "idle_s": 0.02, "timeout_s": 5.0}
            config = read_settings(Mdt693bConfig, table | (settings or {}))
            driver = Mdt693b(config, sleep=lambda seconds: None)  # the readback has no lag
            driver.open()
            try:
                yield emulator, driver
            finally:
                driver.close()

    return make


@contextmanager
def impatient(driver, errors=DeviceTimeout, match=None):
    """Expect an error from a missing reply, without the long time-out for a busy machine."""
    link = driver._link
    link.timeout_s, patience_s = 0.06, link.timeout_s
    with pytest.raises(errors, match=match):
        yield
    link.timeout_s = patience_s


@pytest.mark.parametrize(
    ("dialect", "mode"),
    [
        *((dialect, "native") for dialect in ("1.05", "1.06", "1.09", "1.10")),
        *((dialect, "compatible") for dialect in ("1.05", "1.10")),
        *((dialect, "compatible only") for dialect in ("1.05", "1.10")),
    ],
)
@pytest.mark.parametrize("echo", [True, False])
def test_every_firmware_echo_and_mode(bench, dialect, echo, mode):
    modes = {"compatibility": mode != "native", "compatibility_only": mode == "compatible only"}
    with bench(dialect=dialect, echo=echo, **modes) as (emulator, driver):
        assert driver.dialect is (Dialect.LEGACY if dialect < "1.09" else Dialect.MODERN)
        assert emulator.output_v() == pytest.approx(20.0, abs=2e-3), "open() moved the output"
        assert driver.output() == pytest.approx(20.0, abs=0.35)
        assert (driver.spec.minimum, driver.spec.maximum) == (0.0, 150.0)
        assert not emulator.unit.registers.echo
        for volts in (21.5, 22.123, 20.0):
            driver.write(volts)
            assert driver.output() == volts
            assert emulator.output_v() == pytest.approx(volts, abs=2e-3)
        assert driver.readback() == pytest.approx(20.2, abs=0.1)
        if mode != "compatible only":
            assert f"firmware {dialect}" in driver.spec.identity


@BOTH
@pytest.mark.parametrize("chunk_size", [1, 2])
def test_replies_in_pieces(bench, dialect, chunk_size):
    with bench({"idle_s": 0.3}, dialect=dialect, chunk_size=chunk_size, chunk_gap_s=3e-4) as (
        emulator,
        driver,
    ):
        driver.write(33.0)
        assert emulator.output_v() == pytest.approx(33.0, abs=2e-3)
        assert driver.readback() == pytest.approx(33.2, abs=0.1)
        assert driver.stray_bytes == 0


def test_the_axis_is_the_one_of_the_settings(bench):
    with bench({"axis": "z"}) as (emulator, driver):
        driver.write(42.0)
        assert [round(emulator.output_v(a)) for a in "xyz"] == [20, 20, 42]


def test_a_one_axis_unit_has_no_z(bench):
    with pytest.raises(DriverConfigError, match="no axis 'z'"), bench({"axis": "z"}, axes="x"):
        pass


@pytest.mark.parametrize("limit_v", [75, 100, 150])
def test_the_limit_switch_is_held_to(bench, limit_v):
    with bench(limit_v=limit_v) as (emulator, driver):
        assert driver.spec.maximum == limit_v
        driver.write(limit_v)
        before = emulator.unit.commands_done
        for volts in (limit_v + 0.001, -0.001, math.nan, math.inf, -math.inf):
            with pytest.raises(OutOfRange):
                driver.write(volts)
        assert emulator.unit.commands_done == before
        assert driver.output() == limit_v


def test_our_own_limit_is_held_to_and_never_rounded_over(bench):
    with bench({"max_v": 59.9996}) as (_, driver):
        driver.write(59.9996)
        assert driver.output() == 59.999
        with pytest.raises(OutOfRange):
            driver.write(60.0)


@pytest.mark.parametrize(
    ("limit_v", "max_v", "highest_v"),
    [(75, 150.0, 75.0), (100, 100.5, 100.0), (100, 99.0, 99.0), (150, 150.4, 150.0)],
)
def test_our_own_limit_above_the_limit_switch_does_not_lift_it(bench, limit_v, max_v, highest_v):
    with bench({"max_v": max_v}, limit_v=limit_v) as (emulator, driver):
        assert driver.spec.maximum == highest_v
        driver.write(highest_v)
        before = emulator.unit.commands_done
        with pytest.raises(OutOfRange):
            driver.write(highest_v + 0.01)
        assert emulator.unit.commands_done == before
        assert driver.output() == highest_v


def test_our_own_limit_above_the_axis_maximum_does_not_lift_it(bench):
    with bench() as (emulator, driver):
        driver.close()
        emulator.call(lambda: emulator.unit.registers.max_v.update(x=60.0))
        ours = Mdt693b(Mdt693bConfig(port=emulator.port, max_v=140.0), sleep=lambda seconds: None)
        ours.open()
        assert ours.spec.maximum == 60.0
        ours.close()


def test_limits_set_on_the_unit_are_held_to(bench):
    with bench() as (emulator, driver):
        driver.close()
        emulator.call(lambda: emulator.unit.registers.min_v.update(x=10.0))
        emulator.call(lambda: emulator.unit.registers.max_v.update(x=80.0))
        driver.open()
        assert (driver.spec.minimum, driver.spec.maximum) == (10.0, 80.0)


def test_a_minimum_between_two_millivolts_is_never_rounded_under(bench):
    with bench() as (emulator, driver):
        driver.spec = replace(driver.spec, minimum=10.0004)
        driver.write(10.0004)
        assert driver.output() == 10.001
        with pytest.raises(OutOfRange):
            driver.write(10.0)
        assert round(emulator.output_v("x"), 1) == 10.0


def test_half_a_command_left_in_the_unit_is_not_carried_out_by_open(bench):
    with bench() as (emulator, driver):
        driver.write(35.0)
        driver.close()
        emulator.call(lambda: emulator.unit.feed(b"xvoltage=1"))
        driver.open()
        assert emulator.output_v() == pytest.approx(35.0, abs=2e-3)


def test_a_lagging_readback_is_waited_for(tmp_path):
    knobs = Mdt693bKnobs(**FAST | {"readback_lag_s": 0.1})
    with Mdt693bEmulator(tmp_path / "port", knobs) as emulator:
        driver = Mdt693b.from_settings({"port": emulator.port, "timeout_s": 1.0})
        driver.open()
        driver.write(90.0)
        driver.close()
        driver.open()
        assert driver.output() == pytest.approx(90.2, abs=0.2)
        driver.close()


def test_the_known_set_point_can_be_given(bench):
    with bench({"initial_v": 20.0}) as (_, driver):
        assert driver.output() == 20.0
    with pytest.raises(DriverConfigError, match="reads back"), bench({"initial_v": 60.0}):
        pass


TRUE_READBACK = {"readback_offset_v": 0.0, "readback_noise_v": 0.0, "adc_step_v": 0.0}
"""The readback shows the output, 20 V, to the two decimals of the display."""


@pytest.mark.parametrize(
    ("given_v", "believed"), [(21.9, True), (18.1, True), (22.1, False), (17.9, False)]
)
def test_a_given_set_point_is_believed_within_2_volts_of_the_readback(bench, given_v, believed):
    if believed:
        with bench({"initial_v": given_v}, **TRUE_READBACK) as (_, driver):
            assert driver.output() == given_v
        return
    refused = pytest.raises(DriverConfigError, match="reads back 20 V")
    with refused, bench({"initial_v": given_v}, **TRUE_READBACK):
        pass


def test_an_output_beyond_our_limit_by_more_than_2_volts_is_not_taken_over(bench):
    with bench({"max_v": 18.1}, **TRUE_READBACK) as (emulator, driver):
        assert driver.output() == 18.1
        assert emulator.output_v() == pytest.approx(20.0, abs=2e-3), "open() moved the output"
    refused = pytest.raises(DriverConfigError, match="output is at 20 V, outside")
    with refused, bench({"max_v": 17.9}, **TRUE_READBACK):
        pass


@pytest.mark.parametrize(("turned_v", "shown_v"), [(1.9, 20.0), (2.1, 22.1), (-2.1, 17.9)])
def test_a_knob_turned_by_more_than_2_volts_meanwhile_is_noticed(bench, turned_v, shown_v):
    with bench(**TRUE_READBACK) as (emulator, driver):
        driver.write(20.0)
        emulator.call(lambda: emulator.unit.registers.set_v.update(x=20.0 + turned_v))
        driver.reconnect()
        assert driver.output() == pytest.approx(shown_v, abs=0.005)


def test_master_scan_is_refused(bench):
    with bench() as (emulator, driver):
        driver.close()
        emulator.call(lambda: setattr(emulator.unit.registers, "scan_on", True))
        driver.open()
        driver.close()
        emulator.call(lambda: setattr(emulator.unit.registers, "scan_v", 5.0))
        with pytest.raises(DriverConfigError, match="master scan"):
            driver.open()


def test_rate_is_measured_or_declared(bench):
    with bench(latency_s=0.005) as (_, driver):
        assert 0.0 < driver.spec.max_rate_hz <= 200.0
        assert driver.spec.latency_s >= 0.005
        for _ in range(256):
            driver.write(20.0)
        assert driver.timing.count == 256
        assert driver.spec.latency_s == driver.timing.percentile_s(50.0)
    with bench({"rate_hz": 123.0}) as (_, driver):
        assert driver.spec.max_rate_hz == 123.0


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"prot": "/dev/x"}, "'prot'.*port, .*axis"),
        ({"axis": "w"}, "axis"),
        ({"port": 3}, "port = 3"),
        ({"timeout_s": "fast"}, "timeout_s"),
        ({"timeout_s": 0.0}, "timeout_s"),
        ({"baud": 9600.5}, "baud"),
        ({"idle_s": 1.0}, "idle_s"),
        ({"max_v": math.nan}, "max_v"),
        ({"initial_v": -1.0}, "initial_v"),
        ({"rate_hz": True}, "rate_hz"),
    ],
)
def test_wrong_settings_are_named(settings, text):
    with pytest.raises(DriverConfigError, match=text):
        Mdt693b.from_settings(settings)


def test_no_such_port_and_a_port_in_use(bench, tmp_path):
    with pytest.raises(DeviceNotFound, match="there is no port"):
        Mdt693b.from_settings({"port": str(tmp_path / "nothing")}).open()
    (tmp_path / "file").write_text("")
    with pytest.raises(DeviceNotFound, match="not a serial port"):
        Mdt693b.from_settings({"port": str(tmp_path / "file")}).open()
    with (
        bench() as (emulator, _),
        pytest.raises(DeviceNotFound, match="in use"),
    ):
        Mdt693b.from_settings({"port": emulator.port}).open()


def usb(path: str, serial_number: str, product: int = 0x1003) -> PortInfo:
    return PortInfo(path, 0x1313, product, serial_number, "MDT69xB")


@pytest.mark.parametrize(
    ("ports", "settings", "known", "expected"),
    [
        ([usb("/dev/a", "1")], {}, None, "/dev/a"),
        ([usb("/dev/a", "1", 0x1004)], {}, None, "/dev/a"),
        ([usb("/dev/a", "1"), usb("/dev/b", "2")], {"serial_number": "2"}, None, "/dev/b"),
        ([usb("/dev/a", "1"), usb("/dev/b", "2")], {}, "1", "/dev/a"),
        ([PortInfo("/dev/f", 0x0403, 0x6001, "", "FTDI")], {}, None, DeviceNotFound),
        ([], {}, None, DeviceNotFound),
        ([usb("/dev/a", ""), usb("/dev/b", "")], {}, None, DriverConfigError),
        ([usb("/dev/a", "1")], {"port": "/dev/ttyUSB7"}, None, "/dev/ttyUSB7"),
    ],
)
def test_auto_finds_the_unit_on_usb(monkeypatch, ports, settings, known, expected):
    monkeypatch.setattr("dehyst.drivers.serial_port.list_serial_ports", lambda: ports)
    config = read_settings(Mdt693bConfig, settings)
    if isinstance(expected, str):
        assert find_port(config, known) == expected
    else:
        with pytest.raises(expected, match="auto"):
            find_port(config, known)


def test_auto_finds_an_mdt694b_beside_an_mdt693b(monkeypatch):
    ports = [usb("/dev/a", "1"), usb("/dev/b", "2", 0x1004)]
    monkeypatch.setattr("dehyst.drivers.serial_port.list_serial_ports", lambda: ports)
    assert find_port(Mdt694bConfig()) == "/dev/b"
    ports.pop()
    with pytest.raises(DeviceNotFound, match="no MDT694B on USB"):
        find_port(Mdt694bConfig())


def test_wrong_serial_number_is_refused(bench):
    with pytest.raises(DeviceNotFound, match="serial number"), bench({"serial_number": "7"}):
        pass


@BOTH
def test_a_hang_is_reported_not_queued_and_survived(bench, dialect):
    with bench({"timeout_s": 2.0}, dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.fault(hang=True)
        for volts in (31.0, 32.0):
            with impatient(driver):
                driver.write(volts)
        assert driver.output() == 30.0
        emulator.clear_faults()
        assert emulator.output_v() == pytest.approx(30.0, abs=2e-3)
        driver.write(30.5)
        assert emulator.output_v() == pytest.approx(30.5, abs=2e-3)
        sets = emulator.unit.sets_done
        driver.write(30.6)
        assert emulator.unit.sets_done == sets + 1


@BOTH
def test_a_late_acknowledgement_is_not_given_to_the_next_set(bench, dialect):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.fault(count=1, delay_s=0.3)
        with impatient(driver, match="not repeated"):
            driver.write(31.0)
        assert driver.output() == 30.0
        time.sleep(0.3)
        # the unit acknowledges no further set: none may succeed on the late reply
        emulator.fault(lose_sets=True)
        driver.readback()
        assert driver.output() == 31.0, "the late acknowledgement tells that it was carried out"
        emulator.fault(mute=True, lose_sets=False)
        with impatient(driver):
            driver.write(32.0)


@BOTH
def test_a_mute_unit_is_never_acknowledged_and_readback_decides(bench, dialect):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.fault(mute=True)
        with impatient(driver):
            driver.write(40.0)
        assert driver.output() == 30.0
        emulator.clear_faults()
        driver.reconnect()
        assert driver.output() == 40.0, "the unit did carry it out"


@BOTH
@pytest.mark.parametrize("stale", [b"*", b">", b"!", b"CMD_NOT_DEFINED>"])
def test_stale_replies_bring_the_link_back_in_step(bench, dialect, stale):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.inject(stale)
        time.sleep(0.02)
        late_error = stale in ((b"!",) if dialect == "1.05" else (b"CMD_NOT_DEFINED>", b"!"))
        try:
            driver.write(31.0)
        except ProtocolError:
            assert late_error or stale == b"CMD_NOT_DEFINED>"
        emulator.fault(mute=True)
        with impatient(driver):
            driver.write(32.0)
        emulator.clear_faults()
        driver.write(33.0)
        assert driver.output() == 33.0
        assert emulator.output_v() == pytest.approx(33.0, abs=2e-3)
        assert driver.stray_bytes > 0


LATE_ERRORS = [("1.05", b"!"), ("1.10", b"CMD_NOT_DEFINED>"), ("1.10", b"CMD_ARG_INVALID>")]


@pytest.mark.parametrize(("dialect", "error"), LATE_ERRORS)
def test_a_refusal_after_the_acknowledgement_is_reported_and_nothing_is_written(
    bench, dialect, error
):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.inject(error)
        time.sleep(0.05)
        sets = emulator.unit.sets_done
        with pytest.raises(ProtocolError, match="refused a command after it had been acknowledged"):
            driver.write(31.0)
        assert emulator.unit.sets_done == sets
        assert driver.output() == 30.0
        driver.write(32.0)  # the error is reported once
        assert driver.output() == 32.0
        assert emulator.output_v() == pytest.approx(32.0, abs=2e-3)


@BOTH
def test_a_refusal_that_comes_after_the_time_out_leaves_the_last_set_point(bench, dialect):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.call(lambda: emulator.unit.registers.max_v.update(x=35.0))
        emulator.fault(count=1, delay_s=0.3)
        with impatient(driver, match="not repeated"):
            driver.write(40.0)
        time.sleep(0.3)
        driver.readback()
        assert driver.output() == 30.0, "the unit refused it: it was not carried out"
        driver.write(31.0)
        assert emulator.output_v() == pytest.approx(31.0, abs=2e-3)


@BOTH
@pytest.mark.parametrize("junk", [b"\0", b"\n", b"\0\0\r\n"])
def test_stray_nul_and_line_feeds_do_no_harm(bench, dialect, junk):
    with bench(dialect=dialect) as (emulator, driver):
        emulator.fault(count=20, before_reply=junk, after_reply=junk)
        for i in range(10):
            driver.write(30.0 + i)
        assert emulator.output_v() == pytest.approx(39.0, abs=2e-3)
        assert driver.readback() == pytest.approx(39.2, abs=0.1)
        assert driver.stray_bytes == 0


@BOTH
@pytest.mark.parametrize("fault", ["garbage", "half"])
def test_garbage_and_half_replies(bench, dialect, fault):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(30.0)
        emulator.fault(count=1, **{fault: True})
        with impatient(driver, (ProtocolError, DeviceTimeout)):
            driver.write(31.0)
        driver.write(32.0)
        assert driver.output() == 32.0
        assert emulator.output_v() == pytest.approx(32.0, abs=2e-3)
        emulator.fault(count=1, **{fault: True})
        with impatient(driver, (ProtocolError, DeviceTimeout)):
            driver.readback()
        assert driver.readback() == pytest.approx(32.2, abs=0.1)


def test_a_refused_set_is_reported_and_leaves_the_link_in_step(bench):
    for dialect, error in (("1.05", b"!"), ("1.10", b"CMD_ARG_INVALID"), ("1.10", b"!")):
        with bench(dialect=dialect, range_error=error) as (emulator, driver):
            driver.write(30.0)
            emulator.call(lambda unit=emulator.unit: unit.registers.max_v.update(x=35.0))
            with pytest.raises(ProtocolError, match="refused"):
                driver.write(40.0)
            assert driver.output() == 30.0
            driver.write(31.0)
            assert emulator.output_v() == pytest.approx(31.0, abs=2e-3)


def test_a_blocked_write_times_out_and_half_a_command_is_never_carried_out(bench):
    with bench({"write_timeout_s": 0.3}) as (emulator, driver):
        driver.write(30.0)
        emulator.stall_writes(True)
        with pytest.raises(DeviceTimeout, match="accepted no bytes"):
            driver.write(31.0)
        emulator.call(lambda: emulator.unit.feed(b"xvoltage=1"))  # what might have got through
        emulator.stall_writes(False)
        driver.write(30.5)
        assert emulator.output_v() == pytest.approx(30.5, abs=2e-3)
        assert emulator.unit.sets_done == 2


@BOTH
def test_unplug_and_back_does_not_move_the_output(bench, dialect):
    with bench(dialect=dialect) as (emulator, driver):
        driver.write(55.0)
        emulator.unplug()
        with pytest.raises(DeviceGone):
            driver.write(56.0)
        with pytest.raises(DeviceNotFound):
            driver.reconnect()
        with pytest.raises(DeviceGone):
            driver.write(56.0)
        emulator.plug()
        driver.reconnect()
        assert driver.output() == 55.0
        assert emulator.output_v() == pytest.approx(55.0, abs=2e-3)


@pytest.mark.parametrize(("first", "then"), [("1.05", "1.10"), ("1.10", "1.05")])
def test_the_dialect_may_change_while_unplugged(bench, first, then):
    with bench(dialect=first) as (emulator, driver):
        driver.write(55.0)
        emulator.unplug()
        emulator.replug(then)
        with pytest.raises(DeviceGone):
            driver.write(55.1)
        driver.reconnect()
        assert f"firmware {then}" in driver.spec.identity
        assert driver.output() == 55.0
        driver.write(56.0)
        assert emulator.output_v() == pytest.approx(56.0, abs=2e-3)


@pytest.mark.parametrize(("first", "then"), [("1.05", "1.10"), ("1.10", "1.05")])
def test_a_wrong_dialect_without_an_unplug_is_an_error_not_an_ack(bench, first, then):
    with bench(dialect=first) as (emulator, driver):
        driver.write(55.0)
        emulator.call(lambda: emulator.unit.set_dialect(then))
        with impatient(driver, (ProtocolError, DeviceTimeout)):
            driver.write(55.1)
        driver.reconnect()
        driver.write(56.0)
        assert emulator.output_v() == pytest.approx(56.0, abs=2e-3)


def test_another_unit_at_the_same_port_is_refused(bench):
    with bench() as (emulator, driver):
        driver.write(55.0)
        emulator.unplug()
        emulator.call(lambda: setattr(emulator.unit.registers, "serial_number", "999"))
        emulator.plug()
        with pytest.raises(DeviceNotFound, match="another unit"):
            driver.reconnect()
        with pytest.raises(DeviceGone):
            driver.write(55.0)


def test_a_unit_that_was_switched_off_is_taken_where_it_stands(bench):
    with bench() as (emulator, driver):
        driver.write(55.0)
        emulator.unplug()
        emulator.call(lambda: emulator.unit.registers.set_v.update(x=5.0))
        emulator.call(lambda: emulator.unit.set_ext("x", 0.0))
        emulator.plug()
        driver.reconnect()
        assert driver.output() == pytest.approx(5.0, abs=0.3)


def test_a_readback_that_disagrees_is_reported_by_readback_alone(bench):
    with bench() as (emulator, driver):
        emulator.fault(lose_sets=True)
        driver.write(60.0)
        assert driver.output() == 60.0
        assert driver.readback() == pytest.approx(20.2, abs=0.1)
        emulator.fault(lose_sets=False, readback_error_v=9.0)
        assert driver.readback() == pytest.approx(29.2, abs=0.1)


def test_a_silent_port_and_a_babbling_one_are_reported(bench):
    for fault, text in ((b"", "no answer"), (b"login: ", "not a reply of an MDT693B")):
        with bench({"timeout_s": 0.5}) as (emulator, driver):
            driver.close()
            emulator.fault(mute=True)
            if fault:
                emulator.fault(mute=False, garbage=True, count=99)
            with pytest.raises((DeviceTimeout, ProtocolError), match=text):
                driver.open()
