"""Functions of `import dehyst` check their parameters, and name them where a command names its
options."""

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import dehyst
from dehyst.daemon.api import functions, results
from dehyst.daemon.called import python_function
from dehyst.daemon.main import main
from dehyst.daemon.option_words import PARAMETERS, at_command_line, in_python_words
from dehyst.models.errors import BadInput

ROOT = Path(__file__).parents[2]
ONLY_COMMANDS = {
    "unfinished", "separate", "range", "sampling", "duration", "unit", "rotate", "keep", "help"
}  # fmt: skip
"""Options of commands that no function has: a message that names one speaks of that command."""


@python_function
def work(
    data: Any = None,
    *,
    path: str | Path = "a.csv",
    count: int | None = None,
    length: float = 1.0,
    points: ArrayLike = (0.0,),
    names: tuple[str, str] = ("a", "b"),
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> tuple[Any, ...]:
    """A function as those of the API."""
    if count == 13:
        raise BadInput("run.csv: exists already; --force replaces it, --rate HZ counts the rows")
    return data, path, count, length, names, force, progress, points


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"count": 1.5}, "count=1.5: must be a whole number, or None"),
        ({"count": True}, "count=True: must be a whole number, or None"),
        ({"count": "3"}, "count='3': must be a whole number, or None"),
        ({"length": "1"}, "length='1': must be a number"),
        ({"length": None}, "length=None: must be a number"),
        ({"points": ["a", "b"]}, "points=['a', 'b']: must be numbers, one for each point"),
        ({"points": 5.0}, "points=5.0: must be numbers"),
        ({"points": [1, 2j]}, "points=[1, 2j]: must be numbers"),
        ({"names": "ab"}, "names='ab': must be two strings, such as ('v', 'um')"),
        ({"names": ("a",)}, "names=('a',): must be two strings"),
        ({"force": 1}, "force=1: must be True or False"),
        ({"progress": 3}, "progress=3: must be a function, or None"),
        ({"path": 3}, "path=3: must be a string, or a path"),
        ({"path": "models/"}, "path='models/': ends with a slash, as the name of a folder does"),
        ({"length": "x" * 1000}, "length='xxxx"),
    ],
)
def test_a_wrong_type_is_bad_input_that_names_the_parameter(given: dict, says: str) -> None:
    with pytest.raises(BadInput) as refused:
        work(**given)
    assert str(refused.value).startswith(says)
    assert len(str(refused.value)) < 120


def test_numbers_of_numpy_are_numbers() -> None:
    done = work(count=np.int64(3), length=np.float32(0.5), force=np.bool_(True))
    assert done[2:6] == (3, 0.5, ("a", "b"), True)
    assert work(length=2)[3] == 2
    assert work(length=np.array(2.5))[3] == 2.5


def test_an_unknown_parameter_is_an_error_of_python() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'cuont'"):
        work(cuont=3)  # type: ignore[call-arg]


def test_every_function_and_result_is_one_that_checks() -> None:
    for name in ("load_recording", "load_model", "identify", "simulate", "invert", "diagnose"):
        assert hasattr(getattr(functions, name), "__wrapped__"), name
    for kind in (dehyst.Client, dehyst.Group):
        for name in ("__init__", "send", "hold", "play", "wait_until_started"):
            assert hasattr(getattr(kind, name), "__wrapped__"), f"{kind.__name__}.{name}"
    for _, kind in inspect.getmembers(results, inspect.isclass):
        for name in {"save", "report"} & vars(kind).keys():
            assert hasattr(vars(kind)[name], "__wrapped__"), f"{kind.__name__}.{name}"


def test_a_message_names_options_to_a_command_and_parameters_to_python() -> None:
    with pytest.raises(BadInput, match=r"force=True replaces it, rate_hz=HZ counts the rows"):
        work(count=13)
    with at_command_line(), pytest.raises(BadInput, match=r"--force replaces it, --rate HZ"):
        work(count=13)


def test_a_command_speaks_of_options_and_afterwards_python_of_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rec, out = tmp_path / "run.csv", tmp_path / "out.csv"
    rec.write_text("t_s,u_v\n" + "".join(f"{0.1 * i},{0.1 * i}\n" for i in range(50)))
    out.write_text("mine")
    assert main(["simulate", "paper-eq11", str(rec), "-o", str(out)]) == 2
    assert "--force replaces it" in capsys.readouterr().err
    with pytest.raises(BadInput, match="force=True replaces it"):
        dehyst.simulate("paper-eq11", rec).save(out)
    assert out.read_text() == "mine"


@pytest.mark.parametrize(
    ("said", "function", "python"),
    [
        ("or --force replaces it", "save", "or force=True replaces it"),
        ("--start nan: not a drive", "invert", "start=nan: not a drive"),
        ("--min 5: must be below --max, -3e+04", "invert", "low=5: must be below high, -3e+04"),
        ("give --period to resample", "invert", "give period to resample"),
        (
            "fix one with --static --saturation 1",
            "identify",
            "fix one with rate=False saturation=1",
        ),
        ("add --time-unit s, ms or us", "load_recording", 'add time_unit="s", "ms" or "us"'),
        ("add --rate HZ", "identify", "add rate_hz=HZ (of dehyst.load_recording)"),
        (
            '--columns t=0,y="Weg (um)" names it',
            "load_recording",
            "columns='t=0,y=\"Weg (um)\"' names it",
        ),
        (
            "add --drive-unit and --unit, the unit of the numbers",
            "load_recording",
            "add drive_unit and unit, the unit of the numbers",
        ),
        ("record with --rotate", "identify", "record with --rotate"),
    ],
)
def test_the_words_of_python(said: str, function: str, python: str) -> None:
    assert in_python_words(said, function) == python


def _texts() -> Iterator[tuple[str, str]]:
    """Yield (file, text) of what the code below the commands may say."""
    rooms = ("models", "daemon/api", "daemon/files")
    for room in rooms:
        for file in sorted((ROOT / room).rglob("*.py")):
            tree = ast.parse(file.read_text())
            said = {
                id(ast.get_docstring(node, clean=False))
                for node in ast.walk(tree)
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
            }
            for node in ast.walk(tree):
                plain = isinstance(node, ast.Constant) and isinstance(node.value, str)
                if plain and id(node.value) not in said:
                    yield str(file.relative_to(ROOT)), node.value


def test_every_option_that_a_message_names_has_a_parameter_or_is_a_command_alone() -> None:
    seen = 0
    for file, text in _texts():
        for option in re.findall(r"(?<![\w-])--([a-z]+(?:-[a-z]+)*)", text):
            seen += 1
            assert option in PARAMETERS or option in ONLY_COMMANDS, f"{file}: {text}"
    assert seen > 50
