"""Stages under servos and recorders like those of real hardware, for tests of the written model.

A stage is simulated on a grid many times finer than its recorder's. The servo's own stage is a
Bouc-Wen loop with relaxations for creep, stepped together with an integrating controller, so that
noise and hum feed back through its drive. Shares no code with the library.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from tests.rigs.plants import drives
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.effects import linear_filter, low_pass
from tests.rigs.plants.hysteresis import CLASSES
from tests.rigs.plants.hysteresis_more import in_class

from dehyst.models.recording import Recording

FINE = 5  # simulation steps per sample of the recorder
STAGES = {**CLASSES, "in the class": in_class}
Rng = np.random.Generator
Drive = Callable[[Rng, Floats, float], Floats]


class RigCase(NamedTuple):
    """One case. foreign: whether the loop is outside the library's class; given: the tool's input;
    held: the held-out drive, its displacement without noise and hum; noise: rms of the noise."""

    kind: str
    name: str
    foreign: bool
    hidden: tuple[str, ...]
    given: list[Recording]
    held: Recording
    noise: float


class Shown(NamedTuple):
    """A recorder's output: stamps, drive and reading; and the exact displacement of each row."""

    t_s: Floats
    u: Floats
    y: Floats
    exact: Floats


@njit(cache=True, nogil=True)
def _in_a_servo(
    target: Floats, added: Floats, h: float, rate: float, creep: float
) -> tuple[Floats, Floats]:
    """Return drive and displacement of a stage whose integrator sees it plus `added`."""
    u, z = 0.0, 0.0
    slow = np.zeros(5)
    us, ys = np.empty(target.size), np.empty(target.size)
    y = 0.0
    for i in range(target.size):
        before = u
        u = min(max(u + rate * h * (target[i] - y - added[i]), 0.0), 10.0)
        du = u - before
        z += 0.55 * du - 0.45 * abs(du) * z - 0.25 * du * abs(z)
        fast = u + 0.004 * u * u - 0.8 * z
        y = fast
        for k in range(5):
            slow[k] += (fast - slow[k]) * h / (0.03 * 6.0**k + h)
            y += creep * slow[k]
        us[i], ys[i] = u, y
    return us, ys


def _waves(seconds: float) -> tuple[tuple[str, Drive, float], ...]:
    return (
        ("identify", drives.multisine, 0.8 * seconds),
        ("check", drives.triangle, 0.7 * seconds),
        ("hold", drives.holds, 1.5 * seconds),
        ("held", drives.mixed, seconds),
    )


def open_loop(
    rng: Rng,
    stage: str,
    hz: float,
    read: Callable[[Floats, Floats, float], Floats],
    noise: float,
    volts: float = 10.0,
    step_v: float = 0.0,
    ahead: int = 0,
    hold_s: float = 0.0,
) -> list[Shown]:
    """Return recordings at `hz` of a stage whose displacement passes `read`(x, t, h). step_v:
    quantisation of the drive that is read back; ahead: rows by which the reading is early; hold_s:
    time for which a slow gauge repeats a reading."""
    run, out = STAGES[stage](rng), []
    for _, drive, seconds in _waves(12_000.0 / hz):
        dt = 1.0 / hz
        h, rows = dt / FINE, round(seconds * hz)
        t = h * np.arange((rows + ahead) * FINE + 1)
        u = np.clip(drive(rng, t, dt), 0.0, 10.0)
        x = read(np.asarray(run(u)), t, h)
        rows_at = FINE * np.arange(rows)
        exact = x[rows_at + ahead * FINE]
        y = exact + noise * rng.standard_normal(rows)
        if hold_s:
            last = np.floor(t[rows_at] / hold_s + 1e-9) * hold_s
            at = np.clip(np.round(last * hz).astype(int), 0, rows - 1)
            y = y[at]
        shown = u[rows_at] * volts / 10.0
        shown = np.round(shown / step_v) * step_v if step_v else shown
        out.append(Shown(t[rows_at], shown, y, exact))
    return out


def _lag(tau: float) -> Callable[[Floats, Floats, float], Floats]:
    def run(x: Floats, t: Floats, h: float) -> Floats:
        return np.asarray(x[0] + low_pass(x - x[0], tau, h))

    return run


def delay(seconds: float) -> Callable[[Floats, Floats, float], Floats]:
    """Return what delays a displacement x(t)."""
    return lambda x, t, h: np.interp(t - seconds, t, x)


def _creeps(share: float) -> Callable[[Floats, Floats, float], Floats]:
    def run(x: Floats, t: Floats, h: float) -> Floats:
        return x + share * sum(low_pass(x, tau, h) for tau in (0.03, 0.2, 1.2, 7.0))

    return run


