"""Every kind of block, compared with an independent reference: scipy, closed forms, plain loops."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from tests.rigs.blocks import forward

from dehyst.models.errors import BadModel
from dehyst.models.model import Block
from dehyst.models.physics import KINDS, check_block

GOOD = {
    "delay": Block("delay", "sensor", {"delay_s": 0.002}),
    "lag": Block("lag", "drive", {"tau_s": 0.001}),
    "slew": Block("slew", "drive", {"rate_v_per_s": 100.0}),
    "clip": Block("clip", "drive", {"min_v": 0.0, "max_v": 9.5}),
    "resonance": Block("resonance", "stage", {"frequency_hz": 200.0, "damping": 0.02, "share": 1}),
    "creep": Block(
        "creep", "stage", {"gain_per_decade": 0.014, "tau_min_s": 0.01, "tau_max_s": 100.0}
    ),
    "drift": Block(
        "drift",
        "stage",
        {"gain_per_k": 0.01, "expansion_um_per_k": 0.1, "reference_c": 20.0},
        "temp_c",
    ),
    "trend": Block("trend", "sensor", {"rate_um_per_s": 0.01}),
    "coupling": Block("coupling", "stage", {"gain_um_per_unit": 0.03}, "u2_v"),
    "hum": Block(
        "hum",
        "sensor",
        {"frequency_hz": (50.0, 100.0), "amplitude_um": (0.05, 0.01), "phase_rad": (0.3, 1.0)},
    ),
    "polynomial": Block("polynomial", "sensor", {"coefficients": (0.1, 1.0, 0.003)}),
    "shape": Block(
        "shape",
        "stage",
        {
            "thresholds_v": (0.5, 1.0),
            "weights_2": (0.1, -0.1),
            "weights_3": (0.0, 0.2),
            "scale_v": 5.0,
        },
    ),
}


def _signal(n: int = 2000, dt: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(n) * dt
    rng = np.random.default_rng(3)
    return t, 3.0 + 2 * np.sin(2 * np.pi * 7 * t) + np.cumsum(rng.normal(0, 0.02, n))


def test_good_examples_pass() -> None:
    assert set(GOOD) <= set(KINDS)
    for block in GOOD.values():
        check_block(block, "v", "um")


@pytest.mark.parametrize("tau", [1e-4, 1e-3, 0.3])
def test_lag_is_the_exact_filter(tau: float) -> None:
    t, x = _signal()
    want = signal.lsim(([1.0], [tau, 1.0]), x - x[0], t)[1] + x[0]
    got = forward("lag", x, t, tau=tau)
    assert np.allclose(got, want, atol=1e-9)


@pytest.mark.parametrize("damping", [0.01, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_resonance_is_the_exact_filter(damping: float, share: float) -> None:
    t, x = _signal()
    w = 2 * np.pi * 150.0
    mode = signal.lsim(([w * w], [1.0, 2 * damping * w, w * w]), x - x[0], t)[1] + x[0]
    got = forward("resonance", x, t, frequency=150.0, damping=damping, share=share)
    assert np.allclose(got, (1 - share) * x + share * mode, atol=1e-7)


@pytest.mark.parametrize(("tau", "damping", "share"), [(1e-4, 0.01, 1.0), (3e-3, 3.0, 0.3)])
def test_a_held_input_is_filtered_exactly(tau: float, damping: float, share: float) -> None:
    """Each value is there from the sample before on."""
    t, x = _signal()
    held, w = np.append(x[1:], x[-1]) - x[0], 2 * np.pi * 150.0
    want = signal.lsim(([1.0], [tau, 1.0]), held, t, interp=False)[1] + x[0]
    assert np.allclose(forward("lag", x, t, tau=tau, held=1.0), want, atol=1e-9)
    system = ([w * w], [1.0, 2 * damping * w, w * w])
    mode = signal.lsim(system, held, t, interp=False)[1] + x[0]
    got = forward("resonance", x, t, frequency=150.0, damping=damping, share=share, held=1.0)
    assert np.allclose(got, (1 - share) * x + share * mode, atol=1e-7)


@pytest.mark.parametrize("tau", [2e-4, 1e-3, 20e-3])
def test_a_held_ramp_lags_as_the_inverse_leads(tau: float) -> None:
    dt = 1e-3
    t = dt * np.arange(400)
    kind = KINDS["lag"]
    p, _ = kind.numbers({"tau": np.array([tau]), "held": np.array([1.0])}, dt)
    behind = t - forward("lag", t, t, tau=tau, held=1.0)
    assert behind[-1] == pytest.approx(kind.inverse.lead(p)[0], abs=1e-9)


def test_an_input_is_held_or_not() -> None:
    with pytest.raises(BadModel, match=r"held: a whole number is needed, not 0.5"):
        check_block(Block("lag", "drive", {"tau_s": 1e-3, "held": 0.5}), "v", "um")


def test_linear_blocks_take_uneven_times() -> None:
    t, x = _signal()
    t_fine = np.arange(0, t[-1], 1e-4)
    x_fine = np.interp(t_fine, t, x)
    keep = np.sort(np.random.default_rng(1).choice(t.size, 700, replace=False))
    keep[0] = 0
    corners = np.interp(t, t[keep], x[keep])  # the same straight lines, sampled evenly
    for name, values in (
        ("lag", {"tau": 0.01}),
        ("resonance", {"frequency": 40.0, "damping": 0.1, "share": 0.7}),
        ("creep", {"gain": 0.02, "tau_min": 0.01, "tau_max": 10.0}),
    ):
        even = forward(name, corners, t, **values)
        uneven = forward(name, x[keep], t[keep], **values)
        assert np.allclose(even[keep], uneven, atol=1e-9), name
    assert x_fine.size > t.size


def test_creep_follows_the_logarithmic_law() -> None:
    t = np.concatenate([[0.0], np.geomspace(1e-3, 100.0, 4000)])
    x = np.where(t > 0, 1.0, 0.0)
    y = forward("creep", x, t, gain=0.015, tau_min=1e-3, tau_max=1e3)
    law = 1 + 0.015 * np.log10(t[1:] / 0.1)
    inside = (t[1:] > 0.02) & (t[1:] < 50)
    assert np.max(np.abs(y[1:] - law)[inside]) < 0.015 * 0.03


def test_creep_counted_from_its_begin_adds_to_what_there_is_without_it() -> None:
    """At once after a step nothing has crept; 0.1 s later a part has, which the other convention
    calls none."""
    t = np.arange(3000) * 1e-3
    x = np.where(t > 0.5, 1.0, 0.0)
    values = {"gain": 0.02, "tau_min": 0.02, "tau_max": 50.0}
    whole = forward("creep", x, t, reference=0.0, **values)
    usual = forward("creep", x, t, **values)
    assert whole[501] == pytest.approx(1.0, abs=0.003)
    assert usual[600] == pytest.approx(1.0, abs=0.003)
    assert (whole - usual)[501:] == pytest.approx(whole[600] - 1.0, abs=0.003)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(-0.1, 0.2), st.floats(1e-3, 1.0))
def test_creep_inverse_is_exact(seed: int, gain: float, tau: float) -> None:
    rng = np.random.default_rng(seed)
    kind = KINDS["creep"]
    taus = {"tau_min": np.array([tau]), "tau_max": np.array([100.0]), "reference": np.array([0.1])}
    values = {"gain": np.array([gain]), **taus}
    p, size = kind.numbers(values, 1e-3)
    s = np.zeros(size)
    kind.start(p, s, 1.0)
    for want in rng.normal(0, 3, 50):
        before = s.copy()
        x = kind.inverse.solve(p, s, want, dt=1e-3)
        assert kind.step(p, before, x, dt=1e-3) == pytest.approx(want, abs=1e-9)
        assert np.array_equal(before, s)


@pytest.mark.parametrize("delay", [0.0, 2e-4, 1e-3, 3.7e-3, 0.05])
def test_delay_shifts_a_smooth_signal(delay: float) -> None:
    t = np.arange(3000) * 1e-3

    def wave(at: np.ndarray) -> np.ndarray:
        return 4 * np.sin(2 * np.pi * 10 * at) + np.cos(2 * np.pi * 3 * at)

    y = forward("delay", wave(t), t, delay=delay)
    inside = t > delay + 0.005
    assert np.max(np.abs(y - wave(t - delay))[inside]) < 2e-4
    assert np.all(y[t < delay] == wave(t)[0])


def test_delay_by_whole_samples_is_a_shift() -> None:
    t, x = _signal()
    y = forward("delay", x, t, delay=5e-3)
    assert np.allclose(y[5:], x[:-5], atol=1e-9)


def test_slew_clip_and_static_blocks_against_plain_loops() -> None:
    t, x = _signal()
    y = forward("slew", x, t, rate=50.0)
    want = [x[0]]
    for value, dt in zip(x[1:], np.diff(t), strict=True):
        want.append(want[-1] + min(max(value - want[-1], -50.0 * dt), 50.0 * dt))
    assert np.allclose(y, want, atol=1e-12)
    assert np.array_equal(forward("clip", x, t, min=2.0, max=4.0), np.clip(x, 2.0, 4.0))
    poly = forward("polynomial", x, t, coefficients=(0.1, 1.0, 0.01))
    assert np.allclose(poly, 0.1 + x + 0.01 * x**2, atol=1e-12)
    warm = 20.0 + 0.1 * t
    drift = forward("drift", x, t, warm, gain=0.01, expansion=0.1, reference=20.0)
    assert np.allclose(drift, x * (1 + 0.01 * 0.1 * t) + 0.01 * t, atol=1e-12)
    assert np.allclose(forward("coupling", x, t, warm, gain=0.03), x + 0.03 * warm)
    hum = forward("hum", x, t, frequency=50.0, amplitude=0.05, phase=0.3)
    assert np.allclose(hum, x + 0.05 * np.sin(2 * np.pi * 50 * t + 0.3), atol=1e-12)
    trend = forward("trend", x, t, rate=0.01, amount=0.2, tau=0.5)
    assert np.allclose(trend, x + 0.01 * t + 0.2 * (1 - np.exp(-t / 0.5)), atol=1e-9)


def test_shape_against_plain_plays() -> None:
    t, x = _signal()
    r, e2, e3 = np.array([0.0, 0.4, 1.5]), np.array([0.1, 0.2, -0.3]), np.array([0.0, 0.1, 0.2])
    y = forward("shape", x, t, thresholds=r, weights_2=e2, weights_3=e3, scale=2.0, center=3.0)
    h = [0.0] * 3
    for i, u in enumerate(x):
        v = (u - 3.0) / 2.0
        h = [max(v - q / 2.0, min(v + q / 2.0, a)) for q, a in zip(r, h, strict=True)]
        want = sum(b * a**2 + c * a**3 for a, b, c in zip(h, e2, e3, strict=True))
        assert math.isclose(y[i], want, abs_tol=1e-12)


@pytest.mark.parametrize(
    ("block", "names"),
    [
        (Block("magnet", "stage", {}), "kind"),
        (Block("lag", "floor", {"tau_s": 1.0}), "place"),
        (Block("slew", "sensor", {"rate_v_per_s": 1.0}), "place"),
        (Block("lag", "stage", {}), "tau_s"),
        (Block("lag", "stage", {"tau_s": -1.0}), "tau_s"),
        (Block("lag", "stage", {"tau_s": (1.0, 2.0)}), "tau_s"),
        (Block("lag", "stage", {"tau_s": 1.0, "tau_ms": 1.0}), "tau_ms"),
        (Block("slew", "drive", {"rate_nm_per_s": 1.0}), "rate_nm_per_s"),
        (Block("drift", "stage", GOOD["drift"].params), "channel"),
        (Block("lag", "stage", {"tau_s": 1.0}, "temp_c"), "channel"),
        (Block("clip", "drive", {"min_v": 2.0, "max_v": 1.0}), "min"),
        (Block("creep", "stage", {**GOOD["creep"].params, "tau_min_s": 1000.0}), "tau_min_s"),
        (Block("hum", "sensor", {**GOOD["hum"].params, "phase_rad": 0.0}), "phase_rad"),
        (Block("polynomial", "sensor", {"coefficients": (1.0,)}), "coefficients"),
        (Block("resonance", "stage", {"frequency_hz": 1.0, "damping": 1.0, "share": 2.0}), "share"),
    ],
)
def test_wrong_blocks_are_refused_by_key(block: Block, names: str) -> None:
    with pytest.raises(BadModel, match=names):
        check_block(block, "v", "um")


@pytest.mark.parametrize("length", [0.3, 1.0])
def test_friction_that_gives_way_in_a_straight_line_is_a_play(length: float) -> None:
    t, x = _signal()
    h, want = x[0], []
    for v in x:  # half passes through a play, half directly
        h = max(v - length, min(v + length, h))
        want.append(0.5 * v + 0.5 * h)
    values = {"length": length, "stribeck": 1.0, "sliding": 0.5 * length, "extra": 0.0}
    got = forward("friction", x, t, exponent=0.0, **values)
    assert np.allclose(got, want, atol=1e-12)
    with pytest.raises(BadModel, match="exponent"):
        check_block(
            Block(
                "friction",
                "stage",
                {
                    "length_um": 1.0,
                    "stribeck_um_per_s": 1.0,
                    "sliding_um": 0.5,
                    "extra_um": 0.0,
                    "exponent": 0.5,
                },
            )
        )
