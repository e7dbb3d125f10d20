"""Waves and grammar of the General Command Set, against closed forms and for any splitting of the
bytes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.gcs.grammar import LONGEST, GcsCode, GcsCommand, GcsError, Splitter, join_lines
from dehyst.daemon.gcs.waves import MOST_POINTS, Waves, segment


def words(text: str) -> list[str]:
    return text.split()


def test_a_sine_is_the_inverted_cosine_of_the_manual() -> None:
    wave = segment("SIN_P", words("120 8 1 100 10 50"))
    n = np.arange(100)
    assert wave.size == 120
    assert np.allclose(wave[10:110], 1 + 4 * (1 - np.cos(2 * np.pi * n / 100)))
    assert np.all(wave[:10] == 1.0)
    assert np.all(wave[110:] == 1.0)


@given(
    flank=st.integers(2, 200),
    speed_up=st.integers(0, 60),
    amplitude=st.floats(-20, 20),
    offset=st.floats(-20, 20),
)
def test_a_scan_line_runs_from_its_offset_to_its_amplitude_without_a_jump(
    flank: int, speed_up: int, amplitude: float, offset: float
) -> None:
    speed_up = min(speed_up, flank // 2)
    line = segment(
        "LIN", [str(flank + 3), repr(amplitude), repr(offset), str(flank), "0", str(speed_up)]
    )
    steps = np.diff(line)
    assert line[0] == pytest.approx(offset)
    assert line[-1] == pytest.approx(offset + amplitude)
    assert np.all(steps * np.sign(amplitude) >= -1e-9)
    assert np.abs(steps).max() <= abs(amplitude) / (flank - speed_up) * 1.0001 + 1e-9
    if speed_up > 1:
        assert abs(steps[0]) <= 0.51 * np.abs(steps).max() + 1e-9


def test_a_ramp_goes_up_and_comes_back_the_same_way() -> None:
    ramp = segment("RAMP", words("200 6 2 200 0 10 100"))
    assert ramp[0] == 2.0
    assert ramp[100] == pytest.approx(8.0)
    assert np.allclose(ramp[101:], ramp[1:100][::-1])


@pytest.mark.parametrize(
    ("kind", "args", "code"),
    [
        ("SQUARE", "1", GcsCode.PARAM_SYNTAX),
        ("PNT", "1 3 1 2", GcsCode.PARAM_COUNT),
        ("PNT", "1 2 1 nan", GcsCode.INVALID_NUMBER),
        ("PNT", "1 2 1 x", GcsCode.INVALID_NUMBER),
        ("SIN_P", "100 8 1 120 0 50", GcsCode.PARAM_OUT_OF_RANGE),
        ("SIN_P", "100 8 1 100 0", GcsCode.PARAM_COUNT),
        ("RAMP", "100 8 1 100 0 30 50", GcsCode.PARAM_OUT_OF_RANGE),
        ("LIN", f"{MOST_POINTS + 1} 8 1 100 0 0", GcsCode.PARAM_OUT_OF_RANGE),
    ],
)
def test_a_wave_that_cannot_be_is_refused_with_the_standards_code(
    kind: str, args: str, code: GcsCode
) -> None:
    with pytest.raises(GcsError) as error:
        segment(kind, words(args))
    assert error.value.code == code


def test_tables_are_replaced_appended_and_added() -> None:
    waves = Waves(("X", "Y"))
    waves.write(1, "X", np.array([1.0, 2.0]))
    waves.write(1, "&", np.array([3.0]))
    waves.write(1, "+", np.array([1.0, 1.0, 1.0, 1.0]))
    assert waves.tables[1].tolist() == [2.0, 3.0, 4.0, 1.0]
    waves.write(2, "X", np.array([0.0, 5.0]))
    waves.chosen.update(X=1, Y=2)
    waves.offset["Y"], waves.rate = 10.0, 3
    t_s, targets, cycles = waves.play_of(["X", "Y"], 0.001)
    assert cycles == 0
    assert np.allclose(t_s, [0.0, 0.003, 0.006, 0.009])
    assert targets["Y"].tolist() == [10.0, 15.0, 10.0, 15.0]
    waves.cycles.update(X=2, Y=2)
    with pytest.raises(GcsError, match="one length"):
        waves.play_of(["X", "Y"], 0.001)
    with pytest.raises(GcsError, match="no wave table"):
        Waves(("X",)).play_of(["X"], 0.001)


@given(st.data())
def test_commands_are_the_same_however_the_bytes_arrive(data: st.DataObject) -> None:
    text = b"MOV X 1.5 y 2\n\x05pos? X\r\n\x18\n  ERR?  \n"
    cuts = sorted(data.draw(st.lists(st.integers(0, len(text)), max_size=8)))
    splitter, found = Splitter(), []
    for start, end in zip([0, *cuts], [*cuts, len(text)], strict=True):
        found += splitter.feed(text[start:end])
    assert found == [
        GcsCommand("MOV", ("X", "1.5", "y", "2")),
        GcsCommand("#5"),
        GcsCommand("POS?", ("X",)),
        GcsCommand("#24"),
        GcsCommand("ERR?"),
    ]


def test_a_line_without_an_end_is_bounded_and_the_next_one_is_understood() -> None:
    splitter = Splitter()
    assert list(splitter.feed(b"A" * (3 * LONGEST))) == []
    assert list(splitter.feed(b"\nERR?\n")) == [GcsCommand(""), GcsCommand("ERR?")]


@given(st.binary(max_size=400))
def test_no_bytes_break_the_splitter(data: bytes) -> None:
    for command in Splitter().feed(data):
        assert command.word == command.word.upper()


def test_lines_of_an_answer_have_a_blank_before_each_end_but_the_last() -> None:
    assert join_lines(["X=1", "Y=2"]) == "X=1 \nY=2\n"
