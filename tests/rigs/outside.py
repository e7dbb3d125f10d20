"""Recordings outside the model's class, and ordinary ones, from independent equations."""

from collections.abc import Callable

import numpy as np

from dehyst.models.recording import Floats, Recording

RATE_HZ = 500.0


def times(seconds: float, rate_hz: float = RATE_HZ) -> Floats:
    return np.arange(round(seconds * rate_hz)) / rate_hz


def noisy(y: Floats, seed: int, share: float = 0.002) -> Floats:
    """Add white noise with a standard deviation of a share of its range."""
    return y + share * np.ptp(y) * np.random.default_rng(seed).standard_normal(y.size)


def plays(u: Floats, thresholds: Floats, weights: Floats) -> Floats:
    """Compute a sum of play operators by the definition, row by row."""
    held, out = np.zeros(thresholds.size), np.empty(u.size)
    for i, x in enumerate(u):
        held = np.clip(held, x - thresholds, x + thresholds)
        out[i] = weights @ held
    return out


def polarisation(u: Floats, coercive: float, width: float) -> Floats:
    """A ferroelectric that switches: tanh branches about +-coercive, depending on direction."""
    up = np.gradient(u) >= 0
    return np.where(up, np.tanh((u - coercive) / width), np.tanh((u + coercive) / width))


def dry(u: Floats, force: float) -> Floats:
    """One wide play: it rests until the drive has come back by 2 * force."""
    return plays(u, np.array([force]), np.array([1.0]))


def ahead(u: Floats) -> Floats:
    """The direction of the drive: what dry friction between the gauge and the stage adds."""
    return np.asarray(np.sign(np.gradient(u)))


def stick_slip(u: Floats, force: float, carried: float = 1.0) -> Floats:
    """A stage that sticks until its spring is strained by `force`, then slips onto the drive.

    carried: the part of the displacement that sticks; the rest follows the drive."""
    at, out = 0.0, np.empty(u.size)
    for i, x in enumerate(u):
        if abs(x - at) > force:
            at = x
        out[i] = carried * at + (1.0 - carried) * x
    return out


def relay(u: Floats, at: float, share: float) -> Floats:
    """A good stage with a part that switches at +-at, as a ferroelectric of one domain does."""
    state, out = -1.0, np.empty(u.size)
    for i, x in enumerate(u):
        state = 1.0 if x > at else -1.0 if x < -at else state
        out[i] = state
    good = stage(u)
    return good + 0.5 * share * np.ptp(good) * out


