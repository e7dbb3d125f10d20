"""Effects of the library, in other equations than the library's, for the proof's stages.

Each maker draws its random constants and returns an Effect whose run(x, world, s) gives the
signal after the effect; s is the strength that proof_stages solves for. `own=True` gives the
textbook form instead (one pole, one sine, one gain), whose parameters can be compared with the
stated intervals. Everything runs on the fine grid (FINE samples in a recorder's period).
Shares no code with the library.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy import signal
from tests.rigs.plants.drives import DT, Floats
from tests.rigs.plants.hysteresis import maxwell_slip

FINE = 8
H = DT / FINE


@dataclass(frozen=True)
class World:
    """One recording on the fine grid: time, command, temperature, other axis; a private seed."""

    t: Floats
    u: Floats
    temp: Floats
    u2: Floats
    seed: int

    def rng(self, salt: int) -> np.random.Generator:
        """The same random course for every strength."""
        return np.random.default_rng([self.seed, salt])


Run = Callable[[Floats, World, float], Floats]


@dataclass(frozen=True)
class Effect:
    """place: "drive" (before the hysteresis), "stage" (after it) or "reading" (last)."""

    name: str
    form: str
    place: str
    run: Run
    start: float
    top: float
    truth: Callable[[float], dict[str, float]] = field(default=lambda s: {"strength": s})
    constant_room: bool = False


def linear_filter(num: list[float], den: list[float], x: Floats) -> Floats:
    """A continuous filter on a signal that runs straight between samples, from rest at x[0]."""
    top, bottom, _ = signal.cont2discrete((num, den), H, method="foh")
    gain = num[-1] / den[-1]
    return signal.lfilter(np.ravel(top), bottom, x - x[0]) + gain * x[0]


def low_pass(x: Floats, tau: float) -> Floats:
    return linear_filter([1.0], [tau, 1.0], x) if tau > 0 else x


def delayed(x: Floats, seconds: float) -> Floats:
    t = np.arange(x.size) * H
    return np.interp(t - seconds, t, x)


def _memory(x: Floats, kernel: Floats) -> Floats:
    """Answer to every past increment of x through a creep function, by convolution."""
    return signal.fftconvolve(np.diff(x, prepend=x[0]), kernel)[: x.size]


def creep(rng: np.random.Generator, own: bool) -> Effect:
    form = "log" if own else str(rng.choice(["kelvin-voigt", "fractional", "log"]))
    if form == "kelvin-voigt":
        taus = np.exp(rng.uniform(np.log(0.05), np.log(25.0), 5))
        shares = rng.dirichlet(np.full(5, 3.0))

        def run(x: Floats, w: World, s: float) -> Floats:
            return x + s * sum(c * low_pass(x, tau) for c, tau in zip(shares, taus, strict=True))

        return Effect("creep", form, "stage", run, 0.02, 1.0)
    power, early = rng.uniform(0.08, 0.3), 0.1 if own else rng.uniform(0.02, 0.2)

    def run_kernel(x: Floats, w: World, s: float) -> Floats:
        if form == "log":
            return x + s * _memory(x, np.log10(1.0 + w.t / early))
        return x + s * _memory(x, (w.t + 1e-3) ** power - 1e-3**power)

    return Effect("creep", form, "stage", run_kernel, 0.01, 1.0, lambda s: {"gain_per_decade": s})


def resonance(rng: np.random.Generator, own: bool) -> Effect:
    form = "single" if own else str(rng.choice(["single", "two modes", "coupled masses"]))
    damping = float(np.exp(rng.uniform(np.log(0.006), np.log(0.08))))
    w1 = 2 * np.pi * float(np.exp(rng.uniform(np.log(60.0), np.log(320.0))))
    ratio = rng.uniform(1.6, 2.6)
    if rng.random() < 0.5 and form == "single":  # the whole stroke: strength is the period [s]

        def whole(x: Floats, w: World, s: float) -> Floats:
            n = 2 * np.pi / s
            return linear_filter([n * n], [1.0, 2 * damping * n, n * n], x)

        return Effect(
            "resonance", "whole stroke", "stage", whole, 1 / 250.0, 1 / 35.0,
            lambda s: {"frequency_hz": 1 / s, "damping": damping},
        )  # fmt: skip

    def run(x: Floats, w: World, s: float) -> Floats:
        def mode(n: float, z: float) -> Floats:
            return linear_filter([n * n], [1.0, 2 * z * n, n * n], x)

        if form == "single":
            return x + s * (mode(w1, damping) - x)
        if form == "two modes":
            other = 0.4 * (mode(w1 * ratio, 0.7 * damping) - x)
            return x + s * (mode(w1, damping) - x + other)
        c, k, mu = 2 * damping * w1, w1 * w1, 0.3 * ratio  # a mass that hangs on the platform
        k2, c2 = k * 1.7, c * 0.6
        den = [
            mu, mu * (c + c2) + c2, mu * (k + k2) + k2 + c * c2, c * k2 + c2 * k, k * k2,
        ]  # fmt: skip
        num = [mu * k, c2 * k, k2 * k]
        return x + s * (linear_filter(num, den, x) - x)

    return Effect(
        "resonance", form, "stage", run, 0.02, 1.0,
        lambda s: {"frequency_hz": w1 / 2 / np.pi, "damping": damping, "share": s},
    )  # fmt: skip


def delay(rng: np.random.Generator, own: bool) -> Effect:
    place = str(rng.choice(["drive", "reading"]))

    def run(x: Floats, w: World, s: float) -> Floats:
        return delayed(x, s)

    return Effect("delay", "interpolated", place, run, 2e-4, 0.02, lambda s: {"delay_s": s})


def lag(rng: np.random.Generator, own: bool) -> Effect:
    place = str(rng.choice(["drive", "reading"]))
    form = "one pole" if own else str(rng.choice(["one pole", "two poles", "butterworth"]))
    second = rng.uniform(0.15, 0.5)

    def run(x: Floats, w: World, s: float) -> Floats:
        if form == "one pole":
            return low_pass(x, s)
        if form == "two poles":
            return low_pass(low_pass(x, s), second * s)
        return linear_filter([1.0], [s * s / 2.0, s, 1.0], x)

    return Effect("lag", f"{form}, {place}", place, run, 5e-4, 0.03, lambda s: {"tau_s": s})


@njit(cache=True, nogil=True)
def _charge(u: Floats, limit: float, soft: float, bend: float, h: float) -> Floats:
    """C(v) dv/dt = current, current = (u - v) / R held within the amplifier's limit."""
    out = np.empty(u.size)
    v = u[0]
    for t in range(u.size):
        most = limit * h / (1.0 + bend * v)
        if soft > 0.0:
            step = (u[t] - v) * (1.0 - np.exp(-h / soft))
        else:
            step = u[t] - v
        v += min(max(step, -most), most)
        out[t] = v
    return out


