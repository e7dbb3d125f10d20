"""A lag around the hysteresis is found if there is one, and none is reported otherwise."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from dehyst.models.cascade.simulate import simulate
from dehyst.models.identify import identify
from dehyst.models.identify.dynamics import Filter
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.physics.dynamics import Dynamics
from dehyst.models.recording import Floats, Recording

T = 1e-3
LOOPS = Hysteresis(r=[0.0, 0.4, 1.5], b=[0.8, 0.3, 0.3], c=[0.0, 1.0])


def drive(n: int = 6000) -> Floats:
    t = np.arange(n) * T
    wave = 2 * np.sin(2 * np.pi * 1.1 * t) + np.sin(2 * np.pi * 7 * t) + np.sin(2 * np.pi * 17 * t)
    return (wave + 4) * np.minimum(t / 0.5, 1.0)


@pytest.mark.parametrize(
    ("lag", "below"),
    [
        (Dynamics("lag", "sensor", (0.004,)), ([1.0], [0.004, 1.0])),
        (Dynamics("second", "sensor", (30.0, 0.8)),
         ([1.0], [1 / (2 * np.pi * 30) ** 2, 1.6 / (2 * np.pi * 30), 1.0])),
    ],
    ids=["first order", "second order"],
)  # fmt: skip
def test_columns_are_filtered_as_the_equation_says(lag: Dynamics, below: tuple) -> None:
    u = drive(1000)
    x = np.column_stack([u, u**2])
    through = Filter(lag, 2)
    out, fresh = x.copy(), np.zeros(u.size, dtype=bool)
    for part in (slice(0, 300), slice(300, 1000)):  # in two parts
        lot = out[part].copy()
        through.run(lot, np.arange(u.size)[part] * T, fresh[part])
        out[part] = lot
    num, den, _ = cont2discrete(below, T, "foh")
    want = lfilter(np.squeeze(num), den, x - x[0], axis=0) + x[0]
    np.testing.assert_allclose(out, want, atol=1e-9)


@pytest.mark.parametrize(
    ("place", "tau_s"),
    [("drive", 0.006), ("sensor", 0.006), ("drive", 0.015)],  # the search ends at 0.024
)
def test_a_lag_is_found(place: str, tau_s: float) -> None:
    u = drive()
    block = Dynamics("lag", place, (tau_s,)).blocks[0]
    stage = Model(LOOPS, Validity(0, 8), blocks=(block,))
    noise = 0.004 * np.random.default_rng(3).standard_normal(u.size)
    found = identify([Recording(np.arange(u.size) * T, u, simulate(stage, T, u) + noise)])
    assert not found.shape.rate
    (one,) = found.model.blocks
    assert (one.kind, one.place) == ("lag", place)
    assert one.params["tau_s"] == pytest.approx(tau_s, rel=0.05)
    other = 4 - 4 * np.cos(2 * np.pi * 3 * np.arange(3000) * T)
    other *= u.max() / 8
    error = simulate(found.model, T, other) - simulate(stage, T, other)
    assert np.sqrt(np.mean(error**2)) < 0.012


def test_none_is_found_where_there_is_none() -> None:
    u = drive()
    stage = Model(LOOPS, Validity(0, 8))
    noise = 0.004 * np.random.default_rng(4).standard_normal(u.size)
    found = identify([Recording(np.arange(u.size) * T, u, simulate(stage, T, u) + noise)])
    assert found.model.blocks == ()
    assert not found.shape.rate


def record_slowly(place: str, tau_s: float, last_hz: float, seconds: float = 12.0) -> Recording:
    """Return a sweep over the full range, starting at 0.5 Hz, recorded at 200 Hz; stage and lag are
    run at ten times that rate, and not by the product."""
    step = 0.5 * T
    t = np.arange(round(seconds / step)) * step
    phase = 2 * np.pi * (0.5 * t + (last_hz - 0.5) / (2 * seconds) * t**2)
    u = 5.0 * (1.0 - np.cos(phase)) * np.minimum(1.0, t / 0.25)
    keep = np.exp(-step / tau_s)

    def pass_on(x: Floats) -> Floats:
        return x[0] + lfilter([1 - keep], [1, -keep], x - x[0])

    r = np.linspace(0.0, 9.0, 30)
    h, z = np.zeros(r.size), np.empty(t.size)
    for i, v in enumerate(pass_on(u) if place == "drive" else u):
        h = np.maximum(v - r, np.minimum(v + r, h))
        z[i] = 0.75 * h[0] + 0.036 * np.exp(-r[1:] / 2.5) @ h[1:]
    y = z - 2e-4 * z**3
    y = (pass_on(y) if place == "sensor" else y)[::10]
    return Recording(t[::10], u[::10], y + 0.02 * np.random.default_rng(7).standard_normal(y.size))


@pytest.mark.parametrize("place", ["drive", "sensor"])
def test_the_side_of_a_long_lag_is_reported(place: str) -> None:
    """The structure that was chosen without the lag puts it at 16 ms."""
    found = identify([record_slowly(place, 0.02, 6.0)])
    (one,) = found.model.blocks
    assert (one.kind, one.place) == ("lag", place)
    assert one.params["tau_s"] == pytest.approx(0.02, rel=0.03)
    assert not any("drive or the sensor" in note for note in found.notes)


def test_a_side_that_cannot_be_distinguished_is_said() -> None:
    """A lag of less than a sample, whose side cannot be determined."""
    found = identify([record_slowly("sensor", 0.003, 1.0)])
    assert found.model.blocks[0].place == "drive"
    assert any("cannot show whether the drive or the sensor" in note for note in found.notes)
