"""The paper's experiments: drives as printed, the verdict, and one fit that reaches the paper."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dehyst.daemon.paper import experiments
from dehyst.daemon.paper.deviations import DEVIATIONS
from dehyst.daemon.paper.experiments import EXPERIMENTS, PERIOD_S, Result, run_experiments
from dehyst.daemon.paper.report import maximum_says, paper_table, pictures
from dehyst.daemon.paper.stages import bouc_wen_stage

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def results() -> list[Result]:
    return run_experiments(shorten=0.3, stages=("Eq. 11",))


def test_every_drive_starts_de_energised_and_stays_in_the_range() -> None:
    for one in EXPERIMENTS:
        u = one.drive(experiments.times(one.seconds))
        assert u[0] == 0.0
        assert u.min() >= 0.0
        assert u.max() <= 10.0 + 1e-9


def test_the_sweep_ends_at_20_hz() -> None:
    u = experiments.linear_sweep(experiments.times(10.0))[-2000:] - 0.5 * experiments.SWEEP_V
    crossings = np.flatnonzero(np.diff(np.sign(u)))
    assert 0.5 / np.mean(np.diff(crossings[-5:]) * PERIOD_S) == pytest.approx(20.0, rel=0.03)


def test_static_figures_of_the_paper_are_reached_on_eq_11(results: list[Result]) -> None:
    counted = [r for r in results if r.counts]
    assert [r.experiment.figure for r in counted] == ["3", "5", "6"]
    assert all(r.reached for r in counted), paper_table(results)


def test_noise_is_part_of_the_error(results: list[Result]) -> None:
    for r in results:
        left = 1e3 * (r.predicted - r.measured)
        assert np.std(left) > 0.8 * experiments.NOISE_NM
        judged = left[r.t_s >= r.t_s[-1] - 1.0] if len(r.experiment.paper) == 1 else left
        assert (r.mean, r.std) == (pytest.approx(judged.mean()), pytest.approx(judged.std()))


@pytest.mark.parametrize("change", [{"std": 1e3}, {"mean": 1e3}, {"mean": -1e3}])
def test_a_greater_error_is_not_reached(results: list[Result], change: dict[str, Any]) -> None:
    assert not replace(results[0], **change).reached


def test_the_maximum_alone_decides_on_the_sweep(results: list[Result]) -> None:
    assert replace(results[-1], maximum=94.0, std=1e3).reached
    assert not replace(results[-1], maximum=95.0).reached


def test_every_figure_is_drawn(results: list[Result]) -> None:
    made = pictures(results)
    assert {f"eq11-figure-{n}.png" for n in "34567"} < set(made)
    assert all(png.startswith(b"\x89PNG") for png in made.values())


def test_the_bouc_wen_stage_has_a_rate_independent_loop() -> None:
    u = experiments.one_sine(experiments.times(2.0))
    y = bouc_wen_stage(u, PERIOD_S)
    up, down = y[1250], y[1750]  # the same drive in the second period, rising and falling
    assert u[1250] == pytest.approx(u[1750])
    assert down - up > 0.5
    assert bouc_wen_stage(u[::2], 2 * PERIOD_S)[625] == pytest.approx(up, abs=0.02)


def test_the_inverse_is_judged_on_rows_that_can_be_reached(results: list[Result]) -> None:
    for r in results:
        error = 1e3 * (r.target - r.tracked)
        assert r.tracking_rms == pytest.approx(np.sqrt(np.mean(error[r.reachable] ** 2)))
        assert r.whole_rms == pytest.approx(np.sqrt(np.mean(error**2)))
        assert r.reachable.mean() > 0.75
    sine = results[0]  # after its rise the stage does not return to 0 um at 0 V
    assert not sine.reachable[sine.target < 0.2][-1]
    assert sine.tracking_rms < 0.5 * sine.whole_rms


def test_the_noise_alone_stands_apart_from_the_model(results: list[Result]) -> None:
    for r in results:
        assert 2.5 * experiments.NOISE_NM < r.noise_maximum < 5.5 * experiments.NOISE_NM
        assert r.maximum <= r.true_maximum + r.noise_maximum + 1e-9


def test_what_the_sweep_is_made_of_is_said_where_it_counts(results: list[Result]) -> None:
    sweep = results[-1]
    assert maximum_says(sweep) == ""  # Eq. 11: not relevant there
    says = maximum_says(replace(sweep, stage="Eq. 12", maximum=133.4, noise_maximum=85.2))
    assert "133 nm" in says
    assert "85 nm" in says


def test_the_deviations_are_those_of_the_page() -> None:
    text = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8").replace("`", "")
    head, rows = DEVIATIONS
    for cells in (head, *rows):
        assert f"| {' | '.join(cells)} |" in text
