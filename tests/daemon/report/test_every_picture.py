"""Every picture of every report, on recordings that show nothing: constant, zero, NaN, one row,
tiny and huge. The functions are found by their signature, so a new one is included
automatically."""

import importlib
import inspect
import pkgutil
import typing
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tests.rigs.stage_model import kept_model

import dehyst.daemon.report
from dehyst.daemon.report import diagnosis_pictures
from dehyst.daemon.report.diagnosis import report_diagnosis
from dehyst.daemon.report.plotting import Draw, draw_picture, draw_rows, draw_side_by_side
from dehyst.daemon.report.story import (
    StoryData,
    draw_story_bands,
    list_close_looks,
    story_picture,
)
from dehyst.daemon.report.tracking import Track
from dehyst.models.diagnosis import Diagnosis, FitView
from dehyst.models.diagnosis.result import DataQuality
from dehyst.models.drive_design.coverage import Coverage
from dehyst.models.identify import Identification
from dehyst.models.identify.equations import Params, Shape
from dehyst.models.identify.structure import TriedStructure
from dehyst.models.identify.validation import Validation
from dehyst.models.learning.passes import Outcome
from dehyst.models.recording import Floats, Recording

FAILED = "could not be drawn"
ROWS = 400
RNG = np.random.default_rng(3)
LIVELY = np.sin(0.1 * np.arange(ROWS)) + RNG.normal(0.0, 0.01, ROWS)
SHAPES: dict[str, Floats] = {
    "lively": LIVELY,
    "zero": np.zeros(ROWS),
    "constant": np.full(ROWS, 3.7),
    "nan": np.full(ROWS, np.nan),
    "one row": np.array([2.0]),
    "tiny": 1e-14 * LIVELY,
    "huge": 1e14 * LIVELY,
    "vast": 1e100 * LIVELY,
    "one spike": np.where(np.arange(ROWS) == 200, 1e9, 0.0),
}


def pictures() -> dict[str, Callable[..., str]]:
    """Return all functions of the reports that draw on axes and describe the picture."""
    found = {}
    for module in pkgutil.iter_modules(dehyst.daemon.report.__path__):
        inside = importlib.import_module(f"dehyst.daemon.report.{module.name}")
        for name, one in inspect.getmembers(inside, inspect.isfunction):
            hints = typing.get_type_hints(one)
            draws_itself = hints.get("axes") is Axes and hints.get("return") is str
            own = one.__module__ == inside.__name__ and not {"words", "draw"} & hints.keys()
            if draws_itself and own:
                found[f"{module.name}.{name}"] = one
    return found


PICTURES = pictures()


def world(y: Floats, begin_s: float = 0.0) -> dict[Any, Any]:
    """Return the arguments of pictures by type, where everything that was measured is y, from
    begin_s on."""
    n = y.size
    t_s = begin_s + 0.005 * np.arange(n)
    used: NDArray[np.bool_] = np.ones(n, bool)
    model = kept_model()
    few = np.resize(y, model.hysteresis.n)
    view = FitView("rest.csv", t_s, y, y, y * 0.9, y * 0.99, used, used)
    diagnosis = Diagnosis(
        verdict="partly", data=DataQuality(n, 0, 0), noise=float(abs(y[0])), unit="um",
        drive_unit="v", findings=(), would_have_seen=(), rms={}, next_experiment="", model=model,
        base_model=model, views=(view,), locate={},
    )  # fmt: skip
    tried = TriedStructure(
        Shape(False, ()), 0.0, y**2, y**2, np.ones(n), True, Params(few, few[:1], few[:0]), 1.0
    )
    result = Identification(
        model=model, residuals=(0.1 * y,), used=(used,), shape=Shape(False, ()),
        params=Params(few, few[:1], few[:0]), errors=Params(np.abs(few), few[:1], few[:0]),
        rates=few, at_bound=few > 1e99, tried=(tried,),
        orders=((4, float(y[0])), (8, float(y[-1]))), noise_rms=float(abs(y[0])), recordings=(),
        chosen=tried,
    )  # fmt: skip
    lags = np.resize(y, 20)
    story = SimpleNamespace(
        t_s=t_s, target=y, measured=0.9 * y, appeared_s=0.1, flagged_s=0.3, reported_s=np.nan,
        accepted_s=np.nan, over_s=np.nan, state="", rms={"before": float(y[0])},
    )  # fmt: skip
    return {
        Diagnosis: diagnosis, FitView: view, Identification: result,
        Recording: Recording(t_s, y, y), StoryData: story,
        Validation: Validation("rest.csv", "um", 0.1, 0.0, 1.0, 0.1, None, "", y, lags[1:], lags,
                               float(y[0]), 0.0, 0.0, None, 0),
        Coverage: Coverage(np.abs(np.resize(y, (4, 4))), np.arange(5.0), np.arange(5.0),
                           np.abs(y), 0.1, 0.0, 0.0, 1.0, (), ()),
        Sequence[Outcome]: [Outcome(k, float(v), 0.0, k % 2 == 0, "", 1.0, 1.0)
                            for k, v in enumerate(y[:9])],
        Track: Track("linear", t_s, y, y), Floats: y, str: "um", slice: slice(0, n),
        tuple[float, float]: (float(y[0]), float(y[-1])), float: 0.005, int: 0,
        NDArray[np.bool_]: used,
    }  # fmt: skip


