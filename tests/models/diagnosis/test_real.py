"""Rules learned from real recordings: harmonics are not hum, creep shows under feedback, a held
drive appears early, and other axes act through modes."""

import numpy as np
import pytest
from scipy import signal
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.hardware_stages import delay, make_rig, open_loop

from dehyst.daemon.api.prediction import predict
from dehyst.models.diagnosis.augment import build_augmented_model
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.diagnosed_model import THRESHOLDS, DiagnosedModel, fit_plain_model
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.held_out import make_held_out_groups
from dehyst.models.diagnosis.search_problem import choose_earlier_drive, choose_zero_order_hold
from dehyst.models.recording import Recording
from dehyst.models.signals.filters import lowpass, second_order
from dehyst.models.signals.holds import longest_hold
from dehyst.models.signals.lines import find_lines
from dehyst.models.signals.periodic import fundamental_hz

DT = 2e-3


NOISE = 0.01


def noise(n: int, size: float = NOISE) -> np.ndarray:
    return size * np.random.default_rng(8).standard_normal(n)


@pytest.mark.parametrize("f", [0.731, 1.0, 4.7])
def test_fundamental_of_a_repeating_drive(f: float) -> None:
    t = np.arange(8000) * DT
    u = np.sin(2 * np.pi * f * t) + 0.4 * np.cos(6 * np.pi * f * t)
    assert fundamental_hz(u, DT) == pytest.approx(f, rel=2e-4)
    assert fundamental_hz(multisine(t.size, 3), DT) == 0.0


def test_harmonics_of_the_drive_are_no_hum_but_mains_beside_them_is() -> None:
    t = np.arange(8000) * DT
    u = 5 + 4 * np.sin(2 * np.pi * t)
    data = prepare([Recording(t, u, u + noise(t.size))])
    harmonics = sum(np.sin(2 * np.pi * k * t + k) / k for k in range(2, 12))
    residual = noise(t.size) + 0.02 * harmonics
    assert find_lines(data, residual) == []
    with_mains = (
        residual + 0.01 * np.sin(2 * np.pi * 50.31 * t) + 0.01 * np.cos(2 * np.pi * 6.37 * t)
    )
    assert sorted(find_lines(data, with_mains)) == pytest.approx([6.37, 50.31], abs=0.02)
    assert find_lines(data, residual + 0.02 * np.sin(2 * np.pi * 50.0 * t)) == []  # on a multiple


def under_feedback(gain: float, late: float = 0.0) -> Recording:
    """Return a ramp down, then a hold of the reading; the drive climbs by log10 of t and a line."""
    t = np.arange(6000) * 5 * DT
    held = np.maximum(t - 2.0, 0.0)
    target = 50 - 10 * np.minimum(t, 2.0)
    creep = gain * np.log10(np.maximum(held, 0.02) / 0.02) + late * held
    drive = np.minimum(t, 2.0) * -10 + 50 + 20 * creep
    return Recording(t, drive, target + noise(t.size, 3e-3))


def test_creep_is_read_from_the_drive_under_feedback() -> None:
    found = longest_hold(prepare([under_feedback(0.015)]), 3e-3)
    assert found is not None
    assert found.gain == pytest.approx(0.015, rel=0.05)
    assert found.low < 0.015 < found.high


def test_a_drive_that_climbs_otherwise_is_no_creep() -> None:
    assert longest_hold(prepare([under_feedback(-0.015)]), 3e-3) is None  # along the last move
    assert longest_hold(prepare([under_feedback(0.0, 0.002)]), 3e-3) is None  # a straight line
    assert longest_hold(prepare([under_feedback(0.0)]), 3e-3) is None