def _rings(hz: float, damping: float) -> Callable[[Floats, Floats, float], Floats]:
    def run(x: Floats, t: Floats, h: float) -> Floats:
        w = 2 * np.pi * hz
        return np.asarray(linear_filter([w * w], [1.0, 2 * damping * w, w * w], x - x[0], h)) + x[0]

    return run


def _preloaded(change: float) -> Callable[[Floats, Floats, float], Floats]:
    def run(x: Floats, t: Floats, h: float) -> Floats:
        return x * (1.0 + change * (t > 0.6 * t[-1]))

    return run


def _servo(rng: Rng, noise: float, lines: float, creep: float) -> list[Shown]:
    out = []
    for _, drive, seconds in _waves(12.0):
        dt = 1e-3
        h, rows = dt / FINE, round(seconds / dt)
        t = h * np.arange(rows * FINE)
        target = 0.9 * np.clip(drive(rng, t, dt), 0.0, 10.0)
        phases = 2 * np.pi * rng.random(2)
        line = np.sin(2 * np.pi * 60.008 * t + phases[0])
        line += 0.4 * np.sin(2 * np.pi * 180.024 * t + phases[1])
        hiss = noise * rng.standard_normal(rows).repeat(FINE)
        added = hiss + lines * line
        u, x = _in_a_servo(target, added, h, 150.0, creep)
        at = FINE * np.arange(rows)
        out.append(Shown(t[at], u[at], x[at] + added[at], x[at]))
    return out


def _make(kind: str, rng: Rng, stage: str) -> tuple[tuple[str, ...], list[Shown], float]:
    noise = float(rng.uniform(0.01, 0.03))
    if kind == "servo-hum":
        return ("hum",), _servo(rng, noise, 2.5 * noise, 0.0), noise
    if kind == "servo-creep":
        return ("creep", "hum"), _servo(rng, noise, 2.0 * noise, 0.012), noise
    if kind == "servo-clean":
        return (), _servo(rng, noise, 0.0, 0.0), noise
    if kind == "readback":
        read, hz = _lag(float(rng.uniform(0.008, 0.02))), 90.0
        shown = open_loop(rng, stage, hz, read, noise, volts=73.0, step_v=0.1)
        return ("lag",), shown, noise
    if kind == "delay":
        read = delay(float(rng.uniform(0.7, 3.0)) * 1e-3)
        return ("delay",), open_loop(rng, stage, 1e3, read, noise), noise
    if kind == "early":
        return (), open_loop(rng, stage, 1e3, delay(0.0), noise, ahead=1), noise
    if kind == "preload":
        read = _preloaded(float(rng.uniform(0.01, 0.03)))
        return ("unknown",), open_loop(rng, stage, 1e3, read, noise), noise
    if kind == "polled":
        shown = open_loop(rng, stage, 1e3, _creeps(0.012), noise, hold_s=0.012)
        return ("creep",), shown, noise
    if kind == "creep-bits":
        shown = open_loop(rng, stage, 500.0, _creeps(0.012), noise, volts=150.0, step_v=0.15)
        return ("creep",), shown, noise
    if kind == "mode":
        read = _rings(float(rng.uniform(20.0, 70.0)), float(rng.uniform(0.008, 0.03)))
        return ("resonance",), open_loop(rng, stage, 500.0, read, noise), noise
    if kind == "quiet-lag":
        noise = float(rng.uniform(3e-4, 1e-3))
        return ("lag",), open_loop(rng, stage, 1e3, _lag(1.5e-3), noise), noise
    assert kind == "clean"
    return (), open_loop(rng, stage, 1e3, delay(0.0), noise), noise


KINDS = (
    "servo-hum", "readback", "delay", "early", "preload", "polled", "creep-bits", "mode",
    "servo-creep", "quiet-lag", "servo-clean", "clean",
)  # fmt: skip


SHOWN = (("identify", "check", "hold"), ("identify", "hold"), ("identify",))


def make_rig(seed: int, number: int) -> RigCase:
    """Make one case; the kinds take turns, first with three recordings, then two, then one."""
    kind = KINDS[number % len(KINDS)]
    rng = np.random.default_rng([seed, number])
    stage = "in the class" if kind == "clean" else str(rng.choice(list(STAGES)))
    hidden, shown, noise = _make(kind, rng, stage)
    records = {name: one for one, (name, _, _) in zip(shown, _waves(1.0), strict=True)}
    names = SHOWN[number // len(KINDS) % len(SHOWN)]
    given = [
        Recording(one.t_s, one.u, one.y, name=f"{name}.csv")
        for name, one in records.items()
        if name in names
    ]
    held = records["held"]
    exact = Recording(held.t_s, held.u, held.exact, name="held.csv")
    foreign = stage != "in the class" or kind.startswith("servo")
    return RigCase(kind, f"{kind}-{number}", foreign, hidden, given, exact, noise)
