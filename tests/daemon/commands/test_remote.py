"""send, play, watch and record as processes against a running gateway."""

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import numpy as np
import pexpect
import pytest
from tests.rigs.command_line import exit_status
from tests.rigs.gateway_bench import ROOT, Bench, may_lack, renewed, wait_until

from dehyst.daemon.files.recorder import Recorder, RecordingFailed
from dehyst.daemon.files.recordings import read_columns, read_recording
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.terminal.braille import Curve, Plot
from dehyst.models.errors import BadInput

ENV = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
LATE = "of the deadlines were missed"


def start(*arguments: str, bench: Bench) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "dehyst.daemon.main", *arguments, "--connect", bench.address]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, env=ENV, stdout=pipe, stderr=pipe, text=True)


def run(*arguments: str, bench: Bench) -> tuple[int, str, str]:
    """Run the command in this process; return (exit code, stdout, stderr)."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = exit_status([*arguments, "--connect", bench.address])
    return code, out.getvalue(), err.getvalue()


def trajectory(path: Path, low: float, high: float, seconds: float = 2.0) -> None:
    t_s = np.arange(0.0, seconds, 0.005)
    target = 0.5 * (low + high) + 0.5 * (high - low) * np.sin(2 * np.pi * t_s)
    rows = "".join(f"{t:.3f},1,{y:.6f}\n" for t, y in zip(t_s, target, strict=True))
    path.write_text("t_s,u_v,target_um\n" + rows)


def on_grid(t_s: np.ndarray, period_s: float = 0.005) -> int:
    """Check that the times lie on the loop's grid; return how many grid points the loop missed."""
    places = np.diff(t_s) / period_s
    assert np.allclose(places, np.rint(places), atol=1e-3)
    assert (np.rint(places) >= 1).all()
    return int(np.rint(places).sum()) - places.size


def test_play_watched_and_recorded(shared: Bench, tmp_path: Path) -> None:
    shared.client()
    path, rec = tmp_path / "way.csv", tmp_path / "rec.csv"
    trajectory(path, 2.0, 8.0)
    recorder = start("record", "-o", str(rec), bench=shared)
    wait_until("it records", lambda: rec.exists() and rec.stat().st_size > 2000)
    watcher = start("watch", "--for", "4", bench=shared)
    assert watcher.stdout is not None
    assert watcher.stdout.readline()  # it watches before the trajectory begins
    begun = shared.loop.seq
    code, out, err = run("play", str(path), "--json", bench=shared)
    result = json.loads(out)
    assert (code, err) == (0, "")
    assert result["completed"]
    assert result["expected_samples"] == 400
    assert 400 - may_lack(shared.loop.samples(begun)) <= result["samples"] <= 400
    assert 0 < result["rms_error"] <= result["max_error"]
    recorder.send_signal(signal.SIGINT)
    out, err = recorder.communicate(timeout=30)
    assert recorder.returncode == 0, err
    assert "0 lost" in err
    out, err = watcher.communicate(timeout=30)
    assert watcher.returncode == 0
    assert "running" in out
    assert "nan" not in out  # there is no target before the trajectory
    assert len(out.splitlines()) <= 5
    recording = read_recording(rec, need_displacement=True)
    on_grid(recording.t_s)
    assert recording.displacement is not None
    # compare with the loop's own records: the recorded drive is the one in force at the reading
    origin = float(recording.metadata["setpoint_origin"].split()[0])
    records = shared.loop.samples()
    measured, shown = records["measured"] + origin, recording.displacement[1:]
    windows = np.lib.stride_tricks.sliding_window_view(measured, 50)
    place = int(np.argmin(np.abs(windows - shown[:50]).sum(axis=1)))
    at = place + np.arange(shown.size)
    assert np.allclose(recording.displacement[1:], measured[at], atol=1e-6)
    assert np.allclose(recording.drive[1:], records["volts"][at - 1], atol=1e-6)
    target = recording.channels["target_um"]
    assert np.nanmax(target) > 7.9
    assert "setpoint_origin" in recording.metadata


