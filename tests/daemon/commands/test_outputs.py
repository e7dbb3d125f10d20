"""No command's output replaces an input or, unless asked to, an existing file that is no result of
an earlier run."""

import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import CONFIG
from tests.rigs.stage_model import model_text

from dehyst.daemon.commands.play import check_written
from dehyst.daemon.files.loading import SUFFIXES
from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.json_text import json_text
from dehyst.daemon.main import COMMANDS, build_parser, main
from dehyst.daemon.printable import in_utf8, printable
from dehyst.models.errors import BadInput

# what each command writes, with the inputs that each output must not overwrite
WRITES: dict[str, list[str]] = {
    "identify": ["identify {rec} -o {out}", "identify {rec} -o m.toml --report {dir}"],
    "validate": ["validate {model} {rec} --report {dir}"],
    "simulate": ["simulate {model} {rec} -o {out}"],
    "play": ["play {trajectory} --repeat 2 --learn --credentials {credentials} --picture {out}"],
    "convert": ["convert {rec} {out}", "convert {trajectory} {out}"],
    "invert": ["invert {model} {trajectory} -o {out}"],
    "diagnose": ["diagnose {rec} --model {model} -o {dir}"],
    "excite": [
        "excite --range 0 50 --band 5 --duration 2 -o {out}",
        "excite --separate delay lag --model {model} -o {out}",
        "excite --check {rec} --picture {out}",
        "excite --range 0 50 --band 5 --duration 2 -o d.csv --picture {out}",
    ],
    "acquire": ["acquire {rec} --config {config} -o {out}"],
    "scan": [
        "scan lissajous --size 1 1 --model x {model} --model y {model} -o {out}",
        "scan lissajous --size 1 1 --config {config} -o {out}",
        "scan lissajous --size 1 1 -o s.csv --picture {out}",
    ],
    "record": ["record --credentials {credentials} -o {out}"],
    "config": ["config init --range 0 100 -o {out}"],
    "doctor": ["doctor --credentials {credentials} --report {out}"],
    "probe": ["probe /dev/null -o {out}"],
    "emulate": ["emulate --dir {dir} --log {out}"],
    "demo": ["demo -o {dir}"],
}
MADE_NEW = {"keys"}  # opens every file with O_EXCL: tests/daemon/bus/test_security.py
REPORTS = {"paper", "image", "bench"}  # no input that could be replaced, and no recording
OUTPUTS = {"output", "report", "picture", "log", "directory"}


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Write one file of every kind of input; return them by name."""
    monkeypatch.chdir(tmp_path)
    time_s = np.arange(2000) / 1000.0
    drive = 30.0 - 30.0 * np.cos(2 * np.pi * time_s)
    paths = {name: tmp_path / f"{name}.csv" for name in ("rec", "trajectory", "credentials")}
    write_recording(paths["rec"], time_s, {"u_v": drive, "y_um": 0.1 * drive})
    write_recording(paths["trajectory"], time_s, {"target_um": 0.05 * drive})
    paths["credentials"].write_text("alice:long-enough-a-password\n")
    paths["model"] = tmp_path / "model.toml"
    paths["model"].write_text(model_text())
    paths["config"] = tmp_path / "stage.toml"
    paths["config"].write_text(CONFIG.format(run_dir=tmp_path / "run", port=7447, cpu=0))
    return paths


def test_every_command_that_writes_is_in_the_table() -> None:
    writing = set()
    for command in COMMANDS:
        (sub,) = [a for a in build_parser(command)._actions if a.dest == "command"]
        assert sub.choices is not None
        if {a.dest for a in sub.choices[command]._actions} & OUTPUTS:
            writing.add(command)
    assert writing == WRITES.keys() | MADE_NEW | REPORTS


def alias(target: Path, kind: str) -> Path:
    """Return another path to the same file."""
    if kind == "name":
        return target
    path = target.parent / "sub" / ("alias" + target.suffix)
    path.parent.mkdir(exist_ok=True)
    if kind == "dots":
        return target.parent / "sub" / ".." / target.name
    path.symlink_to(target) if kind == "symlink" else os.link(target, path)
    return path


CASES = [
    (command, line, kind)
    for command, lines in WRITES.items()
    for line in lines
    for kind in ("name", "dots", "symlink", "hard link")
    if any("{" + name + "}" in line for name in ("rec", "model", "trajectory", "config",
                                                 "credentials")) and "{out}" in line
]  # fmt: skip


@pytest.mark.parametrize(("command", "line", "kind"), CASES)
def test_an_input_is_never_replaced(
    command: str, line: str, kind: str, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in files.values()}
    for name, path in files.items():
        if "{" + name + "}" not in line:
            continue
        words = {key: str(p) for key, p in files.items()}
        words |= {"out": str(alias(path, kind)), "dir": "results"}
        force = ["--force"] if "--force" in help_of(command) else []
        assert main([*line.format(**words).split(), *force]) == 2
        said = capsys.readouterr().err
        assert "is an input" in said
        assert said.count("\n") == 1
        assert {path: path.read_bytes() for path in files.values()} == before
        (path.parent / "sub" / ("alias" + path.suffix)).unlink(missing_ok=True)


def help_of(command: str) -> str:
    (sub,) = [a for a in build_parser(command)._actions if a.dest == "command"]
    assert sub.choices is not None
    return str(sub.choices[command].format_help())


def test_a_report_or_a_folder_of_results_does_not_hit_an_input(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = files["model"].parent
    before = files["model"].read_bytes()
    assert main(f"diagnose {files['rec']} --model {files['model']} -o {folder}".split()) == 2
    assert "model.toml: is an input" in capsys.readouterr().err
    report = folder / "report.html"
    report.write_bytes(files["rec"].read_bytes())
    assert main(f"identify {files['rec']} -o {report} --report {folder} --force".split()) == 2
    assert "two outputs" in capsys.readouterr().err
    assert files["model"].read_bytes() == before


@pytest.mark.parametrize(
    ("command", "line"), [(c, line) for c, lines in WRITES.items() for line in lines]
)
def test_an_existing_recording_is_replaced_only_when_asked(
    command: str, line: str, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    if "{out}" not in line:
        pytest.skip("writes no recording")
    check_kept(line, Path("earlier.csv"), files, capsys)
    assert "--force" in help_of(command)


def test_the_recording_of_an_earlier_demo_is_replaced_only_when_asked(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    check_kept("demo -o {dir}", Path("results/recording.csv"), files, capsys)


def check_kept(
    line: str, earlier: Path, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Check that the command does not replace this file, and names the way to replace it."""
    earlier.parent.mkdir(exist_ok=True)
    earlier.write_text("t_s,u_v,y_um\n0.0,1.0,2.0\n")
    words = {key: str(p) for key, p in files.items()} | {"out": str(earlier), "dir": "results"}
    assert main(line.format(**words).split()) == 2
    said = capsys.readouterr().err
    assert f"{earlier}: exists already" in said
    assert "--force" in said
    assert said.count("\n") == 1
    assert earlier.read_text() == "t_s,u_v,y_um\n0.0,1.0,2.0\n"
    earlier.unlink()


