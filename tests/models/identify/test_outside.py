"""Recordings outside of the model's class are refused with a reason, and ordinary ones are not;
dynamics are claimed only if the recordings show two rates."""

import numpy as np
import pytest
from tests.rigs.outside import (
    beside_drift,
    lagged,
    linear,
    noisy,
    ordinary,
    outside,
    plays,
    stage,
    staircase,
    times,
)

from dehyst.models.cascade.simulate import simulate
from dehyst.models.errors import BadRecording
from dehyst.models.identify import identify
from dehyst.models.recording import Recording

OUTSIDE = outside()
REASONS = {
    "butterfly": "butterfly", "square butterfly": "butterfly",
    "switching within": "in .* jumps|loop is", "switching": "loop is",
    "square friction": "loop is", "square wave": "only jumps between",
    "dry": "loop is", "one way": "only goes", "nothing": "follow",
    "another": "follow|another input", "twice": "butterfly|follow", "open": "follow",
    "friction ahead": "jumps by|another input", "stick-slip": "in .* jumps|another input",
    "gauge disconnected": "follow", "drive unconnected": "follow", "gauge turned": "follow",
    "drive is": "same signal", "gauge at": "another input", "backlash": "loop is",
}  # fmt: skip


@pytest.mark.parametrize("kind", OUTSIDE)
def test_outside_of_the_class_is_refused_with_its_reason(kind: str) -> None:
    words = next(words for begin, words in REASONS.items() if kind.startswith(begin))
    with pytest.raises(BadRecording, match=words) as error:
        identify([OUTSIDE[kind]])
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500


@pytest.mark.parametrize("seed", range(6))
def test_an_ordinary_recording_is_not_refused(seed: int) -> None:
    found = identify([ordinary(seed)])
    assert found.model.fit.rms is not None
    if found.model.fit.band is not None:
        v = found.model.validity
        assert found.model.fit.band < 0.13 * (v.drive_max - v.drive_min) * 1.3


def test_a_stage_without_hysteresis_is_taken_and_named() -> None:
    found = identify([linear()])
    assert any("no hysteresis" in note for note in found.notes)
    assert not any("run back" in note for note in found.notes)


@pytest.mark.parametrize("seed", range(3))
def test_a_loop_narrower_than_the_noise_of_a_reading_shows_in_many(seed: int) -> None:
    """The loop is two thirds as wide as the noise; without it, as many rows show none."""
    t = times(12.0)
    u = 50.0 - 50.0 * np.cos(2 * np.pi * 0.5 * t)
    noise = 0.12 * np.random.default_rng(seed).standard_normal(t.size)
    for weight in (0.004, 0.0):
        y = 0.12 * u + weight * plays(u, np.array([10.0]), np.ones(1)) + noise
        found = identify([type(linear())(t, u, y)])
        assert any("no hysteresis" in note for note in found.notes) == (not weight)


def test_a_drive_that_rests_for_most_of_the_time_is_ordinary() -> None:
    t = times(6.0)
    u = np.where(t < 3.6, 0.0, 80.0 * np.sin(2 * np.pi * 5.0 * t) * (t - 3.6) / 2.4)
    one = type(linear())(t, u, noisy(stage(u), 0), name="rests.csv")
    found = identify([one])
    assert found.model.fit.rms == pytest.approx(found.noise_rms, rel=0.2)


@pytest.mark.parametrize("start", [0.0, 0.25, 0.4])
@pytest.mark.parametrize("cycles", [2.0, 3.0, 6.5])
def test_one_loop_from_anywhere_gives_a_static_model(start: float, cycles: float) -> None:
    t = times(cycles / 1.5)
    u = 50 + 50 * np.sin(2 * np.pi * (1.5 * t + start))
    found = identify([type(linear())(t, u, noisy(stage(u, 3), 3), name="loop.csv")])
    assert not found.shape.rate
    assert found.model.blocks == ()


@pytest.mark.parametrize("tau_s", [0.0, 0.02])
def test_one_slow_loop_gives_a_static_model_and_says_so(tau_s: float) -> None:
    found = identify(lagged(1, (1.0,), tau_s))
    assert not found.shape.rate
    assert found.model.blocks == ()
    assert any("one loop at one rate" in note for note in found.notes)