def outside(seed: int = 0) -> dict[str, Recording]:
    """Return recordings by kind: none of them has a hysteresis that can be inverted."""
    t = times(8.0)
    sine = 100.0 * np.sin(2 * np.pi * 0.5 * t)
    triangle = 100.0 * (2 * np.abs(2 * ((0.5 * t) % 1.0) - 1) - 1)
    short, long = times(2.005, 200.0), times(8.2)
    once = 100.0 * np.sin(2 * np.pi * 0.5 * short)
    swing = 100.0 * np.sin(2 * np.pi * 0.5 * long)
    ceramic = polarisation(swing, 50.0, 8.0) + 0.003 * swing
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.standard_normal(t.size))
    made: dict[str, tuple[Floats, Floats, Floats]] = {
        "butterfly": (t, sine, np.abs(polarisation(sine, 30.0, 20.0)) * 5 + 0.01 * np.abs(sine)),
        "butterfly of 401 rows": (short, once, np.abs(polarisation(once, 30.0, 20.0)) * 5),
        "square butterfly": (t, triangle, polarisation(triangle, 40.0, 15.0) ** 2),
        "switching loop": (t, sine, polarisation(sine, 45.0, 10.0)),
        "switching loop, triangle": (t, triangle, polarisation(triangle, 60.0, 25.0)),
        "switching loop of 401 rows": (short, once, polarisation(once, 45.0, 10.0)),
        "switching loop of 4100 rows": (long, swing, ceramic),
        "square friction loop": (t, sine, np.sign(dry(sine, 40.0)) + 0.002 * sine),
        "dry friction": (t, sine, dry(sine, 70.0)),
        "dry friction, triangle": (t, triangle, dry(triangle, 60.0)),
        **{
            f"friction ahead of {force:.0%}": (t, drive, drive + 200.0 * force * ahead(drive))
            for force, drive in ((0.04, sine), (0.07, triangle), (0.15, triangle))
        },
        "switching loop of 40 %": (t, sine, polarisation(sine, 50.0, 45.0) + 0.006 * sine),
        **{
            f"stick-slip of {force:.0f} %, {part:.0%}": (
                t,
                drive,
                stick_slip(drive, 2 * force, part),
            )
            for force, part, drive in (
                (6.0, 1.0, sine),
                (12.0, 1.0, triangle),
                (20.0, 0.5, sine),
                (12.0, 0.5, triangle),
            )
        },
        "switching within a loop": (t, sine, relay(sine, 30.0, 0.4)),
        "square wave": (t, 50.0 + 50.0 * np.sign(sine), stage(50.0 + 50.0 * np.sign(sine))),
        "square wave, late": (
            t,
            50.0 * np.sign(sine),
            delayed(stage(50.0 * np.sign(sine)), 0.02),
        ),
        "one way up": (t, t * 10.0, t * 3.0),
        "one way down": (t, -(t**1.5), -t),
        "nothing that follows": (t, sine, rng.standard_normal(t.size)),
        "another input": (t, sine, walk / np.ptp(walk) * 8.0 + 0.002 * sine),
        "twice the frequency": (t, sine, np.cos(2 * np.pi * 1.0 * t)),
        **_wrongly_connected(t, sine, rng),
    }
    return {
        kind: Recording(t_s, u, y if y is u else noisy(y, seed), name=f"{kind}.csv")
        for kind, (t_s, u, y) in made.items()
    }


def stage(u: Floats, seed: int = 0) -> Floats:
    """A stack of 12 plays with a loop of about 15 %, 0.12 um/V."""
    rng = np.random.default_rng(seed)
    r = np.linspace(0.0, 40.0, 12)
    w = np.exp(-r / rng.uniform(10, 25))
    w[0] *= rng.uniform(2.0, 6.0)
    return plays(u, r, w * 0.12 / w.sum())


def _wrongly_connected(
    t: Floats, sine: Floats, rng: np.random.Generator
) -> dict[str, tuple[Floats, Floats, Floats]]:
    """A good stage whose drive or gauge is faulty, as on a bench on a bad day."""
    good, half = stage(sine), t.size // 2
    white = rng.standard_normal(t.size)
    return {
        "open circuit": (t, sine, 3.0 + 1e-3 * white),
        "gauge disconnected": (t, sine, 0.5 * np.sin(2 * np.pi * 50.0 * t) + 0.05 * white),
        "drive unconnected": (t, 0.02 * white, good),
        "gauge turned round halfway": (t, sine, np.r_[good[:half], -good[half:]]),
        "drive is the reading": (t, good, good),
        "gauge at its limit": (t, sine, np.minimum(good, 0.3 * good.max())),
        "backlash": (t, sine, dry(sine, 55.0)),
    }


def linear(seed: int = 0) -> Recording:
    """A stage without hysteresis, for example a flexure under a voice coil."""
    t = times(6.0)
    u = 50 - 50 * np.cos(2 * np.pi * 0.7 * t) * np.sin(np.pi * t / 6.0)
    return Recording(t, u, noisy(0.12 * u + 3.0, seed), name="linear.csv")


def ordinary(seed: int) -> Recording:
    """A stage with 8 to 25 % hysteresis under one of six kinds of drive."""
    rng = np.random.default_rng(seed)
    t = times(6.0)
    f = rng.uniform(0.4, 3.0)
    drives: list[Callable[[], Floats]] = [
        lambda: 50 - 50 * np.cos(2 * np.pi * f * t),
        lambda: 50 - 30 * np.cos(2 * np.pi * f * t) - 20 * np.cos(2 * np.pi * 2.7 * f * t),
        lambda: 100 * np.abs(2 * ((f * t) % 1.0) - 1),
        lambda: 50 - 50 * np.cos(2 * np.pi * f * t) * (0.3 + 0.7 * np.sin(np.pi * t / 6.0)),
        lambda: 50 - 50 * np.cos(2 * np.pi * (0.4 + 0.3 * t) * t),
        lambda: 50 + 20 * sum(np.sin(2 * np.pi * k * 0.5 * t + k * k) for k in (1, 2, 3)),
    ]
    u = np.clip(drives[seed % len(drives)](), 0.0, 100.0)
    r = np.linspace(0.0, 40.0, 12)
    w = np.exp(-r / rng.uniform(10, 25))
    w[0] *= rng.uniform(2.0, 6.0)
    y = plays(u, r, w * 0.12 / w.sum() * rng.choice([1.0, 10.0])) + rng.uniform(-20, 20)
    return Recording(t, u, noisy(y, seed), name=f"ordinary-{seed}.csv")