def test_play_refuses_what_does_not_fit(shared: Bench, tmp_path: Path) -> None:
    shared.client()
    path = tmp_path / "way.csv"
    trajectory(path, 6.0, 14.0, 1.0)
    code, _, err = run("play", str(path), bench=shared)
    assert code == 2
    offered = re.search(r"--offset-um (-[\d.]+) would centre it", err)
    assert offered
    assert err.count("\n") == 1
    begun = shared.loop.seq
    code, out, _ = run("play", str(path), "--offset-um", offered[1], "--loop", "2", bench=shared)
    assert code == 0
    played = re.search(r"(\d+) of 400 samples", out)
    assert played, out
    assert 400 - may_lack(shared.loop.samples(begun)) <= int(played[1]) <= 400
    code, out, _ = run("play", str(path), "--allow-unreachable", "--json", bench=shared)
    assert code == 1
    reach = shared.client().status().reach_max
    target = np.loadtxt(path, delimiter=",", skiprows=1)[:, 2]
    outside = int(np.count_nonzero(target > reach))  # of 200; some can be reached when moving up
    assert 10 < json.loads(out)["unreachable_samples"] <= outside
    code, _, err = run("play", str(path), "--column", "u_v", bench=shared)
    assert code == 2
    assert "targets are in v" in err
    assert run("play", str(tmp_path / "none.csv"), bench=shared)[0] == 2


def test_send(shared: Bench) -> None:
    shared.client()
    code, out, _ = run("send", "4", "--json", bench=shared)
    assert code == 0
    assert json.loads(out)["reply"]["ok"]
    code, _, err = run("send", "44", bench=shared)
    assert code == 2
    assert "cannot be reached" in err
    code, _, err = run("send", "44", "--allow-unreachable", bench=shared)
    assert code == 0
    reach = shared.client().status().reach_max
    assert f"44 um cannot be reached: going to {reach:.6g} um, the nearest" in err
    assert run("send", "nan", bench=shared)[0] == 2
    for what, done in (("--stop", "stopped"), ("--release", "released")):
        code, out, _ = run("send", what, "--json", bench=shared)
        assert (code, json.loads(out)) == (0, {done: ["bench"]})
    code, _, err = run("send", "4", "--name", "nobody", bench=shared)
    assert (code, "there are: bench" in err) == (2, True)


def test_who_is_refused_hears_how_to_take_over(shared: Bench, tmp_path: Path) -> None:
    first = shared.client("the first")
    first.send(4.0)
    path = tmp_path / "way.csv"
    trajectory(path, 4.0, 5.0, 0.5)
    for command in (("send", "5"), ("play", str(path))):
        with renewed(first):
            code, _, err = run(*command, bench=shared)
        assert code == 2
        assert "the first commands this daemon" in err
        assert "--take-over" in err
        assert err.count("\n") == 1
    assert run("send", "5", "--take-over", bench=shared)[0] == 0


def test_status_is_one_screen_and_its_exit_status_says_whether_to_look(bench: Bench) -> None:
    bench.client()
    code, out, err = run("status", bench=bench)
    marked = [line for line in out.splitlines() if line.lstrip().startswith("!")]
    assert all(LATE in line for line in marked), out  # this machine may be busy
    assert (code, err) == (int(bool(marked)), ""), out
    assert out.startswith("bench: ready: no client commands")
    assert len(out.splitlines()) <= 24
    assert "core: the loop's process is running" in out  # before any client listened
    code, out, _ = run("status", "--json", bench=bench)
    reported = json.loads(out)
    assert all(LATE in line for line in reported["attention"]), out
    assert (code, reported["ok"]) == (
        int(bool(reported["attention"])), not reported["attention"],
    )  # fmt: skip
    assert reported["status"]["name"] == "bench"
    assert "play operators" in reported["model"]
    assert [e["text"] for e in reported["events"]]
    bench.loop.close()
    wait_until("the gateway misses the loop", lambda: not bench.clients[0].status().core_alive)
    code, out, _ = run("status", bench=bench)
    assert code == 1
    assert "! the loop's process does not respond" in out
    bench.kill_gateway()
    for command in (["status"], ["send", "4"]):
        code, _, err = run(*command, bench=bench)
        assert code == 2
        assert "no daemon reached" in err