def draws(name: str, y: Floats, begin_s: float = 0.0) -> Draw:
    """Return the picture with its arguments bound."""
    one, known = PICTURES[name], world(y, begin_s)
    wanted = {k: v for k, v in typing.get_type_hints(one).items() if k not in ("axes", "return")}
    given = {k: known[v] for k, v in wanted.items()}
    if "color" in given:
        given["color"] = "#333333"
    if "edges" in given:
        given["edges"] = np.linspace(0.0, 1.0, 5)
    return lambda axes: one(**given, axes=axes)


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_picture_of_a_recording_that_shows_little_is_drawn(name: str, shape: str) -> None:
    png, shows = draw_picture(draws(name, SHAPES[shape]))
    assert png.startswith(b"\x89PNG")
    assert FAILED not in shows


@pytest.mark.parametrize("name", PICTURES)
def test_each_line_of_a_picture_is_seen_when_the_recording_begins_late(name: str) -> None:
    axes = Figure().subplots()
    draws(name, LIVELY, 70.0)(axes)
    for line in axes.lines:
        if line.get_transform().contains_branch(axes.transData):
            (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
            x, y = np.array(line.get_xdata(), float), np.array(line.get_ydata(), float)
            seen = (x >= left) & (x <= right) & (y >= low) & (y <= high)
            assert seen.any() or not np.isfinite(x + y).any(), line.get_label()


@pytest.mark.parametrize("shape", ["zero", "nan", "one row"])
def test_a_report_of_a_recording_that_shows_little_has_all_its_pictures(shape: str) -> None:
    known = world(SHAPES[shape])
    page = report_diagnosis(known[Diagnosis], ["rest.csv"])
    assert FAILED not in page
    assert page.count("<img") == 11


def broken(axes: Axes) -> str:
    """Fail after part of the picture has been drawn."""
    axes.plot([0.0, 1.0], [0.0, 0.0])
    raise RuntimeError("no $room for <it>")


def broken_ticks(axes: Axes) -> str:
    """Fail where matplotlib computes the ticks, after this function has returned."""
    axes.xaxis.set_major_formatter(lambda _x, _pos: 1 / 0)  # type: ignore[arg-type, return-value]
    return "never seen"


def test_a_picture_that_fails_is_words_and_the_others_beside_it_are_drawn() -> None:
    def line(axes: Axes) -> str:
        axes.plot([0.0, 1.0], [0.0, 1.0])
        return "a line"

    png, shows = draw_picture(broken)
    assert png.startswith(b"\x89PNG")
    assert shows == "This picture could not be drawn: no $room for <it>"
    alone, pair = draw_side_by_side((line,), (1.0,)), draw_side_by_side((line, broken), (1.0, 1.0))
    assert pair.startswith(b"\x89PNG")
    assert len(pair) > len(alone)
    assert draw_picture(broken_ticks)[1].startswith("This picture could not be drawn: division")
    assert draw_rows([[broken, line], [line]]).startswith(b"\x89PNG")


def test_findings_are_in_the_report_where_no_picture_can_be_drawn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> str:
        raise MemoryError

    for name in ("draw_model_error", "draw_close_look", "draw_error_spectrum", "_draw_place"):
        monkeypatch.setattr(diagnosis_pictures, name, fails)
    page = report_diagnosis(world(LIVELY)[Diagnosis], ["rest.csv"])
    assert "Before and after" in page
    assert "This picture could not be drawn: MemoryError" in page


@pytest.mark.parametrize("shape", ["zero", "nan", "one row", "one spike"])
@pytest.mark.parametrize("state", ["", "returned"])
def test_the_story_is_drawn_however_it_ended_with_no_line_beyond_its_data(
    shape: str, state: str
) -> None:
    story = world(SHAPES[shape])[StoryData]
    story.state, story.reported_s, story.accepted_s, story.over_s = state, 1.0, 1.2, 99.0
    assert story_picture(story).startswith(b"\x89PNG")
    axes = Figure().subplots()
    draw_story_bands(story, axes)
    ends = [x for line in axes.lines for x in np.ravel(line.get_xdata())]
    assert all(story.t_s[0] <= x <= story.t_s[-1] for x in ends)


def pattern_story(state: str = "accepted") -> SimpleNamespace:
    """Return the story of a 4 s pattern that is followed 0.02 um off, then 0.3 um, then 0.03 um."""
    t_s = np.arange(0.0, 60.0, 0.01)
    target = 5.0 + 4.0 * np.sin(2 * np.pi * t_s / 4.0)
    off = np.where(t_s < 20.0, 0.02, np.where(t_s < 40.0, 0.3, 0.03))
    return SimpleNamespace(
        t_s=t_s, target=target, measured=target + off, appeared_s=20.0, flagged_s=22.0,
        reported_s=39.9, accepted_s=40.0, over_s=50.0, state=state, rms={},
    )  # fmt: skip


def test_the_bands_are_the_errors_and_the_axis_is_theirs() -> None:
    axes = Figure().subplots()
    shows = draw_story_bands(pattern_story(), axes)
    assert "before: 20 nm rms; with the effect: 300 nm rms; after: 30 nm rms" in shows
    low, high = axes.get_ylim()
    assert -1500.0 < low < -300.0
    assert 300.0 < high < 2500.0
    words = [text.get_text() for text in axes.texts]
    assert words == ["an effect appears", "flagged", "named, accepted", "confirmed"]


def test_a_jump_in_the_error_does_not_hide_the_bands() -> None:
    story = pattern_story()
    story.measured[2500] += 1000.0
    axes = Figure().subplots()
    draw_story_bands(story, axes)
    assert axes.get_ylim()[1] < 1e6


def test_the_axis_shows_the_largest_errors_of_a_phase_but_not_a_jump() -> None:
    story = pattern_story()
    rare = (story.t_s > 20.0) & (story.t_s < 39.0) & (story.t_s % 2.0 < 0.1)  # 5 % of them
    story.measured[rare] += 0.9
    axes = Figure().subplots()
    draw_story_bands(story, axes)
    assert axes.get_ylim()[0] < -1200.0
    story.measured[2500:2510] += 1000.0
    draw_story_bands(story, axes := Figure().subplots())
    assert axes.get_ylim()[0] > -1e6


def test_the_close_looks_show_the_same_second_and_are_distinguished() -> None:
    looks = list_close_looks(pattern_story())
    panels = [Figure().subplots() for _ in looks]
    assert [draw(axes)[:20] for draw, axes in zip(looks, panels, strict=True)] == [
        "One second, before: ", "One second, with the", "One second, after: t",
    ]  # fmt: skip
    targets = [axes.lines[0].get_ydata() for axes in panels]
    for other in targets[1:]:
        np.testing.assert_allclose(other, targets[0], atol=1e-6)
    low, high = panels[1].get_ylim()
    assert 0.05 * (high - low) < 0.3  # the effect is visible: a twentieth of the height or more


def test_a_second_in_which_samples_were_lost_is_not_looked_at_closely() -> None:
    """With the effect, samples are lost at each turn, where the error shows best."""
    story = pattern_story()
    changed = (story.t_s > 20.0) & (story.t_s < 40.0)
    lost = changed & (np.abs(story.t_s % 2.0 - 1.0) < 0.06)
    story.t_s, story.target, story.measured = (
        x[~lost] for x in (story.t_s, story.target, story.measured)
    )
    looks = list_close_looks(story)
    assert len(looks) == 3
    for draw in looks:
        axes = Figure().subplots()
        draw(axes)
        assert np.diff(axes.lines[0].get_xdata()).max() < 0.02


def test_a_trial_too_short_to_have_that_second_gets_no_close_look() -> None:
    story = pattern_story("trial")
    keep = story.t_s < 43.6
    story.t_s, story.target, story.measured = (
        x[keep] for x in (story.t_s, story.target, story.measured)
    )
    assert len(list_close_looks(story)) == 2


def test_a_phase_in_which_another_pattern_was_played_gets_no_close_look() -> None:
    story = pattern_story()
    other = np.where(story.t_s < 20.0, 30.0, 0.0)
    story.target, story.measured = story.target + other, story.measured + other
    said = [draw(Figure().subplots()) for draw in list_close_looks(story)]
    assert [words.split(":")[0] for words in said] == [
        "One second, with the effect", "One second, after",
    ]  # fmt: skip
