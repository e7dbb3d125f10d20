"""Where a fit fails, the next best structure is taken, and the recording is not blamed for it; what
a stage of another class leaves is no sign of another stage."""

import numpy as np
import pytest
from tests.rigs.outside import noisy, plays, stage, times

from dehyst.models.errors import BadRecording
from dehyst.models.identify import identify
from dehyst.models.identify.equations import Normal
from dehyst.models.identify.plausibility.recordings import require_one_stage
from dehyst.models.recording import Floats, Recording


def everett(u: Floats, seed: int) -> Floats:
    """A Preisach stage, row by row, on a plane of relays: play operators do not contain it."""
    rng = np.random.default_rng(seed)
    up, down = np.meshgrid(np.linspace(1.0, 99.0, 60), np.linspace(1.0, 99.0, 60))
    keep = up > down
    up, down = up[keep], down[keep]
    weight = np.exp(-(((up - down) / 15.0) ** 2) - ((up + down - 90.0) / 90.0) ** 2)
    weight *= rng.uniform(0.7, 1.3, weight.size)
    state, out = -np.ones(up.size), np.empty(u.size)
    for i, x in enumerate(u):
        state = np.where(x >= up, 1.0, np.where(x <= down, -1.0, state))
        out[i] = weight @ state
    return 0.1 * u + 4.0 * out / np.abs(weight).sum()


def test_what_rounding_leaves_counts_as_noise() -> None:
    """The sum of squares of a perfect fit is a difference that one processor rounds to 0, and the
    next one does not: no division by it overflows."""
    perfect = Normal(np.eye(1), np.array([3.0]), 9.0, 4, 0.0)
    assert perfect.misfit_at(np.array([3.0])) == 0.0
    assert 1e-17 < perfect.noise_at(np.array([3.0])) < 1e-14
    silent = Normal(np.eye(1), np.zeros(1), 0.0, 4, 0.0)
    assert np.isfinite(1e80 / silent.noise_at(np.zeros(1)))


def decaying(hz: float, periods: float = 12.0, rows: int = 3000) -> tuple[Floats, Floats]:
    t = np.linspace(0.0, periods / hz, rows)
    return t, 50.0 - 50.0 * np.cos(2 * np.pi * hz * t) * np.exp(-2.0 * hz * t / periods)


@pytest.mark.parametrize("hz", [0.2, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_decaying_sine_of_another_class_is_static(seed: int, hz: float) -> None:
    t, u = decaying(hz)
    found = identify([Recording(t, u, noisy(everett(u, seed), seed))])
    assert not found.shape.rate
    assert found.model.blocks == ()
    assert any(note.startswith("only one rate: lag, delay") for note in found.notes)


@pytest.mark.parametrize("seed", range(3))
def test_a_recording_in_two_parts_is_fitted_as_well_as_whole(seed: int) -> None:
    t, u = decaying(0.5)
    y = noisy(everett(u, seed), seed)
    whole = identify([Recording(t, u, y)])
    half = u.size // 2
    parts = identify(
        [Recording(t[:half], u[:half], y[:half], name="a"), Recording(t[half:], u[half:], y[half:])]
    )
    assert parts.model.fit.rms is not None
    assert whole.model.fit.rms is not None
    assert parts.model.fit.rms < 1.5 * whole.model.fit.rms


def bouc_wen(u: Floats) -> Floats:
    """The equations of Bouc and Wen, in quarters of a row."""
    h, out = 0.0, np.zeros(u.size)
    for i in range(1, u.size):
        du = (u[i] - u[i - 1]) / 4.0
        for _ in range(4):
            h += 0.03 * du - 0.02 * abs(du) * h - 0.01 * du * abs(h)
        out[i] = 0.1 * u[i] - h
    return out


@pytest.mark.parametrize("seed", range(3))
def test_a_drift_is_not_claimed_where_the_loops_only_shrink(seed: int) -> None:
    t = np.arange(3000) * 0.01
    u = 50.0 * (1.0 - 0.95 * t / t[-1]) * (1.0 - np.cos(np.pi * t))  # down to its lower end
    found = identify([Recording(t, u, noisy(bouc_wen(u), seed))])
    assert not any("drifts" in note for note in found.notes)


@pytest.mark.parametrize(
    ("together", "alone", "odd"),
    [
        ((0.19, 0.12, 0.15), (0.14, 0.10, 0.04), False),  # all of one stage of another class
        ((0.01, 0.01, 0.8), (0.01, 0.01, 0.01), True),  # one of another gain
        ((0.01, 0.01, 0.04), (0.005, 0.005, 0.005), False),  # far below the size
        ((0.4, 0.4), (0.01, 0.01), True),
    ],
)
def test_a_recording_is_odd_beside_what_the_class_leaves(
    together: tuple[float, ...], alone: tuple[float, ...], odd: bool
) -> None:
    names = [f"{k}.csv" for k in range(len(alone))]
    if odd:
        with pytest.raises(BadRecording, match="does not match the others"):
            require_one_stage(names, together, alone, [3.0] * len(alone), "um")
    else:
        assert require_one_stage(names, together, alone, [3.0] * len(alone), "um") == ""


def test_loops_of_one_size_state_no_interval() -> None:
    t = times(8.0)
    u = 50.0 - 50.0 * np.cos(2 * np.pi * 0.5 * t)
    loops = identify([Recording(t, u, noisy(stage(u), 1))])
    assert loops.model.fit.band is None
    u = u * (0.6 - 0.4 * np.cos(2 * np.pi * 0.125 * t))
    sizes = identify([Recording(t, u, noisy(stage(u), 1))])
    assert sizes.model.fit.band is not None


def test_a_copied_column_is_no_displacement_however_it_is_rounded() -> None:
    t, u = decaying(0.5)
    for digits in (4, 6, 9):
        with pytest.raises(BadRecording, match="same signal"):
            identify([Recording(t, np.round(u, digits), np.round(0.12 * u, digits))])
    y = np.round(0.12 * u + 0.05 * plays(u, np.array([10.0]), np.ones(1)), 4)
    assert identify([Recording(t, np.round(u, 4), y)]).model.fit.rms is not None


def test_a_claim_is_made_without_the_drift() -> None:
    t = times(20.0)
    u = 50.0 - 50.0 * np.cos(2 * np.pi * 0.5 * t) * (0.6 + 0.4 * np.cos(2 * np.pi * 0.1 * t))
    y = noisy(stage(u), 1)
    drifting = identify([Recording(t, u, y + 0.04 * np.ptp(y) * t / t[-1])])
    steady = identify([Recording(t, u, y)])
    assert drifting.model.fit.rms > 3.0 * steady.model.fit.rms
    assert drifting.model.fit.claim == pytest.approx(steady.model.fit.claim, rel=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_a_large_drift_does_not_count_against_the_model(seed: int) -> None:
    """A drift of half of the loops' width: a straight line follows the drift, too."""
    t = times(10.0)
    size = 0.3 + 0.2 * np.cos(2 * np.pi * 0.4 * t)
    u = 50.0 - 100.0 * size * np.cos(2 * np.pi * 1.3 * t)
    y = stage(u, seed)
    found = identify([Recording(t, u, noisy(y + 0.15 * np.ptp(y) * t / t[-1], seed))])
    (note,) = [note for note in found.notes if "drifts" in note]
    assert float(note.split(" by ")[1].split()[0]) == pytest.approx(0.15 * np.ptp(y), rel=0.1)