def test_watch_on_a_terminal_of_80_by_24_fits_respects_no_color_and_resizes(shared: Bench) -> None:
    shared.client()
    command = [sys.executable, "-m", "dehyst.daemon.main", "watch", "--connect", shared.address]
    env = {**ENV, "NO_COLOR": "1", "TERM": "xterm-256color"}
    env = {k: v for k, v in env.items() if k not in ("COLUMNS", "LINES")}
    watcher = pexpect.spawn(
        command[0], [*command[1:], "--for", "20"], env=env, dimensions=(24, 80), encoding="utf-8",
        codec_errors="replace",  # an interrupt discards what the terminal has not shown yet
    )  # fmt: skip
    watcher.expect("bench: ", timeout=60)
    watcher.expect("missed", timeout=60)
    shown = str(watcher.before)
    assert "telemetry lost here" not in shown  # a label of the large view
    assert re.search("\x1b\\[[0-9;]*3[0-9]", shown) is None
    watcher.setwinsize(45, 140)
    watcher.expect("telemetry lost here", timeout=60)
    watcher.send("q")
    watcher.expect(pexpect.EOF, timeout=10)
    watcher.close()
    assert watcher.exitstatus == 0


def test_watch_as_json_is_one_object_a_line(shared: Bench) -> None:
    shared.client()
    code, out, _ = run("watch", "--json", "--for", "3.5", bench=shared)
    assert code == 0
    lines = [json.loads(line) for line in out.splitlines()]
    assert len(lines) >= 2
    assert {line["name"] for line in lines} == {"bench"}


def test_record_for_so_many_seconds_across_a_killed_gateway(bench: Bench, tmp_path: Path) -> None:
    rec = tmp_path / "rec.csv"
    bench.client()
    recorder = start("record", "-o", str(rec), "--for", "5", "--json", bench=bench)
    wait_until("it records", lambda: rec.exists() and rec.stat().st_size > 2000)
    bench.kill_gateway()
    bench.start_gateway()
    out, err = recorder.communicate(timeout=60)
    result = json.loads(out)
    assert recorder.returncode == 0, err
    assert result["lost_samples"] == 0
    # where the loop skips the last deadlines, no row shows it
    assert 980 <= result["samples"] + on_grid(read_recording(rec).t_s) <= 1000