def test_a_model_that_is_none_of_dehyst_in_a_folder_of_results_is_kept(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    check_kept("diagnose {rec} --model {model} -o {dir}", Path("results/model.toml"), files, capsys)


def test_a_diagnosis_refuses_to_replace_a_file_before_it_reads(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    check_kept("diagnose not-there.csv -o {dir}", Path("results/model.toml"), files, capsys)


def test_a_file_that_is_no_result_is_kept(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """A configuration, the record of a set-up, a recording, a file of another program."""
    others = [f"earlier{s}" for s in (*SUFFIXES, ".TXT", ".Csv", ".toml", "") if s != ".json"]
    for name in (*others, "setup.json", "units.json"):
        earlier = Path(name)
        earlier.write_text("kept")
        assert main(["identify", str(files["rec"]), "-o", str(earlier)]) == 2
        assert f"{earlier}: exists already" in capsys.readouterr().err
        assert earlier.read_text() == "kept"


def test_a_model_of_an_earlier_run_is_written_again(files: dict[str, Path]) -> None:
    one = read_recording(files["rec"])
    noisy = 0.1 * one.drive + np.random.default_rng(1).normal(0.0, 0.01, one.size)
    write_recording(files["rec"], one.t_s, {"u_v": one.drive, "y_um": noisy})
    line = f"identify {files['rec']} -o {files['model']} --static --order 3"
    assert main(line.split()) == 0
    assert files["model"].read_text() != model_text()


def test_a_correction_is_continued_and_its_picture_drawn_again(
    files: dict[str, Path],
) -> None:
    """`play --learned` continues its file, and draws its picture again; a recording that is named
    as the picture is protected."""
    line = ["play", str(files["trajectory"]), "--learned", "scan.learned.json"]
    learned, chosen, named = map(Path, ("scan.learned.json", "scan-learned.png", "mine.csv"))
    for path in (learned, chosen, named):
        path.write_text("of the run before")
    parser = build_parser("play")
    check_written(parser.parse_args(line), [learned], [chosen])
    args = parser.parse_args([*line, "--picture", "mine.csv"])
    with pytest.raises(BadInput, match=r"mine\.csv: exists already"):
        check_written(args, [learned], [named])
    with pytest.raises(BadInput, match="is an input"):
        check_written(args, [learned], [learned])
    check_written(
        parser.parse_args([*line, "--picture", "mine.csv", "--force"]), [learned], [named]
    )


def test_notes_beside_an_output_are_kept(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    notes = Path("new.csv.meta.json")
    for line in ("convert {rec} new.csv", "simulate {model} {rec} -o new.csv"):
        notes.write_text('{"kept": "yes"}')
        assert main(line.format(**files).split()) == 2
        assert "new.csv.meta.json: exists already" in capsys.readouterr().err
        assert notes.read_text() == '{"kept": "yes"}'
        assert not Path("new.csv").exists()
    assert main([*f"convert {files['rec']} new.csv --force".split()]) == 0
    assert not notes.exists()
    own = files["rec"].with_name("rec.csv.meta.json")
    own.write_text("{}")
    assert main(f"identify {files['rec']} -o {own} --force".split()) == 2
    assert "is an input" in capsys.readouterr().err


def test_with_force_the_new_recording_is_there(files: dict[str, Path]) -> None:
    out = Path("earlier.csv")
    out.write_text("t_s,u_v\n0.0,1.0\n1.0,1.0\n")
    line = f"simulate {files['model']} {files['rec']} -o {out} --force"
    assert main(line.split()) == 0
    assert read_recording(out).size == 2000


def test_devices_and_folders_are_not_written_to(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("folder.csv").mkdir()
    for out in ("folder.csv", "/dev/null"):
        assert main(f"simulate {files['model']} {files['rec']} -o {out} --force".split()) == 2
        assert "not an ordinary file" in capsys.readouterr().err
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_file_appears_complete_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(b"before")
    bystander = tmp_path / "x.csv.part"
    bystander.write_bytes(b"the user's own")
    half = whole_file(path)
    half.__enter__().write(b"half")
    assert path.read_bytes() == b"before"
    assert half.__exit__(RuntimeError, RuntimeError(), None) is not True
    assert path.read_bytes() == b"before"
    with whole_file(path) as file:
        file.write(b"whole")
    assert path.read_bytes() == b"whole"
    assert bystander.read_bytes() == b"the user's own"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.csv", "x.csv.part"]
    with pytest.raises(BadInput), whole_file(tmp_path):
        pass


@pytest.mark.parametrize(
    "line",
    [
        "identify {rec} -o new.toml --report {there}",
        "validate {model} {rec} --report {there}",
        "diagnose {rec} -o {there}",
        "paper -o {there}",
        "image -o {there}",
        "bench -o {there}",
        "demo -o {there}",
        "convert {rec} {there}/new.csv",
    ],
)
def test_a_file_in_the_place_of_a_folder_is_named_before_the_work(
    line: str, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    there = Path("monday.csv")
    there.write_text("a file")
    words = {key: str(p) for key, p in files.items()}
    before = sorted(Path().iterdir())
    assert main(line.format(**words, there=there).split()) == 2
    said = capsys.readouterr().err
    assert said == f"dehyst {line.split()[0]}: monday.csv: is a file, not a folder\n"
    assert sorted(Path().iterdir()) == before


@pytest.mark.parametrize("name", [b"bad\xff", "\u00fcbung\u202e".encode()])
def test_a_name_that_is_not_utf_8_is_written_escaped(
    name: bytes, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    one = read_recording(files["rec"])
    noisy = 0.1 * one.drive + np.random.default_rng(1).normal(0.0, 0.01, one.size)
    rec, model, trajectory, folder = (
        os.fsdecode(name + suffix) for suffix in (b".csv", b".toml", b"-t.csv", b"-found")
    )
    write_recording(rec, one.t_s, {"u_v": one.drive, "y_um": noisy})
    Path(trajectory).write_bytes(files["trajectory"].read_bytes())
    for line in (
        ["identify", rec, "-o", model, "--static", "--order", "3", "--report", folder, "--json"],
        ["validate", model, rec, "--report", folder, "--json"],
        ["simulate", model, rec, "-o", os.fsdecode(name + b"-s.npz"), "--json"],
        *(
            ["invert", model, trajectory, "-o", os.fsdecode(name + suffix), "--json"]
            for suffix in (b"-i.csv", b"-i.npz", b"-i.mcap")
        ),
    ):
        assert main(line) in (0, 1), line
        assert capsys.readouterr().out
    ((written, _),) = load_model(model).provenance.recordings
    assert written == printable(rec)
    assert json.loads(json_text({rec: [rec]})) == {in_utf8(rec): [in_utf8(rec)]}


@pytest.mark.parametrize("folder", ["there", "there/deeper"])
def test_a_place_that_cannot_be_made_is_told_in_one_line(
    folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "there").write_text("a file")
    assert main(["demo", "-o", str(tmp_path / folder)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said == [f"dehyst demo: {tmp_path / 'there'}: is a file, not a folder"]