@pytest.mark.parametrize("seed", [0, 1, 2, 6, 9, 11])
def test_a_drift_beside_a_drive_of_one_period_gives_no_dynamics(seed: int) -> None:
    found = identify([beside_drift(seed, 0.0)])
    assert not found.shape.rate
    assert found.model.blocks == ()


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_a_straight_drift_is_no_part_of_the_model(seed: int) -> None:
    one = ordinary(seed)
    size = float(np.ptp(one.displacement))
    ramp = 0.03 * size * one.t_s / one.t_s[-1]
    found = identify([type(one)(one.t_s, one.drive, one.displacement + ramp)])
    (said,) = [note for note in found.notes if "drifts" in note]
    assert float(said.split(" by ")[1].split()[0]) == pytest.approx(0.03 * size, rel=0.05)
    known = ~np.isnan(one.drive)
    t, u = one.t_s[known], one.drive[known]
    clean = identify([one]).model
    assert found.model.fit.band == pytest.approx(clean.fit.band, rel=0.25)
    moved = simulate(found.model, t, u) - simulate(clean, t, u)
    assert float(np.std(moved)) < 0.001 * size
    assert float(np.mean(moved)) == pytest.approx(0.03 * size, rel=0.1)


@pytest.mark.parametrize("wiggle", [4.0, 8.0, 15.0])
def test_a_slow_scan_with_a_fast_wiggle_is_no_drift(wiggle: float) -> None:
    """The offsets of the wiggle's periods run with the scan."""
    t = times(20.0)
    u = 100.0 * (1.0 - np.abs(t / 10.0 - 1.0)) + wiggle * np.sin(2 * np.pi * 2.0 * t)
    one = type(linear())(t, u, noisy(stage(u, 3), 3), name="scan.csv")
    found = identify([one])
    assert not any("drifts" in note for note in found.notes)
    assert found.model.fit.rms < 1.5 * found.noise_rms


def test_the_held_out_error_is_that_of_the_model_with_the_offset_of_the_end() -> None:
    one = ordinary(0)
    ramp = 0.05 * np.ptp(one.displacement) * one.t_s / one.t_s[-1]
    fit = identify([type(one)(one.t_s, one.drive, one.displacement + ramp)]).model.fit
    assert fit.holdout_rms > 0.95 * fit.rms


def test_a_lag_beside_a_drift_and_several_sizes_is_found() -> None:
    found = identify([beside_drift(1, 0.02)])
    assert [block.kind for block in found.model.blocks] == ["lag"]
    assert not any("is static" in note for note in found.notes)


@pytest.mark.parametrize("tau_s", [0.006, 0.015, 0.04])
def test_the_rests_of_a_staircase_show_a_lag_of_any_length(tau_s: float) -> None:
    found = identify([staircase(3, tau_s)])
    (block,) = found.model.blocks
    assert block.kind == "lag"
    assert block.params["tau_s"] == pytest.approx(tau_s, rel=0.2)
    assert found.used[0].all()  # also the rows after an edge


def test_two_rates_give_the_lag() -> None:
    found = identify(lagged(1, (0.5, 4.0), 0.02))
    (block,) = found.model.blocks
    assert block.kind == "lag"
    assert block.params["tau_s"] == pytest.approx(0.02, rel=0.15)
    assert not any("one loop at one rate" in note for note in found.notes)


def test_rows_that_were_left_out_are_simulated_and_reported() -> None:
    one = ordinary(0)
    y = one.displacement.copy()  # type: ignore[union-attr]
    wild = np.arange(100, y.size, 150)
    y[wild] += 0.3 * (y.max() - y.min())
    found = identify([type(one)(one.t_s, one.drive, y, name="wild.csv")])
    assert not found.used[0][wild].any()
    said = f"left out {wild.size} of {y.size} rows"
    assert any(said in note and "the model leaves" in note for note in found.notes)


@pytest.mark.parametrize("rms_um", [0.2, 0.5, 1.0, 2.0])
def test_pure_noise_is_no_butterfly(rms_um: float) -> None:
    t = np.arange(4000) * 2e-3
    size = np.where(t < 4, 1.0, np.where(t < 6, 0.6, 0.3))
    u = 50 - 50 * (2 * np.abs(2 * (t % 1) - 1) - 1) * size
    for seed in range(3):
        y = np.random.default_rng(seed).normal(0.0, rms_um, t.size)
        with pytest.raises(BadRecording, match="does not follow the drive"):
            identify([type(linear())(t, u, y, name="noise.csv")])


@pytest.mark.parametrize("rows", [60, 70])
def test_a_short_recording_that_moves_is_not_taken_for_jumps(rows: int) -> None:
    t = 0.02 * np.arange(rows)
    u = 50.0 - 50.0 * np.cos(2 * np.pi * t / 0.5) * (1.0 - 0.5 * t / t[-1])
    y = plays(u, np.array([0.0, 5.0, 15.0]), np.array([0.06, 0.03, 0.02]))
    noise = 0.01 * np.random.default_rng(rows).standard_normal(rows)
    assert identify([Recording(t, u, y + noise, name="a.csv")]).model.hysteresis.b.size