def test_a_recording_that_hits_a_limit_ends_with_a_whole_line(
    shared: Bench, tmp_path: Path
) -> None:
    rec = tmp_path / "rec.csv"
    shared.client()
    program = (
        "import resource, sys; from dehyst.daemon.main import main;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000));"
        f"sys.exit(main(['record', '-o', {str(rec)!r}, '--connect', {shared.address!r}]))"
    )
    done = subprocess.run(
        [sys.executable, "-B", "-c", program], env=ENV, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert "rows of it can be read" in done.stderr
    assert done.stderr.count("\n") == 1
    assert rec.read_bytes().endswith(b"\n")
    assert 7900 <= rec.stat().st_size <= 8000
    assert read_recording(rec).t_s.size > 20
    nowhere = str(tmp_path / "no" / "rec.csv")
    code, _, err = run("record", "-o", nowhere, bench=shared)
    assert (code, "is in a folder that does not exist" in err) == (2, True)


def telemetry(seq: list[int], period_ns: int = 1_000_000) -> np.ndarray:
    out = np.zeros(len(seq), TELEMETRY)
    out["seq"] = seq
    out["scheduled_ns"] = 5_000_000_000 + period_ns * np.array(seq)
    out["volts"] = 15.0 * np.array(seq)
    out["measured"] = np.where(np.array(seq) % 5 == 0, np.nan, 0.25)
    out["target"] = np.nan
    return out


def test_gaps_stay_gaps_and_the_drive_is_the_one_before(tmp_path: Path) -> None:
    path = tmp_path / "rec.csv"
    with Recorder(path, 15.0, ("v", "um"), 2.0, {"note": "two\nlines"}) as file:
        file.add(telemetry([3, 4, 5]))
        file.add(telemetry([6, 9]))
        file.add(telemetry([20, 21]))
        assert (file.rows, file.gaps) == (7, 2)
        with pytest.raises(RecordingFailed, match="clock restarted"):
            file.add(telemetry([0]))
    recording = read_recording(path)
    assert np.allclose(recording.t_s, 1e-3 * np.array([0, 1, 2, 3, 6, 17, 18]))
    nan = np.nan
    assert np.array_equal(recording.drive, [nan, 3, 4, 5, nan, nan, 20], equal_nan=True)
    expected = [2.25, 2.25, nan, 2.25, 2.25, nan, 2.25]
    assert np.array_equal(recording.displacement, expected, equal_nan=True)
    assert recording.metadata["note"] == "two lines"
    with pytest.raises(BadInput):
        Recorder(tmp_path / "rec.txt", 1.0, ("v", "um"), 0.0, {})


def test_braille_plot_draws_the_curve_where_it_is() -> None:
    from rich.console import Console

    console = Console(width=60, height=20, file=io.StringIO(), record=True)
    x = np.linspace(0.0, 1.0, 500)
    console.print(Plot(x, [Curve("up", x, "red"), Curve("none", x * np.nan, "blue")], "um"))
    console.print(Plot(x[:0], [Curve("none", x[:0], "red")], "um"))
    lines = console.export_text().splitlines()
    first = [min((line.index(c) for c in line if ord(c) > 0x2800), default=None) for line in lines]
    drawn = [f for f in first if f is not None]
    assert len(drawn) >= 10
    assert drawn == sorted(drawn, reverse=True)  # rises to the right
    assert lines[0].strip().startswith("1")
    assert "nothing to draw" in lines[-1]


def test_a_recorder_that_stood_still_fetches_what_it_missed(shared: Bench, tmp_path: Path) -> None:
    rec = tmp_path / "rec.csv"
    shared.client()
    recorder = start("record", "-o", str(rec), "--for", "7", "--json", bench=shared)
    wait_until("it records", lambda: rec.exists() and rec.stat().st_size > 2000)
    recorder.send_signal(signal.SIGSTOP)
    begun = shared.loop.seq
    wait_until("five seconds pass", lambda: shared.loop.seq > begun + 1000)
    recorder.send_signal(signal.SIGCONT)
    out, err = recorder.communicate(timeout=60)
    result = json.loads(out)
    assert recorder.returncode == 0, err
    assert (result["lost_samples"], result["gaps"]) == (0, 0)
    assert 1380 <= result["samples"] + on_grid(read_recording(rec).t_s) <= 1400


def test_two_kinds_of_file_and_pieces_hold_the_same_samples(shared: Bench, tmp_path: Path) -> None:
    shared.client()
    kinds = {"csv": (), "mcap": ("--rotate", "1s")}
    recorders = [
        start("record", "-o", str(tmp_path / f"run.{kind}"), "--for", "4", "--json", *rest,
              bench=shared)
        for kind, rest in kinds.items()
    ]  # fmt: skip
    results = []
    for recorder in recorders:
        out, err = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, err
        results.append(json.loads(out))
    pieces = [Path(piece) for piece in results[1]["pieces"]]
    assert [piece.name for piece in pieces] == [f"run-0000{n}.mcap" for n in (1, 2, 3, 4)]
    tables = [read_columns(path) for path in (tmp_path / "run.csv", *pieces)]
    (csv, csv_notes), parts = tables[0], [columns for columns, _ in tables[1:]]
    mcap = {name: np.concatenate([part[name] for part in parts]) for name in csv}
    begun_s = [
        datetime.fromisoformat(notes["started"]).timestamp() for notes in (csv_notes, tables[1][1])
    ]
    places = [
        np.rint((begin_s - begun_s[0] + table["t_s"]) * 200.0).astype(int)
        for begin_s, table in zip(begun_s, (csv, mcap), strict=True)
    ]
    _, one, other = np.intersect1d(places[0][1:], places[1][1:], return_indices=True)
    assert one.size > 200
    for name in set(csv) - {"t_s"}:
        assert np.array_equal(csv[name][1:][one], mcap[name][1:][other], equal_nan=True), name