def lagged(seed: int, rates: tuple[float, ...], tau_s: float) -> list[Recording]:
    """One stage, read through a first-order lag (0: none), with a recording at each rate [Hz]:
    sines and triangles that begin anywhere, of 2.5 cycles or more."""
    rng = np.random.default_rng(seed)
    r = np.linspace(0.0, 40.0, 12)
    w = np.exp(-r / rng.uniform(10, 20))
    w[0] *= 4.0
    start, cycles = rng.uniform(0.0, 1.0), rng.choice([2.5, 3.0, 6.0])
    out = []
    for place, f in enumerate(rates):
        t = times(max(cycles / f, 1.0))
        x = f * t + start
        u = 100 * np.abs(2 * (x % 1.0) - 1) if seed % 2 else 50 - 50 * np.cos(2 * np.pi * x)
        y = plays(u, r, w * 0.12 / w.sum())
        y = delayed(y, tau_s) if tau_s else y
        out.append(Recording(t, u, noisy(y, 10 * seed + place), name=f"at-{f:g}-hz.csv"))
    return out


def delayed(y: Floats, tau_s: float) -> Floats:
    """Read y through a first-order lag, row by row."""
    late, share = np.empty(y.size), 1.0 - np.exp(-1.0 / (RATE_HZ * tau_s))
    level = y[0]
    for i, target in enumerate(y):
        level += share * (target - level)
        late[i] = level
    return late


def beside_drift(seed: int, tau_s: float) -> Recording:
    """A stage whose drive has one period and changing sizes, read through a first-order lag (0:
    none), beside a ramp, a random walk, a creep or a step of the reading."""
    rng = np.random.default_rng(seed)
    f = rng.choice([0.5, 1.0, 2.0])
    t = times(12.0 / f)
    part = t / t[-1]
    size = (1.0 - 0.7 * part, 0.3 + 0.7 * part, np.where(part < 0.5, 1.0, 0.5))[seed % 3]
    x = f * t
    wave = np.abs(2 * (x % 1.0) - 1) if seed % 2 else 0.5 + 0.5 * np.cos(2 * np.pi * x)
    u = 140.0 * size * (1.0 - wave)
    r = np.linspace(0.0, 60.0, 12)
    w = np.exp(-r / rng.uniform(15, 30))
    w[0] *= 4.0
    y = plays(u, r, w * 0.12 / w.sum())
    still = delayed(y, tau_s) if tau_s else y
    slow = (
        0.01 * part,
        0.01 * np.cumsum(rng.standard_normal(t.size)) / np.sqrt(t.size),
        0.05 / np.ptp(y) * (delayed(y, 3.0 / f) - y),
        0.01 * (part > 0.6),
    )[seed // 3 % 4]
    return Recording(t, u, noisy(still + np.ptp(y) * slow, seed, 0.001), name=f"beside-{seed}.csv")


def staircase(seed: int, tau_s: float) -> Recording:
    """A stage read through a first-order lag, whose drive only jumps and rests for half a
    second."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.0, 140.0, 25), round(0.48 * RATE_HZ))
    r = np.linspace(0.0, 60.0, 12)
    w = np.exp(-r / rng.uniform(15, 30))
    w[0] *= 4.0
    y = delayed(plays(u, r, w * 0.12 / w.sum()), tau_s)
    return Recording(times(u.size / RATE_HZ), u, noisy(y, seed, 0.001), name=f"stairs-{seed}.csv")
