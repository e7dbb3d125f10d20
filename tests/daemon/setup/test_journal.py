"""The memory of a set-up: each step can be repeated, and the whole can be resumed."""

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from dehyst.daemon.setup import sequence
from dehyst.daemon.setup.journal import Journal
from dehyst.daemon.setup.names import NAMES
from dehyst.daemon.setup.questions import UserPrompts, Wishes
from dehyst.daemon.setup.steps import STEPS, Step
from dehyst.daemon.setup.workbench import MADE, Workbench
from dehyst.models.errors import BadInput, NotNow


class Desk:
    """Three simulated steps; records which were done and what was reported."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.did, self.said = folder, list[str](), list[str]()
        self.broken = ""

        def make(name: str, options: tuple[str, ...], moves: bool) -> Step:
            def run(bench: Workbench) -> dict[str, Any]:
                if name == self.broken:
                    raise NotNow(f"{name} does not work")
                self.did.append(name)
                return {"words": f"x: {name} is done\ny: {name} is done"}

            return Step(name, f"the {name}", run, options, (lambda b: "far") if moves else None)

        steps = (
            make("units", ("ports",), False),
            make("limits", ("range_v",), False),
            make("record", ("band_hz",), True),
        )
        monkeypatch.setattr(sequence, "STEPS", steps)
        monkeypatch.setattr(sequence, "NAMES", tuple(step.name for step in steps))

    def go(self, answers: str | None = None, **wishes: Any) -> list[str]:
        """Run the set-up once; return the steps that were done. answers: typed; None: --yes."""
        self.did.clear()
        first = wishes.pop("first", None)
        asking = UserPrompts(answers is None, Console(file=io.StringIO()))
        if answers is not None:
            asking = UserPrompts(False, Console(file=io.StringIO()), io.StringIO(answers))
        journal = Journal(self.folder)
        bench = Workbench(self.folder, Wishes(**wishes), journal, asking, self.said.append)
        sequence.do_steps(bench, first)
        return list(self.did)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    return Desk(tmp_path, monkeypatch)


def test_what_is_done_is_not_done_again_unless_it_is_asked_for(desk: Desk) -> None:
    assert desk.go(range_v=(0.0, 100.0)) == ["units", "limits", "record"]
    assert desk.said[-2:] == ["   x: record is done", "   y: record is done"]
    assert desk.go(range_v=(0.0, 100.0)) == []
    assert desk.said[-1].endswith(": x: record is done; y: record is done")
    assert desk.go() == []
    assert desk.go(first="limits") == ["limits", "record"]


def test_an_option_of_another_value_repeats_the_steps_that_use_it_and_those_after(
    desk: Desk,
) -> None:
    desk.go(range_v=(0.0, 100.0), ports=("a", "b"))
    assert desk.go(band_hz=3.0) == ["record"]
    assert desk.go(band_hz=3.0) == []
    assert desk.go(range_v=(0.0, 90.0)) == ["limits", "record"]
    assert desk.go(ports=("b", "a")) == ["units", "limits", "record"]


def test_it_goes_on_where_it_failed(desk: Desk) -> None:
    desk.broken = "limits"
    with pytest.raises(NotNow, match="limits does not work"):
        desk.go()
    assert desk.did == ["units"]
    desk.broken = ""
    assert desk.go() == ["limits", "record"]
    assert any("done 20" in line and "units is done" in line for line in desk.said)


def test_a_step_that_moves_says_how_far_and_asks_first(desk: Desk) -> None:
    with pytest.raises(NotNow, match="ended before record; the same command resumes there"):
        desk.go("n\n")
    assert desk.did == ["units", "limits"]
    assert desk.said[-1].strip() == "far"
    assert desk.go("y\n") == ["record"]


def test_the_table_has_the_names_of_the_command_line() -> None:
    assert tuple(step.name for step in STEPS) == NAMES
    moving = [step.name for step in STEPS if step.moves is not None]
    assert moving == ["exercise", "record", "validate", "track"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"format": 2, "steps": {}}',
        '{"format": 1}',
        '{"format": 1, "steps": {"units": 3}}',
    ],
)
def test_a_damaged_journal_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "setup.json").write_text(text)
    with pytest.raises(BadInput, match="delete it to start again"):
        Journal(tmp_path)


def test_no_voltage_is_taken_for_granted() -> None:
    with pytest.raises(BadInput, match="--range"):
        UserPrompts(True, Console()).number("highest voltage", "--range", 0.0, 150.0)
    asked = UserPrompts(False, Console(file=io.StringIO()), io.StringIO("many\n200\n90\n"))
    assert asked.number("highest voltage", "--range", 0.0, 150.0) == 90.0


def test_the_users_own_configuration_stays_and_what_setup_wrote_is_put_aside(
    tmp_path: Path,
) -> None:
    bench = Workbench(tmp_path, Wishes(), Journal(tmp_path), UserPrompts(True, Console()), print)
    assert not bench.has_own_config()
    bench.config_path.write_text(MADE + "x = 1\n")
    assert not bench.has_own_config()
    assert bench.put_aside(bench.config_path, MADE + "x = 1\n") is None
    assert bench.put_aside(bench.config_path, MADE + "x = 2\n") == tmp_path / "stage-1.toml"
    assert (tmp_path / "stage-1.toml").read_text() == MADE + "x = 1\n"
    bench.config_path.write_text("x = 3\n")
    assert bench.has_own_config()


@pytest.mark.parametrize(
    ("folder", "wished", "name"),
    [
        ("left", None, "left"),
        ("Left", None, "left"),
        ("left", "right", "right"),
        ("my stage", None, "stage-1"),
        ("x" * 64, None, "stage-1"),
    ],
)
def test_each_folder_is_a_controller_of_its_own(
    tmp_path: Path, folder: str, wished: str | None, name: str
) -> None:
    asking = UserPrompts(True, Console(file=io.StringIO()))
    path = tmp_path / folder
    path.mkdir()
    bench = Workbench(path, Wishes(name=wished), Journal(path), asking, print)
    assert bench.name == name
    assert (f"the controller's name is stage-1, because {folder!r}" in bench.name_in_words) == (
        name == "stage-1"
    )
