"""Identification of stages whose truth is known, and of damaged recordings."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.hysteresis.forward import initial_plays, simulate_hysteresis
from dehyst.models.hysteresis.monotone import find_wrong_way, nearest_monotone
from dehyst.models.hysteresis.z_range import (
    bound_z,
    find_least_slope,
    find_rates,
    is_invertible,
    sum_weights,
)
from dehyst.models.identify import Identification, Options, identify
from dehyst.models.identify.tuning import TUNING
from dehyst.models.inverse.static import static_inverse
from dehyst.models.model import Hysteresis
from dehyst.models.modelfile import dumps, loads, shipped
from dehyst.models.recording import Floats, Recording

T = 1e-3


def two_sines(n: int = 6000) -> Floats:
    t = np.arange(n) * T
    return 5 - 2 * np.cos(2 * np.pi * 10 * t) - 3 * np.cos(2 * np.pi * 5 * t)


def rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def measured(truth: Hysteresis, u: Floats, noise: float, seed: int = 0) -> Recording:
    y = simulate_hysteresis(truth, u, T) + noise * np.random.default_rng(seed).standard_normal(
        u.size
    )
    return Recording(np.arange(u.size) * T, u, y)


@pytest.fixture(scope="module")
def paper() -> Identification:
    return identify([measured(shipped("paper-eq12").hysteresis, two_sines(10000), 0.045)])


def require_invertible(result: Identification) -> None:
    """Check every promise of a written model: slopes, saturation, a round trip by the inverse."""
    model = loads(dumps(result.model))
    h, v = model.hysteresis, model.validity
    rates = np.zeros(h.n)
    if result.shape.rate:
        rates = find_rates(h.r, v.rate_max or 0.0, v.acceleration_max, v.period_s or 0.0)
    assert is_invertible(h, v.drive_min, v.drive_max, rates)
    assert is_invertible(h, v.drive_min, v.drive_max, 0.0)  # what the static inverse uses
    assert find_wrong_way(h, v.drive_min, v.drive_max, rates) is None
    assert nearest_monotone(model)[1] == 0.0
    if h.static:
        inverse = static_inverse(model, v.drive_min, v.drive_max)
        plays = initial_plays(h, v.drive_min)
        for u in np.linspace(v.drive_min, v.drive_max, 7):
            y = simulate_hysteresis(h, np.array([u]), 1.0, plays)[0]
            drive, _ = inverse.step(plays.copy(), v.drive_min, y)
            again = simulate_hysteresis(h, np.array([drive]), 1.0, plays)[0]
            assert again == pytest.approx(y, abs=1e-6)


def test_paper_recording(paper: Identification) -> None:
    truth, u = shipped("paper-eq12").hysteresis, two_sines(10000)
    h = paper.model.hysteresis
    assert not h.static
    assert paper.model.fit.rms < 0.0485
    assert paper.noise_rms == pytest.approx(0.045, rel=0.1)
    assert rms(simulate_hysteresis(h, u, T) - simulate_hysteresis(truth, u, T)) < 0.018
    require_invertible(paper)


def test_slopes_are_bounded_up_to_what_a_turn_allows(paper: Identification) -> None:
    """Narrow operators may have negative slopes at the largest rate, which the drive never has when
    they move; the same stage driven with corners allows no such freedom."""
    h, v = paper.model.hysteresis, paper.model.validity
    assert paper.rates[0] < 0.1 * paper.rates[-1]
    assert not is_invertible(h, v.drive_min, v.drive_max, v.rate_max or 0.0)
    t = np.arange(6000) * T
    u = 3.75 * (1 - np.abs(2 * ((8 * t) % 1.0) - 1)) + 1.9 * (1 - np.abs(2 * ((5 * t) % 1.0) - 1))
    sharp = identify([measured(shipped("paper-eq12").hysteresis, u, 0.045)], Options(rate=True))
    assert np.all(sharp.rates == sharp.model.validity.rate_max)
    require_invertible(sharp)


def test_the_number_of_operators_is_kept_where_slopes_are_bounded_by_turns() -> None:
    rec = measured(shipped("paper-eq12").hysteresis, two_sines(), 0.045)
    result = identify([rec], Options(order=14, rate=True))
    assert result.model.hysteresis.n == 14
    assert result.rates[0] < result.rates[-1]
    assert result.model.fit.rms is not None
    assert result.model.fit.rms < 0.055
    require_invertible(result)


def test_paper_recording_unconstrained() -> None:
    truth, u = shipped("paper-eq12").hysteresis, two_sines(10000)
    result = identify([measured(truth, u, 0.045)], Options(monotone=False))
    assert result.model.fit.rms < 1.02 * 0.045
    assert (
        rms(simulate_hysteresis(result.model.hysteresis, u, T) - simulate_hysteresis(truth, u, T))
        < 0.010
    )


def test_a_very_long_recording_is_fitted_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "dehyst.models.identify.identification.TUNING", TUNING._replace(rows_fitted=5000)
    )
    truth = Hysteresis(r=[0.0, 0.4, 1.5], b=[0.8, 0.3, 0.3], c=[0.0, 1.0, 0.0, -0.002])
    u = two_sines(20000)
    result = identify([measured(truth, u, 0.02)])
    assert (
        rms(simulate_hysteresis(result.model.hysteresis, u, T) - simulate_hysteresis(truth, u, T))
        < 0.004
    )
    assert any("a random subset" in note for note in result.notes)
    assert np.count_nonzero(result.used[0]) > 19_000


def test_monotone_static_stage_is_found_again() -> None:
    """The truth is in the model's class, with its own scale between weights and polynomial."""
    truth = Hysteresis(r=[0.0, 0.4, 1.5, 3.0], b=[0.08, 0.02, 0.02, 0.01], c=[0.0, 9.0, 0.0, -0.5])
    u = two_sines()
    result = identify([measured(truth, u, 0.002)], Options(rate=False))
    h = result.model.hysteresis
    other = 4.5 - 4.5 * np.cos(2 * np.pi * 3 * np.arange(2000) * T)
    other[1000:] *= 0.6
    inside = other <= u.max()
    assert (
        rms((simulate_hysteresis(h, other, T) - simulate_hysteresis(truth, other, T))[inside])
        < 0.01
    )
    # the slope dy/du after a reversal does not depend on the gauge
    travel = 2 * 0.25
    at_top = np.array([0.0, 7.0, 7.0 - travel, 7.0 - travel - 0.1])
    ys, yt = simulate_hysteresis(h, at_top, 1.0), simulate_hysteresis(truth, at_top, 1.0)
    assert ys[2] - ys[3] == pytest.approx(yt[2] - yt[3], rel=0.05)
    require_invertible(result)


