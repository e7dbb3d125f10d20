"""Recordings as MCAP are read back bit by bit, by this project's reader and by the format's own."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader
from mcap.writer import Writer

from dehyst.daemon.files.recordings import read_columns, read_recording, write_recording
from dehyst.daemon.main import main
from dehyst.models.errors import BadRecording

FINITE = st.floats(-1e9, 1e9, allow_nan=False, width=64)


def stage(rows: int = 200) -> dict[str, np.ndarray]:
    t_s = 0.001 * np.arange(rows) + 1e-4 * np.sin(np.arange(rows))
    y = np.sqrt(2.0) * np.cos(t_s)
    y[3] = np.nan
    return {"t_s": t_s, "u_v": np.sin(t_s), "y_um": y, "temp_c": 20.0 + t_s}


@settings(max_examples=30, deadline=None)
@given(values=hnp.arrays(np.float64, st.integers(2, 30), elements=FINITE), gap=st.integers(0, 1))
def test_what_is_written_is_read_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, values: np.ndarray, gap: int
) -> None:
    path = tmp_path_factory.mktemp("mcap") / "a.mcap"
    values[gap] = np.nan
    t_s = np.cumsum(np.full(values.size, 1.0 / 3.0))
    write_recording(path, t_s, {"u_v": t_s, "y_um": values}, {"stage": "a"})
    read = read_recording(path)
    assert np.array_equal(read.t_s, t_s)
    assert read.displacement is not None
    assert np.array_equal(read.displacement, values, equal_nan=True)
    assert read.metadata == {"stage": "a"}


def test_the_formats_own_reader_sees_rows_with_their_times_and_a_schema(tmp_path: Path) -> None:
    columns = stage()
    t_s = columns.pop("t_s")
    path = tmp_path / "a.mcap"
    write_recording(path, t_s, columns, {"started": "2026-01-02T03:04:05+00:00"})
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        rows = [(schema, m.log_time, json.loads(m.data)) for schema, _, m in reader.iter_messages()]
    schema, first_ns, first = rows[0]
    assert schema is not None
    assert schema.encoding == "jsonschema"
    assert list(json.loads(schema.data)["properties"]) == ["t_s", "u_v", "y_um", "temp_c"]
    assert first_ns == 1767323045 * 10**9  # 2026-01-02 03:04:05 UTC
    assert first == {"t_s": 0.0, "u_v": 0.0, "y_um": np.sqrt(2.0), "temp_c": 20.0}
    assert [round(row["t_s"] * 1e9) for _, _, row in rows] == [ns - first_ns for _, ns, _ in rows]
    assert "y_um" not in rows[3][2]  # missing
    kinds = json.loads(schema.data)["properties"].values()
    assert {kind["type"] for kind in kinds} == {"number"}  # the only type Foxglove accepts


def test_a_damaged_file_is_refused_in_one_line(tmp_path: Path) -> None:
    columns = stage()
    t_s = columns.pop("t_s")
    path, bad = tmp_path / "a.mcap", tmp_path / "bad.mcap"
    write_recording(path, t_s, columns)
    whole, rng = path.read_bytes(), np.random.default_rng(3)
    cases = [b"", b"no such thing", whole[: len(whole) // 2], whole[:-9]]
    for place in rng.integers(200, len(whole) - 400, 60):
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        cases.append(bytes(damaged))
    said = []
    for case in cases:
        bad.write_bytes(case)
        try:
            read = read_recording(bad)
        except BadRecording as error:
            said.append(str(error))
        else:  # damage where no number is stored
            assert np.array_equal(read.t_s, t_s)
            assert np.array_equal(read.drive, columns["u_v"])
    assert len(said) > 30
    assert all("bad.mcap" in words and "\n" not in words for words in said)


@pytest.mark.parametrize(
    ("topics", "encoding", "data", "says"),
    [
        (("/a", "/b"), "json", b'{"t_s": 0, "u_v": 1}', "several topics ('/a', '/b')"),
        (("/a",), "cdr", b"\0\0", "encoded as 'cdr'"),
        (("/a",), "json", b"[1, 2]", "message 0 is not a row"),
        (("/a",), "json", b'{"t_s": 0, "u_v": "high"}', "u_v is not a number"),
        (("/a",), "json", b'{"t_s": 0, "u_v": ', "can be read"),
    ],
)
def test_what_is_no_recording_is_refused(
    tmp_path: Path, topics: tuple[str, ...], encoding: str, data: bytes, says: str
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic in topics:
            writer.add_message(writer.register_channel(topic, encoding, 0), 1, data, 1)
        writer.finish()
    with pytest.raises(BadRecording) as error:
        read_recording(path)
    assert says in str(error.value)


def test_rows_of_another_program_without_t_s_take_their_log_time(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/stage", "json", 0)
        for i in range(4):
            row = {"u_v": i} if i == 2 else {"u_v": i, "y_um": 2 * i}
            writer.add_message(channel, 10**18 + i * 10**6, json.dumps(row).encode(), 0)
        writer.finish()
    read = read_recording(path)
    assert read.t_s == pytest.approx([0.0, 0.001, 0.002, 0.003], abs=1e-12)
    assert read.displacement is not None
    assert np.array_equal(read.displacement, [0.0, 2.0, np.nan, 6.0], equal_nan=True)


@pytest.mark.parametrize("kind", ["csv", "csv.gz", "npz", "mcap"])
def test_convert_keeps_every_column_to_the_last_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    columns = stage()
    t_s = columns.pop("t_s")
    first, there, back = (tmp_path / n for n in ("a.csv", f"b.{kind}", "c.csv"))
    write_recording(first, t_s, columns)
    assert main(["convert", str(first), str(there)]) == 0
    assert "200 rows of t_s, u_v, y_um, temp_c" in capsys.readouterr().out
    assert main(["convert", str(there), str(back)]) == 0
    found, _ = read_columns(back)
    assert list(found) == ["t_s", "u_v", "y_um", "temp_c"]
    for name, values in {"t_s": t_s, **columns}.items():
        assert np.array_equal(found[name], values, equal_nan=True)


def test_convert_replaces_nothing_and_says_what_it_can_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,u_v\n0,1\n1,2\n")
    assert main(["convert", str(path), str(path)]) == 2
    assert main(["convert", str(path), str(tmp_path / "a.mat")]) == 2
    said = capsys.readouterr().err
    assert "is an input" in said
    assert ".csv, .csv.gz, .npz, .mcap are written" in said
    assert path.read_text() == "t_s,u_v\n0,1\n1,2\n"
