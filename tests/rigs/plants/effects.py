"""Effects of the library, in equations other than the library's, for the proof's stages.

Each maker draws its random constants and returns an Effect whose run(x, world, s) gives the signal
after the effect; s is the strength that the proof solves for. `own=True` gives the textbook form
instead (one pole, one sine, one gain), whose parameters can be compared with the reported
intervals. Everything runs on the world's fine grid, many times finer than the recorder's; drive in
0 to 10 V, displacement in um. `dt`: the recorder's period [s], which determines speeds. Shares no
code with the library.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import signal
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.hysteresis import maxwell_slip


@dataclass(frozen=True)
class World:
    """One recording on the fine grid, and the time before it: time [s] (negative before), command,
    temperature, other axis; a private seed."""

    t: Floats
    u: Floats
    temp: Floats
    u2: Floats
    seed: int

    @property
    def h(self) -> float:
        """Step of the grid [s]."""
        return float(self.t[1] - self.t[0])

    @property
    def during(self) -> float:
        """Length of the recording itself [s]."""
        return float(self.t[-1])

    def rng(self, salt: int) -> np.random.Generator:
        """Return a generator that gives the same random course for every strength."""
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
    truth: Callable[[float], dict[str, float]]


def linear_filter(num: list[float], den: list[float], x: Floats, h: float) -> Floats:
    """Apply a continuous filter to a signal that is linear between samples, from rest at x[0]."""
    top, bottom, _ = signal.cont2discrete((num, den), h, method="foh")
    gain = num[-1] / den[-1]
    return signal.lfilter(np.ravel(top), bottom, x - x[0]) + gain * x[0]


def low_pass(x: Floats, tau: float, h: float) -> Floats:
    return linear_filter([1.0], [tau, 1.0], x, h) if tau > 0 else x


def delayed(x: Floats, seconds: float, h: float) -> Floats:
    t = np.arange(x.size) * h
    return np.interp(t - seconds, t, x)


def memory(x: Floats, kernel: Floats) -> Floats:
    """Return the response to every past increment of x through a creep function, by convolution."""
    return signal.fftconvolve(np.diff(x, prepend=x[0]), kernel)[: x.size]


def creep(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    form = "log" if own else str(rng.choice(["kelvin-voigt", "fractional", "log"]))
    if form == "kelvin-voigt":
        taus = np.exp(rng.uniform(np.log(0.05), np.log(25.0), 5))
        shares = rng.dirichlet(np.full(5, 3.0))

        def run(x: Floats, w: World, s: float) -> Floats:
            return x + s * sum(
                c * low_pass(x, tau, w.h) for c, tau in zip(shares, taus, strict=True)
            )

        return Effect("creep", form, "stage", run, 0.02, 1.0, lambda s: {})
    power, early = rng.uniform(0.08, 0.3), 0.1 if own else rng.uniform(0.02, 0.2)

    def run_kernel(x: Floats, w: World, s: float) -> Floats:
        since = w.t - w.t[0]
        if form == "log":
            return x + s * memory(x, np.log10(1.0 + since / early))
        return x + s * memory(x, (since + 1e-3) ** power - 1e-3**power)

    def truth(s: float) -> dict[str, float]:
        return {"gain_per_decade": s} if own else {}

    return Effect("creep", form, "stage", run_kernel, 0.01, 1.0, truth)


def resonance(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    form = "single" if own else str(rng.choice(["single", "two modes", "coupled masses"]))
    damping = float(np.exp(rng.uniform(np.log(0.006), np.log(0.08))))
    w1 = 2 * np.pi * float(np.exp(rng.uniform(np.log(0.06), np.log(0.32)))) / dt
    ratio = rng.uniform(1.6, 2.6)
    if rng.random() < 0.5 and form == "single":  # the whole stroke: strength is the period [s]

        def whole(x: Floats, w: World, s: float) -> Floats:
            n = 2 * np.pi / s
            return linear_filter([n * n], [1.0, 2 * damping * n, n * n], x, w.h)

        return Effect(
            "resonance", "whole stroke", "stage", whole, 4.0 * dt, 29.0 * dt,
            lambda s: {"frequency_hz": 1 / s, "damping": damping},
        )  # fmt: skip

    def run(x: Floats, w: World, s: float) -> Floats:
        def mode(n: float, z: float) -> Floats:
            return linear_filter([n * n], [1.0, 2 * z * n, n * n], x, w.h)

        if form == "single":
            return x + s * (mode(w1, damping) - x)
        if form == "two modes":
            other = 0.4 * (mode(w1 * ratio, 0.7 * damping) - x)
            return x + s * (mode(w1, damping) - x + other)
        c, k, mu = 2 * damping * w1, w1 * w1, 0.3 * ratio  # a mass attached to the platform
        k2, c2 = k * 1.7, c * 0.6
        den = [
            mu, mu * (c + c2) + c2, mu * (k + k2) + k2 + c * c2, c * k2 + c2 * k, k * k2,
        ]  # fmt: skip
        num = [mu * k, c2 * k, k2 * k]
        return x + s * (linear_filter(num, den, x, w.h) - x)

    return Effect(
        "resonance", form, "stage", run, 0.02, 1.0,
        lambda s: (
            {"frequency_hz": w1 / 2 / np.pi, "damping": damping, "share": s} if own else {}
        ),
    )  # fmt: skip


def delay(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    place = str(rng.choice(["drive", "reading"]))

    def run(x: Floats, w: World, s: float) -> Floats:
        return delayed(x, s, w.h)

    return Effect(
        "delay", "interpolated", place, run, 0.2 * dt, 20.0 * dt, lambda s: {"delay_s": s}
    )


def lag(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    place = str(rng.choice(["drive", "reading"]))
    form = "one pole" if own else str(rng.choice(["one pole", "two poles", "butterworth"]))
    second = rng.uniform(0.15, 0.5)

    def run(x: Floats, w: World, s: float) -> Floats:
        if form == "one pole":
            return low_pass(x, s, w.h)
        if form == "two poles":
            return low_pass(low_pass(x, s, w.h), second * s, w.h)
        return linear_filter([1.0], [s * s / 2.0, s, 1.0], x, w.h)

    def truth(s: float) -> dict[str, float]:
        return {"tau_s": s} if form == "one pole" else {}

    return Effect("lag", f"{form}, {place}", place, run, 0.5 * dt, 30.0 * dt, truth)


@njit(cache=True, nogil=True)
def charge(u: Floats, limit: float, soft: float, bend: float, h: float) -> Floats:
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


def slew(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    bend = 0.0 if own else rng.uniform(0.0, 0.04)
    soft = 0.0 if own else rng.uniform(0.05, 0.2) * dt

    def run(x: Floats, w: World, s: float) -> Floats:
        return charge(x, 1.0 / s, soft, bend, w.h)

    return Effect(
        "slew", "current limit", "drive", run, 1.7 * dt, 40.0 * dt,
        lambda s: {"rate": 1 / s} if own else {},
    )  # fmt: skip


def clip(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    soft = 0.0 if own else float(rng.choice([0.0, rng.uniform(0.03, 0.12)]))
    both = not own and rng.random() < 0.3

    def bent(x: Floats) -> Floats:
        return soft * np.logaddexp(0.0, x / soft) if soft > 0 else np.maximum(x, 0.0)

    def run(x: Floats, w: World, s: float) -> Floats:
        high = 9.8 - s
        out = x - bent(x - high)
        return out + bent(0.3 * s - out) - bent(np.array([0.3 * s])) if both else out

    return Effect(
        "clip",
        f"soft {soft:.2f}",
        "drive",
        run,
        1.0,
        5.0,
        lambda s: {"max": 9.8 - s} if soft == 0.0 else {},
    )


def drift(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """A drift caused by a room whose temperature changes; see warm_up for the other kind."""
    form = str(rng.choice(["expansion", "gain"]))
    tau = 0.0 if own else rng.uniform(0.2, 3.0)

    def run(x: Floats, w: World, s: float) -> Floats:
        warm = low_pass(w.temp - 22.0, tau, w.h)
        return x + s * warm if form == "expansion" else x * (1.0 + s * warm)

    def truth(s: float) -> dict[str, float]:
        return {"expansion": s} if own and form == "expansion" else {}

    top = 3.0 if form != "gain" else 0.6
    return Effect("drift", form, "stage", run, 0.05, top, truth)


def warm_up(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """A stage that has been warming by itself since before the recording began."""
    late, share = rng.uniform(0.3, 1.2), rng.choice([0.8, 1.0, 1.2])

    def run(x: Floats, w: World, s: float) -> Floats:
        return x + s * share * (1.0 - np.exp(-(w.t - w.t[0]) / (late * w.during)))

    return Effect("drift", "warming up", "stage", run, 0.05, 3.0, lambda s: {})


def hum(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    mains = float(rng.choice([50.0, 60.0])) * (1 + 3e-4 * rng.standard_normal())
    if rng.random() < 0.3 or mains > 0.3 / dt:
        mains = rng.uniform(0.015, 0.18) / dt
    f = mains
    third = 0.0 if own else rng.uniform(0.0, 0.25)
    wander = 0.0 if own else 0.06

    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(2)
        phase = r.random()
        some = r.standard_normal(int(w.during / 0.5) + 3)
        swing = 1.0 + wander * np.interp(w.t, 0.5 * np.arange(some.size), some)
        wave = np.sin(2 * np.pi * (f * w.t + phase))
        return x + s * (swing * wave + third * np.sin(6 * np.pi * (f * w.t + phase) + 0.7))

    return Effect(
        "hum", f"{f:.2f} Hz", "reading", run, 0.05, 5.0,
        lambda s: {"amplitude": s, "frequency_hz": f} if own else {"frequency_hz": f},
    )  # fmt: skip


def coupling(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    form = "gain" if own else str(rng.choice(["filtered", "hysteretic"]))
    tau, axis = rng.uniform(2.0, 30.0) * dt, maxwell_slip(rng)
    sign = float(rng.choice([-1.0, 1.0]))

    def run(x: Floats, w: World, s: float) -> Floats:
        if form == "gain":
            return x + sign * s * (w.u2 - 5.0)
        if form == "filtered":
            return x + sign * s * low_pass(w.u2 - 5.0, tau, w.h)
        return x + sign * s * (axis(w.u2) - 5.0)

    return Effect(
        "coupling", form, "stage", run, 0.02, 2.0,
        lambda s: {"gain_per_unit": sign * s} if own else {},
    )  # fmt: skip
