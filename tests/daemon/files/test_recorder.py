"""Telemetry is written to every kind of file, in one or in pieces: no row is lost, bounds are kept,
and full disks are reported."""

import gzip
import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from mcap.reader import make_reader
from tests.rigs.gateway_bench import ROOT, environment

from dehyst.daemon.files.appended import RecordingFailed
from dehyst.daemon.files.mcap_file import TOPIC
from dehyst.daemon.files.outputs import notes_path
from dehyst.daemon.files.pieces import parse_rotation
from dehyst.daemon.files.recorder import Recorder
from dehyst.daemon.files.recordings import read_columns
from dehyst.daemon.files.rows import HELD_S, open_rows
from dehyst.daemon.files.sidecar import read_notes, write_notes
from dehyst.daemon.main import main
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.models.errors import BadInput, BadRecording

KINDS = ["csv", "csv.gz", "mcap", "npz"]
RATE_HZ = 10_000
WALL_OFFSET_NS = 1_767_323_045 * 10**9  # 2026-01-02 03:04:05 UTC


def telemetry(rows: int, first: int = 0) -> np.ndarray:
    """Return samples at 10 kHz, with noise in every bit, and with readings and targets missing."""
    rng = np.random.default_rng(7)
    out = np.zeros(rows, TELEMETRY)
    out["seq"] = first + np.arange(rows)
    out["scheduled_ns"] = 5_000_000_000 + out["seq"] * (10**9 // RATE_HZ)
    for name in ("target", "measured", "volts", "trim", "learned"):
        out[name] = rng.normal(size=rows)
    out["measured"][::50] = np.nan
    out["target"][: rows // 3] = np.nan
    out["flags"] = rng.integers(0, 2, rows) * 128 + 4
    return out


def expected(samples: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns as the recorder describes them, for a gain of 15 and an origin of 2."""
    drive = np.full(samples.size, np.nan)
    drive[1:] = samples["volts"][:-1] / 15.0
    return {
        "t_s": (samples["scheduled_ns"] - samples["scheduled_ns"][0]) / 1e9,
        "u_v": drive,
        "y_um": samples["measured"] + 2.0,
        "target_um": samples["target"] + 2.0,
        "trim_um": samples["trim"],
        "learned_um": samples["learned"],
        "missed": (samples["flags"] & 128) / 128.0,
        "flags": samples["flags"].astype(float),
    }


def write(path: Path, samples: np.ndarray, every: str = "", keep: str | None = None) -> Recorder:
    rotation = parse_rotation(every, keep, False) if every else None
    notes = {"note": "two\nlines"}
    with Recorder(path, 15.0, ("v", "um"), 2.0, notes, rotation=rotation) as file:
        for start in range(0, samples.size, 700):
            file.add(samples[start : start + 700], wall_offset_ns=WALL_OFFSET_NS)
    return file


def same(found: dict[str, np.ndarray], wanted: dict[str, np.ndarray]) -> bool:
    assert list(found) == list(wanted)
    return all(np.array_equal(found[name], wanted[name], equal_nan=True) for name in wanted)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_holds_every_row_to_the_last_bit(tmp_path: Path, kind: str) -> None:
    samples = telemetry(20_000)
    path = tmp_path / f"run.{kind}"
    assert write(path, samples).rows == 20_000
    found, notes = read_columns(path)
    assert same(found, expected(samples))
    assert notes["note"].split() == ["two", "lines"]
    assert notes["started"] == "2026-01-02T03:04:10.000000+00:00"  # the first sample is at 5 s


def test_the_formats_own_reader_sees_what_the_csv_has(tmp_path: Path) -> None:
    samples = telemetry(20_000)
    for kind in ("csv", "mcap"):
        write(tmp_path / f"run.{kind}", samples)
    csv, _ = read_columns(tmp_path / "run.csv")
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        kinds = json.loads(next(iter(reader.get_summary().schemas.values())).data)["properties"]
        messages = [(m.log_time, json.loads(m.data)) for _, _, m in reader.iter_messages()]
    assert list(kinds) == list(csv)
    assert {kind["type"] for kind in kinds.values()} == {"number"}  # the only type Foxglove accepts
    for name, column in csv.items():
        found = np.array([row.get(name, np.nan) for _, row in messages])
        assert np.array_equal(found, column, equal_nan=True)
    begun_ns = 5_000_000_000 + WALL_OFFSET_NS
    assert [ns - begun_ns for ns, _ in messages] == [100_000 * i for i in range(20_000)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("every", ["0.25s", "200kB"])
def test_pieces_one_behind_the_other_are_the_whole(tmp_path: Path, kind: str, every: str) -> None:
    samples = telemetry(12_000)
    file = write(tmp_path / f"run.{kind}", samples, every)
    pieces = sorted(tmp_path.glob(f"run-?????.{kind}"))
    assert file.pieces.made == pieces
    assert len(pieces) >= 2
    parts = [read_columns(piece)[0] for piece in pieces]
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    assert same(whole, expected(samples))
    if every == "0.25s":
        assert [part["t_s"].size for part in parts] == [2500, 2500, 2500, 2500, 2000]


@pytest.mark.parametrize("kind", ["csv", "csv.gz", "mcap"])
def test_the_disk_holds_no_more_than_it_may(tmp_path: Path, kind: str) -> None:
    bound = 9_000_000
    rotation = parse_rotation("1MB", "9MB", False)
    largest, rows = 0, 0
    with Recorder(tmp_path / f"run.{kind}", 1.0, ("v", "um"), 0.0, {"a": "b"},
                  rotation=rotation) as file:  # fmt: skip
        for start in range(0, 280_000, 4_000):
            rows += 4_000
            file.add(telemetry(4_000, start))
            largest = max(largest, sum(path.stat().st_size for path in tmp_path.iterdir()))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= bound
    assert bound / 2 < largest <= bound
    assert file.pieces.dropped > 0
    assert len(list(tmp_path.glob("*.meta.json"))) == (
        0 if kind == "mcap" else len(file.pieces.made)
    )
    last = [read_columns(piece)[0] for piece in file.pieces.made]
    t_s = np.concatenate([part["t_s"] for part in last])
    assert t_s[-1] == pytest.approx((rows - 1) / RATE_HZ)
    assert np.allclose(np.diff(t_s), 1 / RATE_HZ)  # the newest, without a gap


def test_pieces_of_an_earlier_recording_stay_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    write(path, telemetry(3000), "0.1s")
    before = {p.name: p.read_bytes() for p in tmp_path.glob("*.csv")}
    file = write(path, telemetry(100_000), "0.5s", "9MB")
    assert file.pieces.made[-1].name == f"run-{3 + 20:05d}.csv"
    assert file.pieces.dropped > 0
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    forced = parse_rotation("1MB", "9MB", True)
    with Recorder(path, 1.0, ("v", "um"), 0.0, {}, rotation=forced) as file:
        file.add(telemetry(30_000))
    assert not (tmp_path / "run-00001.csv").exists()


@pytest.mark.parametrize(
    ("every", "keep", "says"),
    [
        ("10", None, "--rotate 10: write a number and one of s, min, h, d, kB"),
        ("0s", None, "--rotate 0s"),
        ("ten min", None, "--rotate"),
        ("1h", "1h", "--keep 1h: write a number and one of kB"),
        ("1h", "1MB", "--keep 1MB: at least 9 MB"),
        ("1GB", "2GB", "must be below half of --keep 2GB"),
    ],
)
def test_a_rotation_that_makes_no_sense_is_refused(every: str, keep: str | None, says: str) -> None:
    with pytest.raises(BadInput) as error:
        parse_rotation(every, keep, False)
    assert says in str(error.value)


FILL = """
import resource, sys
from pathlib import Path
import numpy as np
from dehyst.daemon.files.appended import NothingRecorded, RecordingFailed
from dehyst.daemon.files.rows import HELD_S, open_rows
path = Path(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))
rng, done = np.random.default_rng(1), 0
try:
    rows = open_rows(path, ["t_s", "u_v", "y_um"], {}, False)
    for block in range(1000):
        rows.add([0.001 * (done + np.arange(1000)), *rng.normal(size=(2, 1000))])
        done += 1000
except NothingRecorded as error:
    sys.exit(str(error))
except RecordingFailed as error:
    rows.close()
    print(rows.rows)
    sys.exit(str(error))
"""

KILLED = """
import os, sys
from pathlib import Path
import numpy as np
from dehyst.daemon.files.rows import HELD_S, open_rows
rows = open_rows(Path(sys.argv[1]), ["t_s", "u_v", "y_um"], {"stage": "P-885"}, False)
rng, step_s = np.random.default_rng(1), float(sys.argv[2])
done = 0
while True:
    rows.add([step_s * (done + np.arange(100)), *rng.normal(size=(2, 100))])
    done += 100
    print(done, flush=True)
"""


def whole_part(path: Path) -> np.ndarray:
    """Return the times of the rows that `dehyst convert --unfinished` keeps."""
    whole = path.with_name(f"whole-{path.name}")
    assert main(["convert", "--unfinished", str(path), str(whole), "--force"]) == 0
    return read_columns(whole)[0]["t_s"]


@pytest.mark.processes
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_said_of_a_full_disk_is_true(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    done = subprocess.run(
        [sys.executable, "-c", FILL, str(path)],
        env=environment(), capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    said = re.search(r"ends here; (\d+) rows of it can be read", done.stderr)
    assert said, done.stderr
    if kind in ("npz", "mcap"):
        assert "by dehyst convert --unfinished" in done.stderr
        with pytest.raises(BadRecording, match=rf"convert --unfinished run.{kind} whole.{kind}"):
            read_columns(path)
    t_s = whole_part(path)
    assert t_s.size == int(done.stdout) == int(said[1])
    assert t_s.size > 10_000
    assert np.array_equal(t_s, 0.001 * np.arange(t_s.size))


@pytest.mark.processes
@pytest.mark.parametrize("kind", KINDS)
def test_a_disk_that_is_full_from_the_start_leaves_no_file(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    done = subprocess.run(
        [sys.executable, "-c", FILL.replace("1_500_000", "0"), str(path)],
        env=environment(), capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    assert done.stderr.endswith("nothing was recorded\n")
    assert not path.exists()


@pytest.mark.processes
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rate_hz", [100, 10_000])
def test_a_kill_costs_no_more_than_what_was_held(tmp_path: Path, kind: str, rate_hz: int) -> None:
    path = tmp_path / f"run.{kind}"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path), str(1 / rate_hz)],
        env=environment(), stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        done = 0
        while done < 20_000:
            done = int(process.stdout.readline())
        process.kill()
    t_s = whole_part(path)
    assert t_s.size >= done - HELD_S * rate_hz - 100
    assert np.allclose(t_s, np.arange(t_s.size) / rate_hz)
    if kind in ("npz", "mcap"):  # the others have a separate file of notes
        assert read_columns(path.with_name(f"whole-{path.name}"))[1]["stage"] == "P-885"


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_is_deleted_while_it_grows_is_an_error(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    rows = open_rows(path, ["t_s", "u_v"], {}, False)
    rows.add([np.arange(5.0), np.arange(5.0)])
    path.unlink()
    with pytest.raises(RecordingFailed, match=r"run.*was deleted"):
        rows.add([5.0 + np.arange(500.0), np.arange(500.0)])
    late = tmp_path / f"late.{kind}"
    rows = open_rows(late, ["t_s", "u_v"], {}, False)
    rows.add([np.arange(5.0), np.arange(5.0)])
    late.unlink()
    with pytest.raises(RecordingFailed, match=r"late.*was deleted"):
        rows.close()
    assert not late.exists()


@pytest.mark.parametrize(
    ("end", "rows"),
    [
        (b"", 2),
        (b"0.3,1", 2),
        (b"0.3,1,2", 2),
        (bytes(4096), 2),
        (b"0.3,1,2\n" + bytes(9), 3),
        (b"0.3,1,2\n" + bytes(9) + b"\n0.5,1,2\n", 3),  # a block that never reached the disk
    ],
)
def test_an_unfinished_csv_is_read_to_its_last_whole_line(
    tmp_path: Path, end: bytes, rows: int
) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"t_s,u_v,y_um\n0.1,1,2\n0.2,1,2\n" + end)
    assert whole_part(path).tolist() == [0.1, 0.2, 0.3][:rows]


@pytest.mark.parametrize("lost", [1, 9, 200])
def test_an_unfinished_packed_csv_is_read_to_where_it_was_cut(tmp_path: Path, lost: int) -> None:
    path = tmp_path / "run.csv.gz"
    rows = open_rows(path, ["t_s", "u_v"], {}, False)
    for start in range(0, 10, 2):
        rows.add([start + 0.01 * np.arange(200), np.ones(200)])
    rows.close()
    path.write_bytes(path.read_bytes()[:-lost])
    t_s = whole_part(path)
    assert t_s.size >= 700
    np.testing.assert_allclose(np.diff(t_s), 0.01)


def test_a_packed_csv_can_be_unpacked_while_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "run.csv.gz"
    rows = open_rows(path, ["t_s", "u_v"], {}, False)
    for start in range(0, 40_000, 1000):
        t_s = 1e-5 * (start + np.arange(1000))
        rows.add([t_s, np.sin(t_s)])
    with gzip.open(path, "rt") as file:
        lines = file.read().splitlines()
    assert lines[0] == "t_s,u_v"
    assert 20_000 < len(lines) <= 40_001
    rows.close()
    assert read_columns(path)[0]["t_s"].size == 40_000


def test_notes_stand_beside_a_csv_and_go_with_it(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,u_v\n0,1\n1,2\n")
    write_notes(path, {"stage": "P-885"})
    assert notes_path(path).name == "a.csv.meta.json"
    assert read_columns(path)[1] == {"stage": "P-885"}
    notes_path(path).write_text("[1, 2")
    with pytest.raises(BadRecording, match=r"a.csv.meta.json.*correct or delete it"):
        read_columns(path)
    write_notes(path, {})
    assert read_notes(path) == {}
    assert not notes_path(path).exists()


def test_an_npz_takes_what_can_be_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dehyst.daemon.files.rows.MOST_BYTES", 200_000)
    file = write(tmp_path / "run.npz", telemetry(5000), "1h")
    assert len(file.pieces.made) > 1
    assert file.rows == 5000


def test_the_layouts_draw_columns_that_a_recording_has(tmp_path: Path) -> None:
    write(tmp_path / "run.csv", telemetry(10))
    columns = set(read_columns(tmp_path / "run.csv")[0])
    layouts = ROOT / "docs" / "layouts"
    panels = json.loads((layouts / "foxglove.json").read_text())["configById"].values()
    drawn = {path["value"] for panel in panels for path in panel["paths"]}
    drawn |= {panel["xAxisPath"]["value"] for panel in panels if "xAxisPath" in panel}
    assert {name.partition(".")[0] for name in drawn} == {TOPIC}
    assert {name.partition(".")[2] for name in drawn} <= columns
    curves = list(ElementTree.parse(layouts / "plotjuggler.xml").iter("curve"))
    keys = ("curve_x", "curve_y")
    drawn = {c.attrib[k] for c in curves for k in (keys if "curve_x" in c.attrib else ("name",))}
    assert {name.rpartition("/")[0] for name in drawn} == {TOPIC}
    assert {name.rpartition("/")[2] for name in drawn} <= columns
