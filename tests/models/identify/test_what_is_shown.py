"""What a recording does not show is not claimed: no lag that a loop of another class imitates, no
range without readings, no loop of a drive that only runs one way."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.rigs.outside import plays

from dehyst.models.errors import BadRecording
from dehyst.models.identify import identify
from dehyst.models.recording import Floats, Recording

HZ, NOISE_UM, N = 1000.0, 0.02, 4000
T = np.arange(N) / HZ
R = np.linspace(0.0, 40.0, 20)
W = 0.15 * np.exp(-R / 10.0) / np.exp(-R / 10.0).sum()


def noisy(y: Floats, seed: int = 0) -> Floats:
    return y + NOISE_UM * np.random.default_rng(seed).standard_normal(y.size)


def bouc_wen(u: Floats) -> Floats:
    """Return 20 um over 0 to 100 V of a static stage whose loops bend as Bouc-Wen's do, after ten
    loops that shrink."""
    fade = np.linspace(1.0, 0.0, 2000)
    before = 50.0 + 50.0 * fade * np.cos(20.0 * np.pi * fade)
    x = np.r_[before, np.linspace(before[-1], u[0], 100), u] / 50.0 - 1.0
    h, out, last = 0.0, np.empty(x.size), 1.0
    for i, value in enumerate(x.tolist()):
        parts = 1 + int(abs(value - last) / 0.005)
        step = (value - last) / parts
        for _ in range(parts):
            h += 0.5 * step - 0.6 * abs(step) * h * abs(h) ** 0.2 - 0.3 * step * abs(h) ** 1.2
        last, out[i] = value, 1.2 * value - h
    return np.asarray(10.0 + 20.0 * out / np.ptp(out))[-u.size :]


def growing(hz: float) -> Floats:
    size = np.minimum(1.0, T / T[-1] * 1.2)
    return np.asarray(50.0 - 50.0 * size * np.cos(2 * np.pi * hz * T))


def two_tones() -> Floats:
    u = np.sin(2 * np.pi * 2.0 * T) + 0.6 * np.sin(2 * np.pi * 7.3 * T + 1.0)
    return np.asarray(50.0 + 50.0 * u / np.abs(u).max())


def four_tones() -> Floats:
    phases = np.random.default_rng(8).uniform(0.0, 6.28, 4)
    ratios = (1.0, 1.618, 2.414, 3.3)
    u = sum(np.sin(4.0 * np.pi * T * m + p) for m, p in zip(ratios, phases, strict=True))
    return np.asarray(50.0 + 50.0 * u / np.abs(u).max())


def test_a_loop_of_another_class_is_no_lag() -> None:
    u = four_tones()
    found = identify([Recording(T, u, noisy(bouc_wen(u)), name="a.csv")])
    assert found.model.blocks == ()


def test_a_lag_from_loops_of_one_rate_is_doubted() -> None:
    u = growing(2.5)
    found = identify([Recording(T, u, noisy(plays(eight_ms_late(u), R, W)), name="a.csv")])
    assert [b.kind for b in found.model.blocks] == ["lag"]
    assert any("may be part of the loop's shape instead" in note for note in found.notes)


def test_what_a_shape_from_loops_of_one_rate_shows_is_no_fact() -> None:
    u = growing(2.5)
    found = identify([Recording(T, u, noisy(bouc_wen(u)), name="a.csv")])
    assert found.model.blocks == () or any("may be part" in note for note in found.notes)
    assert any(note.startswith("only one rate") for note in found.notes)


def eight_ms_late(u: np.ndarray) -> np.ndarray:
    late = np.empty(N)
    late[0] = u[0]
    for i in range(1, N):
        late[i] = late[i - 1] + (1.0 - np.exp(-1.0 / 8.0)) * (u[i] - late[i - 1])
    return late


def test_a_lag_that_explains_what_is_left_stays() -> None:
    u = two_tones()
    found = identify([Recording(T, u, noisy(plays(eight_ms_late(u), R, W)), name="a.csv")])
    assert [b.kind for b in found.model.blocks] == ["lag"]


def test_rows_a_minute_apart_show_no_lag_and_are_taken() -> None:
    u = growing(2.5)
    found = identify([Recording(60.0 * HZ * T, u, noisy(plays(u, R, W)), name="a.csv")])
    assert found.model.blocks == ()


SAWTOOTH = 100.0 * (1.3 * T % 1.0)
ONE_WAY: dict[str, tuple[Floats, Floats]] = {
    "sawtooth up": (T, SAWTOOTH),
    "sawtooth down": (T, 100.0 - SAWTOOTH),
    "ramps with pauses": (T + 10.0 * np.floor(1.3 * T), SAWTOOTH),
}


@pytest.mark.parametrize("kind", ONE_WAY)
def test_a_drive_that_only_runs_one_way_shows_no_loop(kind: str) -> None:
    t, u = ONE_WAY[kind]
    with pytest.raises(BadRecording, match=r"the drive only goes (up|down)"):
        identify([Recording(t, u, noisy(plays(u, R, W)), name="a.csv")])


def test_rows_in_no_order_of_time_are_refused() -> None:
    u = growing(2.5)
    y, order = noisy(plays(u, R, W)), np.random.default_rng(1).permutation(N)
    with pytest.raises(BadRecording, match="not in time order; sort them"):
        identify([Recording(T, u[order], y[order], name="a.csv")])


STOPS: dict[str, Callable[[Floats], Floats]] = {
    "up": lambda y: np.minimum(y, np.quantile(y, 0.8)),
    "down": lambda y: np.maximum(y, np.quantile(y, 0.2)),
}


@pytest.mark.parametrize("end", STOPS)
def test_a_stop_is_remarked(end: str) -> None:
    u = growing(2.5)
    y = plays(u, R, W)
    found = identify([Recording(T, u, noisy(STOPS[end](y)), name="a.csv")])
    assert any(f"while the drive goes on {end}" in note for note in found.notes)
    found = identify([Recording(T, u, noisy(y), name="a.csv")])
    assert not any("while the drive goes on" in note for note in found.notes)


def test_a_range_without_readings_is_not_claimed() -> None:
    u = growing(2.5)
    y = noisy(plays(u, R, W))
    high = float(np.quantile(y, 0.9))
    model = identify([Recording(T, u, np.minimum(y, high), name="a.csv")]).model
    assert model.validity.drive_min == pytest.approx(0.0, abs=1.0)
    assert model.validity.drive_max == pytest.approx(float(u[y < high].max()))
    assert model.validity.drive_max < 95.0


def test_a_loop_of_a_thousandth_of_the_stroke_is_said_to_be_hardly_any() -> None:
    u = growing(2.5)
    y = 0.2 * u + plays(u, np.array([2.0]), np.array([0.01]))
    y += 1e-4 * np.random.default_rng(0).standard_normal(N)
    found = identify([Recording(T, u, y, name="a.csv")])
    assert any(note.startswith("hardly any hysteresis") for note in found.notes)


@pytest.mark.parametrize("share", [0.02, 0.04])
def test_creep_in_slow_loops_of_one_rate_is_no_lag(share: float) -> None:
    """Creep trails by the same part of a period at any rate, a lag by the same time."""
    t = 0.05 * np.arange(3000)
    u = 100.0 * (1.0 - 0.85 * t / t[-1]) * (0.5 - 0.5 * np.cos(2 * np.pi * t / 20.0))
    slopes = np.array([0.02, 0.012, 0.01, 0.008, 0.006, 0.004, 0.003])
    y = plays(u, np.array([0.0, 4.0, 8.0, 14.0, 20.0, 28.0, 38.0]), slopes)
    crept = y + share * sum(relaxed(y, 0.05, tau) for tau in (0.3, 3.0, 30.0, 300.0))
    noise = 0.004 * np.random.default_rng(3).standard_normal(t.size)
    found = identify([Recording(t, u, crept + noise, name="a.csv")])
    assert found.model.blocks == ()
    assert any(note.startswith("only one rate: lag, delay") for note in found.notes)


def relaxed(y: Floats, step_s: float, tau_s: float) -> Floats:
    """Return what follows y (N,) with a time constant, from rest."""
    keep = np.exp(-step_s / tau_s)
    out = np.zeros(y.size)
    for i in range(1, y.size):
        out[i] = keep * out[i - 1] + (1.0 - keep) * y[i]
    return out
