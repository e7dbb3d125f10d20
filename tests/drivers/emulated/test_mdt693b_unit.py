"""The emulated MDT693B itself, with an injected clock: every command, timing, faults, outputs."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bFaults, Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_unit import Mdt693bUnit

FRAGMENTS = [b"xvoltage=", b"allvoltage=", b"1e9", b"-5", b"99.5", b"\r", b"\n", b"xmin=", b"xmax="]
FRAGMENTS += [
    b"msenable=1",
    b"msvoltage=90",
    b"cm=1",
    b"XV70",
    b"XH10",
    b"restore",
    b"echo=1",
    b"E",
]
FRAGMENTS += [b"xyzvoltage=1,2,", b"friendly=", b"=", b"?", b"sysmax=3"]
EXACT = {"readback_noise_v": 0.0, "adc_step_v": 0.0, "readback_offset_v": 0.0, "echo": False}


class Bench:
    """A unit, its clock, and a record of its output changes."""

    def __init__(self, **knobs) -> None:
        self.now = 100.0
        self.moves: list[tuple[str, float, float]] = []
        settings = EXACT | {"latency_s": 0.0, "jitter_s": 0.0} | knobs
        self.unit = Mdt693bUnit(
            Mdt693bKnobs(**settings), lambda *move: self.moves.append(move), lambda: self.now
        )
        self.moves.clear()

    def ask(self, text: str) -> bytes:
        self.unit.feed(text.encode() + b"\r")
        return self.out()

    def out(self) -> bytes:
        got = b""
        while chunk := self.unit.take():
            got += chunk
        return got


MODERN_ANSWERS = [
    ("friendly?", b"MDT693B\r>"),
    ("ECHO?", b"[Echo Off]\r>"),
    ("Vlimit?", b"[ 150]\r>"),
    ("intensity?", b"[15]\r>"),
    ("sysmin?", b"0\r>"),
    ("sysmax?", b"150.50\r>"),
    ("msenable?", b"[0]\r>"),
    ("msvoltage?", b"[  0.00]\r>"),
    ("dacstep?", b"[1]\r>"),
    ("cm?", b"[MDT693A Compatibility Mode Off]\r>"),
    ("rotarymode?", b"[0]\r>"),
    ("pushdisable?", b"[0]\r>"),
    ("zmax?", b"150.50\r>"),
    ("allvoltage?", b"CMD_NOT_DEFINED>"),
    ("cdac?", b"CMD_NOT_DEFINED>"),
    ("mscontrol?", b"CMD_NOT_DEFINED>"),
    ("disable?", b"CMD_NOT_DEFINED>"),
    ("xr?", b"CMD_NOT_DEFINED>"),
    ("wvoltage?", b"CMD_NOT_DEFINED>"),
    ("xvoltage", b"CMD_NOT_DEFINED>"),
    ("xvoltage=", b"CMD_ARG_INVALID>"),
    ("xvoltage=nan", b"CMD_ARG_INVALID>"),
    ("xvoltage=-1", b"CMD_ARG_INVALID>"),
    ("xvoltage=1e2", b"CMD_ARG_INVALID>"),
    ("xyzvoltage=1,2", b"CMD_ARG_INVALID>"),
    ("intensity=16", b"CMD_ARG_INVALID>"),
]


@pytest.mark.parametrize(("command", "reply"), MODERN_ANSWERS)
def test_answers(command, reply):
    assert Bench().ask(command) == reply


@pytest.mark.parametrize(
    ("setter", "query", "shows"),
    [
        ("friendly=Bench 3", "friendly?", b"Bench 3\r>"),
        ("intensity=7", "intensity?", b"[7]\r>"),
        ("xmin=5", "xmin?", b"5.00\r>"),
        ("ymax=75.25", "ymax?", b"75.25\r>"),
        ("sysmax=60", "sysmax?", b"60.00\r>"),
        ("msenable=1", "msenable?", b"[1]\r>"),
        ("msvoltage=3.5", "msvoltage?", b"[  3.50]\r>"),
        ("dacstep=20", "dacstep?", b"[20]\r>"),
        ("cm=1", "cm?", b"[MDT693A Compatibility Mode On]\r>"),
        ("rotarymode=1", "rotarymode?", b"[1]\r>"),
        ("pushdisable=1", "pushdisable?", b"[1]\r>"),
    ],
)
def test_setters_are_acknowledged_and_remembered(setter, query, shows):
    bench = Bench()
    assert bench.ask(setter) == b">"
    assert bench.ask(query) == shows


def test_sets_move_the_outputs_on_the_dac_grid():
    bench = Bench()
    assert bench.ask("xvoltage=12.345") == b">"
    ((axis, volts, at_s),) = bench.moves
    assert (axis, at_s) == ("x", 100.0)
    assert volts == pytest.approx(12.345, abs=2.75e-3 / 2)
    assert volts / 2.75e-3 == pytest.approx(round(volts / 2.75e-3), abs=1e-9)
    bench.ask("allvoltage=3")
    bench.ask("xyzvoltage=10,20,30")
    assert [round(bench.unit.output_v(a)) for a in "xyz"] == [10, 20, 30]


def test_a_refused_vector_moves_no_axis():
    bench = Bench()
    assert bench.ask("xyzvoltage=10,20,151") == b"CMD_ARG_INVALID>"
    assert not bench.moves


def test_master_scan_adds_to_all_axes_and_disables_ext():
    bench = Bench(dac_step_v=0.0)
    bench.ask("xvoltage=10")
    bench.unit.set_ext("x", 2.0)
    assert bench.unit.output_v("x") == pytest.approx(10 + 15 * 2.0)
    bench.ask("msvoltage=5")
    bench.ask("msenable=1")
    assert [bench.unit.output_v(a) for a in "xyz"] == pytest.approx([15, 5, 5])


@pytest.mark.parametrize(("limit_v", "gain"), [(75, 7.5), (100, 10.0), (150, 15.0)])
def test_ext_gain_follows_the_limit_switch_and_clips_there(limit_v, gain):
    bench = Bench(limit_v=limit_v)
    bench.unit.set_ext("x", 1.0)
    assert bench.unit.output_v("x") == pytest.approx(gain)
    bench.ask("xvoltage=50")
    bench.unit.set_ext("x", 10.0)
    assert bench.unit.output_v("x") == limit_v


def test_restore_zeroes_the_outputs_and_switches_the_echo_on():
    bench = Bench(start_v=40.0)
    bench.ask("restore")
    assert [bench.unit.output_v(a) for a in "xyz"] == [0.0, 0.0, 0.0]
    assert bench.ask("xmin?").startswith(b"xmin?\r")


def test_the_readback_lags_and_is_offset():
    bench = Bench(readback_offset_v=0.2, readback_lag_s=0.1, dac_step_v=0.0)
    bench.ask("xvoltage=100")
    bench.now += 0.1
    expected = 100 * (1 - math.exp(-1)) + 0.2
    assert float(bench.ask("xvoltage?").strip(b"[]\r> ")) == pytest.approx(expected, abs=0.006)
    bench.now += 2.0
    assert bench.ask("xvoltage?") == b"[100.20]\r>"


def test_latency_rate_limit_and_order():
    bench = Bench(latency_s=0.003, min_period_s=0.010)
    bench.unit.feed(b"xvoltage=1\rxvoltage=2\r")
    assert bench.out() == b""
    assert bench.unit.next_due_s() == pytest.approx(100.003)
    bench.now = 100.0031
    assert bench.out() == b">"
    assert bench.unit.next_due_s() == pytest.approx(100.013)
    bench.now = 101.0
    assert bench.out() == b">"
    assert [round(at_s, 6) for _, _, at_s in bench.moves] == [100.003, 100.013]


def test_replies_come_in_chunks():
    bench = Bench(chunk_size=3, chunk_gap_s=0.001)
    bench.unit.feed(b"xmax?\r")
    pieces = []
    for _ in range(10):
        while piece := bench.unit.take():
            pieces.append(piece)
        bench.now += 0.001
    assert pieces == [b"150", b".50", b"\r>"]


def test_line_ends_of_every_kind():
    for ending in (b"\r", b"\n", b"\r\n", b"\n\r"):
        bench = Bench()
        bench.unit.feed(b"xmin?" + ending + b"xmin?" + ending)
        assert bench.out() == b"0\r>0\r>", ending
    bench = Bench()
    bench.unit.feed(b"\r\r")
    assert bench.out() == b"CMD_NOT_DEFINED>CMD_NOT_DEFINED>"


def test_legacy_has_no_vector_command_and_one_axis_units_have_one_axis():
    assert Bench(dialect="1.05").ask("xyzvoltage?") == b"!"
    single = Bench(axes="x")
    assert single.ask("yvoltage?") == b"CMD_NOT_DEFINED>"
    assert b"MDT694B" in single.ask("id?")


def test_compatibility_mode_takes_the_old_commands():
    for dialect, ok in (("1.05", b"*"), ("1.10", b">")):
        bench = Bench(dialect=dialect, compatibility=True)
        assert bench.ask("XV10.0") == ok
        assert bench.unit.output_v("x") == pytest.approx(10.0, abs=2e-3)
        assert b"150" in bench.ask("XH?")
        assert b"150" in bench.ask("%")
        assert bench.ask("YV20") == ok
        assert bench.ask("E") == ok
        assert bench.unit.registers.echo
        assert bench.ask("E") == b"E\r" + ok


def test_faults():
    bench = Bench()
    unit = bench.unit
    unit.faults = Mdt693bFaults(mute=True)
    assert bench.ask("xvoltage=5") == b""
    assert unit.output_v("x") == pytest.approx(5.0, abs=2e-3)
    unit.faults = Mdt693bFaults(lose_sets=True)
    assert bench.ask("xvoltage=9") == b">"
    assert unit.output_v("x") == pytest.approx(5.0, abs=2e-3)
    unit.faults = Mdt693bFaults(half=True, count=1)
    assert bench.ask("xmax?") == b"150.50\r>"[:4]
    unit.faults = Mdt693bFaults(before_reply=b"\0", after_reply=b"\n>", count=1)
    assert bench.ask("xmin?") == b"\x000\r>\n>"
    assert bench.ask("xmin?") == b"0\r>"
    unit.faults = Mdt693bFaults(hang=True)
    assert bench.ask("xvoltage=7") == b""
    unit.faults = Mdt693bFaults()
    bench.now += 10.0
    assert bench.out() == b""
    assert unit.output_v("x") == pytest.approx(5.0, abs=2e-3)


@given(st.lists(st.one_of(st.binary(max_size=20), st.sampled_from(FRAGMENTS)), max_size=30))
def test_no_input_crashes_it_or_drives_it_out_of_range(pieces):
    bench = Bench(limit_v=100)
    for piece in pieces:
        bench.unit.feed(piece)
        bench.out()
    assert all(0.0 <= volts <= 100.0 for _, volts, _ in bench.moves)
    bench.unit.feed(b"\r")
    bench.out()
    bench.unit.registers.echo = bench.unit.registers.compatibility = False
    assert bench.ask("vlimit?") == b"[ 100]\r>"


def test_an_unplug_loses_the_half_command_and_keeps_the_output():
    bench = Bench(start_v=30.0)
    bench.unit.feed(b"xvolt")
    bench.unit.link_lost()
    assert bench.ask("xmin?") == b"0\r>"
    assert bench.unit.output_v("x") == pytest.approx(30.0, abs=2e-3)