def slew(rng: np.random.Generator, own: bool) -> Effect:
    bend = 0.0 if own else rng.uniform(0.0, 0.04)
    soft = 0.0 if own else rng.uniform(5e-5, 2e-4)

    def run(x: Floats, w: World, s: float) -> Floats:
        return _charge(x, 1.0 / s, soft, bend, H)

    return Effect(
        "slew",
        "current limit",
        "drive",
        run,
        1 / 600.0,
        1 / 25.0,
        lambda s: {"rate_v_per_s": 1 / s},
    )


def clip(rng: np.random.Generator, own: bool) -> Effect:
    soft = 0.0 if own else float(rng.choice([0.0, rng.uniform(0.03, 0.12)]))
    both = not own and rng.random() < 0.3

    def bent(x: Floats) -> Floats:
        return soft * np.logaddexp(0.0, x / soft) if soft > 0 else np.maximum(x, 0.0)

    def run(x: Floats, w: World, s: float) -> Floats:
        high = 9.8 - s
        out = x - bent(x - high)
        return out + bent(0.3 * s - out) - bent(np.array([0.3 * s])) if both else out

    return Effect("clip", f"soft {soft:.2f}", "drive", run, 1.0, 5.0, lambda s: {"max_v": 9.8 - s})


def drift(rng: np.random.Generator, own: bool) -> Effect:
    form = str(rng.choice(["expansion", "gain"] if own else ["expansion", "gain", "warm-up"]))
    tau = 0.0 if own else rng.uniform(0.2, 3.0)
    slow = rng.uniform(4.0, 20.0)

    def run(x: Floats, w: World, s: float) -> Floats:
        if form == "warm-up":
            return x + s * (1.0 - np.exp(-w.t / slow)) * w.rng(1).choice([0.8, 1.0, 1.2])
        warm = low_pass(w.temp - 22.0, tau)
        return x + s * warm if form == "expansion" else x * (1.0 + s * warm)

    key = {"expansion": "expansion_um_per_k", "gain": "gain_per_k", "warm-up": "rise"}[form]
    top = 3.0 if form != "gain" else 0.6
    return Effect(
        "drift", form, "stage", run, 0.05, top, lambda s: {key: s}, constant_room=form == "warm-up"
    )


def hum(rng: np.random.Generator, own: bool) -> Effect:
    mains = float(rng.choice([50.0, 60.0])) * (1 + 3e-4 * rng.standard_normal())
    f = mains if rng.random() < 0.7 else rng.uniform(15.0, 180.0)
    third = 0.0 if own else rng.uniform(0.0, 0.25)
    wander = 0.0 if own else 0.06

    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(2)
        phase = r.random()
        swing = 1.0 + wander * low_pass(np.repeat(r.standard_normal(w.t.size // 4000 + 1), 4000)[
            : w.t.size
        ], 0.3)  # fmt: skip
        wave = np.sin(2 * np.pi * (f * w.t + phase))
        return x + s * (swing * wave + third * np.sin(6 * np.pi * (f * w.t + phase) + 0.7))

    return Effect(
        "hum", f"{f:.2f} Hz", "reading", run, 0.05, 5.0,
        lambda s: {"amplitude_um": s, "frequency_hz": f},
    )  # fmt: skip


def coupling(rng: np.random.Generator, own: bool) -> Effect:
    form = "gain" if own else str(rng.choice(["filtered", "hysteretic"]))
    tau, axis = rng.uniform(2e-3, 0.03), maxwell_slip(rng)
    sign = float(rng.choice([-1.0, 1.0]))

    def run(x: Floats, w: World, s: float) -> Floats:
        if form == "gain":
            return x + sign * s * (w.u2 - 5.0)
        if form == "filtered":
            return x + sign * s * low_pass(w.u2 - 5.0, tau)
        return x + sign * s * (axis(w.u2) - 5.0)

    return Effect(
        "coupling", form, "stage", run, 0.02, 2.0, lambda s: {"gain_um_per_unit": sign * s}
    )