def multisine(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    return sum(np.sin(2 * np.pi * (f * t + rng.random())) for f in (0.7, 2.3, 5.1, 11.0, 23.0))


def drive_is_earlier_by(u: np.ndarray, y: np.ndarray) -> float:
    """Return by how many samples the diagnosis assumes the drive to act earlier."""
    data = prepare([Recording(np.arange(u.size) * DT, u, y + noise(u.size))])
    problem = Problem(data, rich_base(data))
    found = choose_earlier_drive(problem, problem.solve([]), NOISE)
    return found.data.early if found is not None else 0.0


@pytest.mark.parametrize("samples", [0.5, 1.0, 0.0, -1.0])
def test_a_drive_is_moved_by_as_much_as_the_readings_lead(samples: float) -> None:
    t = np.arange(8001) * DT
    u = 5 + multisine(t.size, 1)
    y = np.interp(t + samples * DT, t, u)
    assert drive_is_earlier_by(u[:-1], y[:-1]) == max(samples, 0.0)


def test_a_row_before_is_a_row_before_for_drives_that_jump_too() -> None:
    t = np.arange(8001) * DT
    u = 5 + multisine(t.size, 1) + 0.3 * np.sign(np.sin(2 * np.pi * 9.0 * t))
    assert drive_is_earlier_by(u[:-1], u[1:]) == 1.0


def test_readings_a_row_early_are_a_fault_of_the_recorder_and_nothing_else() -> None:
    """The stage is of the model's class, so that nothing is left out once the rows are moved."""
    rig = make_rig(5, 3)
    assert (rig.kind, rig.foreign, rig.hidden) == ("early", False, ())
    d = diagnose_without_limits(rig.given)
    assert (d.verdict, d.findings) == ("clean", ())
    assert any("is recorded one row before" in words for words in d.data.says)
    leads = [b for b in d.base_model.blocks if b.kind == "lead"]
    assert [b.params["tau_s"] for b in leads] == [pytest.approx(1e-3)]
    left = rig.held.displacement - predict(d.base_model, rig.held).displacement
    assert np.std(left) < 0.5 * rig.noise
    assert "hold.csv" in d.rms["model"]  # its drive jumps
    assert max(d.rms["model"].values()) < 1.1 * rig.noise


@pytest.mark.parametrize("noise", [0.01, 0.02, 0.03])
def test_a_row_early_shows_where_it_hardly_exceeds_the_noise(noise: float) -> None:
    """A single slow waveform: with the largest noise, the early row adds a fifth of its power."""
    rng = np.random.default_rng([77, 6])
    one = open_loop(rng, "in the class", 1e3, delay(0.0), noise, ahead=1)[0]
    d = diagnose_without_limits([Recording(one.t_s, one.u, one.y, name="a row early")])
    assert (d.verdict, d.findings) == ("clean", ())
    assert any("is recorded one row before" in words for words in d.data.says)


@pytest.mark.parametrize("stage", ["in the class", "bouc-wen"])
def test_no_drive_is_moved_where_nothing_leads(stage: str) -> None:
    one = open_loop(np.random.default_rng([79, 1]), stage, 1e3, delay(0.0), 0.02)[0]
    data = prepare([Recording(one.t_s, one.u, one.y)])
    problem = Problem(data, rich_base(data))
    assert choose_earlier_drive(problem, problem.solve([]), 0.02) is None


def test_a_model_that_leads_is_judged_on_the_drive_as_it_was_recorded() -> None:
    t = np.arange(8000) * DT
    u = 5 + 3 * np.sin(2 * np.pi * 2.3 * t) + np.sin(2 * np.pi * 6.1 * t)
    y = np.interp(t + 0.5 * DT, t, u)
    data = prepare([Recording(t, u, y + noise(t.size))])
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    problem = Problem(data, rich_base(data), diagnosed)
    moved = choose_earlier_drive(problem, problem.solve([]), NOISE)
    assert moved is not None
    fit = moved.solve([])
    left = [
        make_held_out_groups(moved, drive)
        .held_out_errors(lambda here: build_augmented_model(moved, fit))
        .mean_square
        ** 0.5
        for drive in (data.u, moved.data.u)
    ]
    assert left[0] < 1.2 * NOISE < 2.0 * NOISE < left[1]


MODE = ([(2 * np.pi * 60.0) ** 2], [1.0, 0.06 * 2 * np.pi * 60.0, (2 * np.pi * 60.0) ** 2])
FILTER = ([1.0], [4e-3, 1.0])


@pytest.mark.parametrize("system", [MODE, FILTER])
@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_what_is_fed_by_steps_is_distinguished_from_what_is_fed_by_straight_lines(
    system: tuple[list[float], list[float]], hold: str
) -> None:
    t = np.arange(8000) * DT
    u = 5 + multisine(t.size, 1) + 0.2 * np.random.default_rng(2).standard_normal(t.size)
    u[0] = u.min()
    ahead = np.append(u[1:], u[-1]) if hold == "zoh" else u  # held from before
    y = signal.lsim(system, ahead - u[0], t, interp=hold == "foh")[1]
    data = prepare([Recording(t, u, y + noise(t.size))])
    problem = Problem(data, rich_base(data))
    asked = choose_zero_order_hold(problem, problem.solve([]), 0.01)
    assert asked.data.stepped is (hold == "zoh")


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_filters_are_exact_for_steps_and_for_straight_lines(hold: str) -> None:
    t = np.arange(500) * DT
    u = np.r_[0.0, 0.0, np.random.default_rng(3).standard_normal(t.size - 2)]
    ahead = np.append(u[1:], 0.0) if hold == "zoh" else u
    lag, mode = (signal.lsim(s, ahead, t, interp=hold == "foh")[1] for s in (FILTER, MODE))
    starts = np.arange(t.size) == 0
    stepped, ones = hold == "zoh", np.ones(t.size)
    ours = lowpass(u[:, None], 0.5 * ones, starts, stepped)[:, 0]
    np.testing.assert_allclose(ours, lag, atol=1e-9)
    ours = second_order(u[:, None], 2 * np.pi * 60.0 * DT * ones, 0.03, starts, stepped)[:, 0]
    np.testing.assert_allclose(ours, mode, atol=1e-9)


def test_coupling_through_a_mode_is_named_with_its_frequency() -> None:
    t = np.arange(8000) * DT
    u = 5 + multisine(t.size, 2)
    other = np.random.default_rng(4).standard_normal(t.size)
    w = 2 * np.pi * 80.0
    mode = signal.lsim(([w * w], [1.0, 0.04 * w, w * w]), other, t)[1]
    y = 1.1 * u + 0.02 * mode + noise(t.size)
    diagnosis = diagnose_without_limits([Recording(t, u, y, channels={"u2_v": other})])
    first = diagnosis.findings[0]
    assert first.name == "coupling"
    assert first.parameters["frequency_hz"].value == pytest.approx(80.0, rel=0.01)
    assert first.parameters["gain_um_per_unit"].value == pytest.approx(0.02, rel=0.1)


def test_coupling_through_several_modes_behind_a_delay_is_one_finding() -> None:
    t = np.arange(8000) * DT
    u = 5 + multisine(t.size, 2)
    other = np.random.default_rng(4).standard_normal(t.size)
    late = np.interp(t - 0.7 * DT, t, other)
    y = 1.1 * u + noise(t.size)
    for f, gain in ((60.0, 0.02), (97.0, -0.03)):
        w = 2 * np.pi * f
        y += gain * signal.lsim(([w * w], [1.0, 0.04 * w, w * w]), late, t)[1]
    diagnosis = diagnose_without_limits([Recording(t, u, y, channels={"u2_v": other})])
    assert {f.name for f in diagnosis.findings} - {"shape"} == {"coupling"}
    found = diagnosis.findings[0].parameters
    modes = sorted(v.value for k, v in found.items() if k.startswith("frequency"))
    assert modes == pytest.approx([60.0, 97.0], rel=0.01)
    assert diagnosis.rms["heldout_augmented"] < 1.1 * diagnosis.noise