def test_structure_can_be_fixed() -> None:
    rec = measured(shipped("paper-eq12").hysteresis, two_sines(), 0.045)
    result = identify([rec], Options(order=7, rate=False, saturation=3, bias=True))
    h = result.model.hysteresis
    assert (h.n, h.static, h.c.size) == (7, True, 4)
    with pytest.raises(BadInput, match="order"):
        Options(order=0)
    with pytest.raises(BadInput, match="saturation"):
        Options(saturation=50)


@settings(
    max_examples=5,
    deadline=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@example(142, True, 0.0046)  # positive at every rate: then the file contains no acceleration
@given(st.integers(0, 1000), st.booleans(), st.floats(0.0, 0.3))
def test_whatever_is_written_can_be_inverted(seed: int, rate: bool, noise: float) -> None:
    """Random stages, monotone or not, saturating or not, rising or falling."""
    rng = np.random.default_rng(seed)
    truth = Hysteresis(
        r=np.sort(rng.uniform(0, 3, 5)), b=rng.normal(0.1, 0.1, 5), k=rng.normal(0, 1e-4, 5),
        c=[rng.normal(), rng.choice([-5.0, 5.0]), rng.normal(0, 0.5), rng.normal(0, 1)],
    )  # fmt: skip
    try:
        result = identify([measured(truth, two_sines(2500), noise, seed)], Options(rate=rate))
    except BadRecording:
        return  # too little of the displacement depends on the drive
    require_invertible(result)


def damaged() -> dict[str, Recording]:
    rng = np.random.default_rng(4)
    truth = Hysteresis(r=[0.0, 0.4, 1.5], b=[0.8, 0.3, 0.3], c=[0.0, 1.0, 0.0, -0.002])
    u = two_sines()
    rec = measured(truth, u, 0.02)
    t, y = rec.t_s, rec.displacement
    some = rng.choice(u.size, u.size // 100, replace=False)
    gone = np.zeros(u.size, dtype=bool)
    gone[rng.choice(u.size, u.size // 20, replace=False)] = True
    wild = y.copy()
    wild[some] += rng.choice([-1, 1], some.size) * rng.uniform(0.5, 1000.0, some.size)
    spikes = u.copy()
    spikes[some] += rng.choice([-1, 1], some.size) * rng.uniform(0.05, 50.0, some.size)
    return {
        "outliers": Recording(t, u, wild),
        "drive spikes": Recording(t, spikes, y),
        "rows missing": Recording(t[~gone], u[~gone], y[~gone]),
        "readings missing": Recording(t, u, np.where(gone, np.nan, y)),
        "drive missing": Recording(t, np.where(gone, np.nan, u), y),
        "jitter": Recording(t + rng.uniform(-0.3, 0.3, t.size) * T, u, y),
        "reversed": Recording(t, u, -y),
        "offset": Recording(t, u, y - 123.0),
        "mid-motion": Recording(t[:-77], u[77:], y[77:]),
    }


@pytest.mark.parametrize("name", damaged())
def test_damage_does_no_harm(name: str) -> None:
    rec = damaged()[name]
    result = identify([rec])
    assert result.model.fit.rms < 0.025
    assert result.model.fit.holdout_rms < 0.025
    require_invertible(result)
    shift = 0.0 if name == "reversed" else -123.0 if name == "offset" else 0.0
    sign = -1.0 if name == "reversed" else 1.0
    truth = Hysteresis(r=[0.0, 0.4, 1.5], b=[0.8, 0.3, 0.3], c=[0.0, 1.0, 0.0, -0.002])
    u = two_sines()
    error = (
        simulate_hysteresis(result.model.hysteresis, u, T)
        - sign * simulate_hysteresis(truth, u, T)
        - shift
    )
    assert rms(error[500:]) < 0.01


def useless() -> dict[str, tuple[Recording, str]]:
    u = two_sines(1000)
    t = np.arange(u.size) * T
    noise = np.random.default_rng(0).standard_normal(u.size)
    ramp = np.linspace(0, 7, u.size)
    return {
        "constant drive": (Recording(t, np.full(u.size, 3.0), noise), "stays at 3 V"),
        "ramp": (Recording(t, ramp, ramp), "only goes up"),
        "nothing moves": (Recording(t, u, noise), "does not follow the drive"),
        "dead sensor": (Recording(t, u, np.zeros(u.size)), "stays at 0 um while the drive moves"),
        "three lines": (Recording(t[:3], u[:3], u[:3]), "3 usable rows"),
        "no displacement": (Recording(t, u), "no displacement column"),
        "all missing": (Recording(t, u, np.full(u.size, np.nan)), "y_um holds no numbers"),
        "no drive": (Recording(t, np.full(u.size, np.nan), noise), "u_v holds no numbers"),
    }


@pytest.mark.parametrize("name", useless())
def test_useless_recording_ends_in_one_sentence(name: str) -> None:
    rec, says = useless()[name]
    with pytest.raises(BadRecording) as error:
        identify([rec])
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_several_recordings_with_their_own_offsets() -> None:
    truth = Hysteresis(r=[0.0, 0.4, 1.5], b=[0.8, 0.3, 0.3], c=[0.0, 1.0])
    u = two_sines(3000)
    other = 3.5 - 3.5 * np.cos(2 * np.pi * np.arange(3000) * T)
    first, second = measured(truth, u, 0.01), measured(truth, other, 0.01, 1)
    second = Recording(second.t_s, second.drive, second.displacement + 0.4)
    result = identify([first, second])
    assert result.params.shifts[0] == pytest.approx(0.4, abs=0.02)
    assert (
        rms(simulate_hysteresis(result.model.hysteresis, u, T) - simulate_hysteresis(truth, u, T))
        < 0.01
    )
    mixed = Recording(second.t_s, second.drive, second.displacement, displacement_unit="nm")
    with pytest.raises(BadInput, match="one pair of units"):
        identify([first, mixed])


def test_a_single_way_down_and_part_of_the_way_back() -> None:
    """The stage came from far away when the recording began: its start is found from the data."""
    truth = Hysteresis(
        r=[0.0, 0.5, 1.0, 2.0, 3.0, 4.0], b=[0.5, 0.1, 0.1, 0.1, 0.1, 0.1], c=[0.0, 1.0]
    )
    before, down, up = np.linspace(30, 8, 500), np.linspace(8, 0, 3000), np.linspace(0, 8, 3000)
    u = np.concatenate([before, down, up])
    y = simulate_hysteresis(truth, u, T)[500:] + 0.002 * np.random.default_rng(0).standard_normal(
        6000
    )
    u = u[500:]
    rec = Recording(np.arange(3750) * T, u[:3750], y[:3750])  # up to 2 of 8 on the way back
    h = identify([rec]).model.hysteresis
    error = simulate_hysteresis(h, u, T) - y
    assert rms(error[:3750]) < 0.004
    assert rms(error[3750:]) < 0.05 * np.ptp(y)


def test_asymmetric_stage_gets_even_powers() -> None:
    truth = Hysteresis(r=[0.0, 0.5, 1.5], b=[0.8, 0.2, 0.2], c=[0.0, 1.0, 0.06])
    result = identify([measured(truth, two_sines(), 0.005)])
    assert result.shape.even
    # the held-out part consists of stretches of the drive that occur nowhere else in the recording
    assert result.model.fit.holdout_rms < 0.0075


def test_reach_is_a_bound_on_what_the_model_does() -> None:
    h = shipped("paper-eq12").hysteresis
    u = two_sines(4000)
    plays = simulate_hysteresis(Hysteresis(r=h.r, b=h.b, k=h.k, c=[0.0, 1.0]), u, T)
    near = Hysteresis(r=h.r, b=np.maximum(h.b, 0.01), k=np.zeros(10), c=[0.0, 1.0])
    z = simulate_hysteresis(near, u, T)
    low, high = bound_z(near, u.min(), u.max(), 0.0)
    assert low <= z.min()
    assert z.max() <= high * (1 + 1e-12)
    alpha, beta = sum_weights(h, 196.0)
    assert min(alpha.min(), beta.min()) < 0 < plays.max()
    assert not is_invertible(h, 0.0, 7.5, 196.0)
    assert find_least_slope(Hysteresis(r=[0.0], b=[1.0], c=[0.0, 1.0, 0.0, -0.02]), 0, 5, 0) < 0


def test_unit_of_the_displacement_does_not_matter() -> None:
    rec = measured(shipped("paper-eq11").hysteresis, two_sines(3000), 0.03)
    other = Recording(rec.t_s, rec.drive, rec.displacement * 1000, displacement_unit="nm")
    a, b = identify([rec]), identify([other])
    assert a.shape == b.shape
    assert b.model.fit.rms == pytest.approx(1000 * a.model.fit.rms, rel=1e-3)
