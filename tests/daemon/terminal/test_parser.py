"""An error names what was typed; every number is one, and a file's name is no folder's."""

import argparse
from pathlib import Path

import pytest
from tests.rigs.command_line import exit_status

from dehyst.daemon.main import COMMANDS, build_whole_parser
from dehyst.daemon.terminal.parser import FILE_WORDS, OUTPUTS, Parser

WHOLE = build_whole_parser()


def options_of(command: str) -> list[argparse.Action]:
    return [a for a in WHOLE.commands[command]._actions if a.option_strings and a.nargs != 0]


def metavars(action: argparse.Action) -> list[str]:
    given = action.metavar
    return list(given) if isinstance(given, tuple) else [given or ""]


def said_of(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that is refused; return its line."""
    assert exit_status(words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said.removeprefix(f"dehyst {words[0]}: ").removesuffix("\n")


NAMED_TWICE = [
    (command, name)
    for command in COMMANDS
    for action in options_of(command)
    for name in action.option_strings
    if len(action.option_strings) > 1
]


@pytest.mark.parametrize(("command", "name"), NAMED_TWICE)
def test_an_error_names_the_option_that_was_typed(
    command: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_of([command, name], capsys)
    assert said.startswith(f"argument {name}: expected ")


@pytest.mark.parametrize(
    ("typed", "named"),
    [
        ("--rate-hz -5", "--rate-hz -5"),
        ("--rate-hz=-5", "--rate-hz -5"),
        ("--rate-h -5", "--rate-hz -5"),
        ("--rate -5", "--rate -5"),
        ("--rate=-5", "--rate -5"),
        ("--rate nan", "argument --rate: 'nan' is not a finite number"),
        ("--rate-hz nan", "argument --rate-hz: 'nan' is not a finite number"),
    ],
)
@pytest.mark.parametrize("command", ["identify", "simulate"])
def test_a_value_that_is_refused_later_is_named_as_typed(
    command: str, typed: str, named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{i},{i}\n" for i in range(100))
    (tmp_path / "run.csv").write_text("u_v,y_um\n" + rows)
    models = ["paper-eq11"] if command == "simulate" else []
    words = [command, *models, str(tmp_path / "run.csv"), "-o", str(tmp_path / "out.toml")]
    assert said_of([*words, *typed.split()], capsys).startswith(named)


def test_an_argument_of_a_function_is_named_as_the_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "excite",
        "--range",
        "0",
        "75",
        "--band",
        "5",
        "--duration",
        "10",
        "--sines",
        "1",
        "-o",
    ]
    said = said_of([*words, str(tmp_path / "drive.csv")], capsys)
    assert said == "--sines: 2 to 8, not 1"


NUMBERS = [
    (command, action.option_strings[-1], action)
    for command in COMMANDS
    for action in options_of(command)
    if action.type in (float, int)
]


@pytest.mark.parametrize(
    ("command", "name", "action"), NUMBERS, ids=[f"{c} {n}" for c, n, _ in NUMBERS]
)
@pytest.mark.parametrize("value", ["nan", "inf", "1e300", "8um", "9" * 5000])
def test_every_number_of_every_command_is_a_usable_one(
    command: str,
    name: str,
    action: argparse.Action,
    value: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    count = action.nargs if isinstance(action.nargs, int) else 1
    said = said_of([command, name, *[value] * count], capsys)
    assert said.startswith(f"argument {name}: ")
    assert len(said) < 250
    assert any(words in said for words in ("is not a", "is larger than"))


FILES = [
    (command, action.option_strings[-1], metavars(action))
    for command in COMMANDS
    for action in options_of(command)
    if any(FILE_WORDS.fullmatch(word) for word in metavars(action))
]


@pytest.mark.parametrize(("command", "name", "values"), FILES)
def test_a_file_has_no_name_of_a_folder(
    command: str, name: str, values: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_of([command, name, *["models/"] * len(values)], capsys)
    assert said.startswith(f"argument {name}: 'models/' ends with a slash")


WRITTEN = [
    (command, action.option_strings[-1])
    for command in COMMANDS
    for action in options_of(command)
    if action.dest in OUTPUTS and FILE_WORDS.fullmatch(metavars(action)[0])
]


@pytest.mark.parametrize(("command", "name"), WRITTEN)
def test_the_folder_of_an_output_is_looked_for_before_any_work(
    command: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = said_of([command, name, str(tmp_path / "none" / "out.csv")], capsys)
    assert said.startswith(f"argument {name}: ")
    assert f" is in a folder that does not exist: {tmp_path / 'none'}; see" in said


def test_a_folder_that_may_not_be_written_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write everywhere
    said = said_of(["record", "-o", str(tmp_path / "out.csv")], capsys)
    assert f" is in a folder that you may not write to: {tmp_path}; see" in said


def test_an_output_in_the_working_directory_has_a_folder(tmp_path: Path) -> None:
    parser = Parser()
    parser.add_argument("-o", "--output", metavar="OUT.csv")
    assert parser.parse_args(["-o", "out.csv"]).output == "out.csv"


def test_every_output_is_a_file_or_a_folder() -> None:
    """So that no new option escapes the test above."""
    for command in COMMANDS:
        for action in options_of(command):
            if "--output" in action.option_strings:
                (word,) = metavars(action)
                assert FILE_WORDS.fullmatch(word) or word == "DIR", f"{command} {word}"


def test_the_folder_of_a_report_may_end_with_a_slash() -> None:
    parser = Parser()
    parser.add_argument("--report", type=Path, metavar="DIR")
    assert parser.parse_args(["--report", "findings/"]).report == Path("findings")


def test_a_file_that_is_called_like_an_option_is_no_option() -> None:
    parser = Parser()
    parser.add_argument("--model")
    parser.typed = ["model"]
    assert parser.as_typed("model: cannot be read") == "model: cannot be read"
    parser.typed = []
    assert parser.as_typed("model: cannot be read") == "--model: cannot be read"
