"""`dehyst setup --yes` as a process, from two ports to a validated model, on emulated units."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.processes import EmulatedBench, dehyst, set_up

from dehyst.daemon.config import load_config
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.setup.moving import TUNING
from dehyst.daemon.setup.names import NAMES

pytestmark = pytest.mark.timing
RANGE, SLEW = (0.0, 140.0), 3000.0


@pytest.fixture(scope="module")
def done(
    tmp_path_factory: pytest.TempPathFactory,
) -> "tuple[Path, subprocess.Popen[str], str, str]":
    """Run one whole set-up; return (folder, process, stdout, stderr of all attempts). The bench's
    output is kept in a file."""
    folder = tmp_path_factory.mktemp("setup")
    bench = EmulatedBench(folder)
    try:
        process, out, err = set_up(
            str(folder / "stage"),
            "--yes",
            "--json",
            "--duration",
            "12",
            "--ports",
            bench.ports["ksg101"],
            bench.ports["mdt693b"],
            "--range",
            *map(str, RANGE),
            "--slew",
            str(SLEW),
            "--axis",
            "x",
        )
        time_ns, volts = bench.output()
        np.savez(folder / "output.npz", time_ns=time_ns, volts=volts)
    finally:
        bench.close()
    return folder, process, out, err


def test_it_tracks_ten_times_better_than_the_linear_gain(done: Any) -> None:
    _, process, out, err = done
    assert process.returncode == 0, err
    result = json.loads(out)
    assert tuple(result) == NAMES
    track = result["track"]
    if track["late_share"] > TUNING.most_late:
        assert "too busy to judge" in track["words"]
        pytest.skip(f"not judged: {track['late_share']:.1%} of the samples were too late")
    assert track["times_smaller"] >= 10.0
    assert result["validate"]["share_of_span"] < 0.01


def test_the_units_were_distinguished_whatever_their_order(done: Any) -> None:
    folder, _, out, _ = done
    units = json.loads(out)["units"]
    assert units["actuator"]["port"].endswith("mdt693b")
    assert units["sensor"]["port"].endswith("ksg101")
    config = load_config(folder / "stage" / "stage.toml")
    assert (config.limits.min_v, config.limits.max_v, config.limits.slew_v_per_s) == (*RANGE, SLEW)
    assert Path(config.model.file).name == "stage.model.toml"
    assert config.loop.rate_hz <= json.loads(out)["units"]["sustained_hz"]


def test_the_output_never_left_the_limits_that_were_asked_for(done: Any) -> None:
    """The amplifier's output stays within the requested range and makes no jump, judged at the
    emulated amplifier itself; its converter has steps of 2.75 mV."""
    folder, *_ = done
    with np.load(folder / "output.npz") as data:
        volts = data["volts"]
    assert volts.size > 5000
    assert volts.min() >= RANGE[0] - 3e-3
    assert volts.max() <= RANGE[1] + 3e-3
    assert np.abs(np.diff(volts)).max() < SLEW / 50.0  # no jump, though samples may be late


def test_each_step_that_moves_said_how_far_before_it_moved(done: Any) -> None:
    *_, err = done
    lines = err.splitlines()
    for title in ("exercise gently", "excite and record", "validate it", "track a sine"):
        at = next(i for i, line in enumerate(lines) if title in line)
        assert "moves: " in lines[at + 1]
        assert " V" in lines[at + 1]


def test_what_it_leaves_is_of_use(done: Any) -> None:
    folder, *_ = done
    names = {path.name for path in (folder / "stage").iterdir()}
    assert {
        "stage.toml",
        "stage.model.toml",
        "setup.json",
        "report.html",
        "validation.html",
        "tracking.png",
        "recording-1.csv",
        "fresh-1.csv",
    } <= names
    drive = [read_recording(folder / "stage" / f"{n}-1.csv").drive for n in ("recording", "fresh")]
    size = min(d.size for d in drive)
    together = np.corrcoef(drive[0][:size], drive[1][:size])[0, 1]
    assert abs(together) < 0.9  # the validation uses another drive


def test_a_second_call_has_nothing_left_to_do_and_moves_nothing(done: Any) -> None:
    """A second call finds every step done and moves nothing. The ports no longer exist: a step that
    touched them would fail."""
    folder, *_ = done
    again = dehyst("setup", str(folder / "stage"), "--yes")
    _, err = again.communicate(timeout=60)
    assert again.returncode == 0, err
    assert err.count(": done 20") == len(NAMES)
    assert "moves:" not in err


def test_without_limits_nothing_is_touched(tmp_path: Path) -> None:
    for line, words in (
        (("--yes", "--ports", "/dev/nowhere"), "--yes needs --range MIN MAX"),
        ((), "stdin is not a terminal"),
        (("--yes", "--ports", "/dev/nowhere", "--range", "0", "9"), "no port /dev/nowhere"),
    ):
        process = dehyst("setup", str(tmp_path / "stage"), *line)
        _, err = process.communicate(timeout=60)
        assert process.returncode == 2
        assert words in err.splitlines()[-1]
