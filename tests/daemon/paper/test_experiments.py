"""The paper's experiments: drives as printed, the verdict, and one fit that reaches the paper."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dehyst.daemon.paper import experiments
from dehyst.daemon.paper.experiments import EXPERIMENTS, PERIOD_S, Result, run_all
from dehyst.daemon.paper.report import pictures, table
from dehyst.daemon.paper.stages import bouc_wen


@pytest.fixture(scope="module")
def results() -> list[Result]:
    return run_all(shorten=0.3, stages=("Eq. 11",))


def test_every_drive_starts_de_energised_and_stays_in_the_range() -> None:
    for one in EXPERIMENTS:
        u = one.drive(experiments.times(one.seconds))
        assert u[0] == 0.0
        assert u.min() >= 0.0
        assert u.max() <= 10.0 + 1e-9


def test_the_sweep_ends_at_20_hz() -> None:
    u = experiments.sweep(experiments.times(10.0))[-2000:] - 0.5 * experiments.SWEEP_V
    crossings = np.flatnonzero(np.diff(np.sign(u)))
    assert 0.5 / np.mean(np.diff(crossings[-5:]) * PERIOD_S) == pytest.approx(20.0, rel=0.03)


def test_static_figures_of_the_paper_are_reached_on_eq_11(results: list[Result]) -> None:
    counted = [r for r in results if r.counts]
    assert [r.experiment.figure for r in counted] == ["3", "5", "6"]
    assert all(r.reached for r in counted), table(results)


def test_noise_is_part_of_the_error(results: list[Result]) -> None:
    for r in results:
        assert np.std(1e3 * (r.measured - r.predicted)) > 0.8 * experiments.NOISE_NM


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
    y = bouc_wen(u, PERIOD_S)
    up, down = y[1250], y[1750]  # the same drive of the second period, rising and falling
    assert u[1250] == pytest.approx(u[1750])
    assert down - up > 0.5
    assert bouc_wen(u[::2], 2 * PERIOD_S)[625] == pytest.approx(up, abs=0.02)
