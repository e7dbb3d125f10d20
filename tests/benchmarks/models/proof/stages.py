"""Make one stage: from a plan to recordings, and to the truth about them.

A stage is simulated on a grid many times finer than the recorder's, in volts (0 to 10) and
micrometres; the rig converts that to its own range, units, noise, resolution and faults. Drive
effects act before the hysteresis, stage effects after it, reading effects last. The time before the
recording is simulated too, but not recorded.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from tests.benchmarks.models.proof.base import Size, rms
from tests.benchmarks.models.proof.recorder import Rig, faults, noise_of
from tests.rigs.plants import drives
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.effects import Effect, World
from tests.rigs.plants.effects_more import MAKERS, OUTSIDE
from tests.rigs.plants.effects_shape import PARTED, SHAPES
from tests.rigs.plants.hysteresis import CLASSES
from tests.rigs.plants.hysteresis_more import dead_zones, duhem, in_class

from dehyst.models.recording import Recording

FOREIGN = {**CLASSES, "duhem": duhem, "dead zones": dead_zones}
HYSTERESES = {**FOREIGN, "in the class": in_class}
EFFECTS = {**MAKERS, **OUTSIDE, **SHAPES, **PARTED}
ACTS_ON = {"drive": "drive", "stage": "stage", "reading": "sensor"}
FINE_HZ, LEAST_FINE = 5000.0, 4
ABOVE_CLASS = 1.3
HELD = "holdout"
Drive = Callable[[np.random.Generator, Floats, float], Floats]


@dataclass(frozen=True)
class Wanted:
    """An effect by its maker's name; size: what a rich base leaves of it, in rms of the noise (and
    never less than what it leaves of the stage without any effect)."""

    maker: str
    size: float
    own: bool = False


@dataclass(frozen=True)
class Plan:
    """A case before it is made. waves: name, drive, seconds; before_s: time before the recording at
    which the drive went from 0 V to its start; fault: what happens to the rows; repeats_hz: a
    frequency of which all drive frequencies are multiples, if there is one."""

    case: str
    family: str
    seed: int
    rig: Rig
    hysteresis: str
    effects: tuple[Wanted, ...]
    waves: tuple[tuple[str, Drive, float], ...]
    before_s: float = 0.0
    fault: str = ""
    repeats_hz: float = 0.0


@dataclass(frozen=True)
class Hidden:
    """One effect as it was made. left: what a rich base leaves of it [rms of the noise];
    class_left: what it leaves of the bare stage; ties: names that would do as well; blind: a line
    on a harmonic of the drive, which cannot be attributed, or above half the rate."""

    name: str
    form: str
    acts_on: str
    left: float
    class_left: float
    ties: tuple[str, ...]
    truth: dict[str, float]
    blind: bool = False

    @property
    def separable(self) -> bool:
        """Whether it can be required by name."""
        return self.left >= max(1.0, self.class_left) and not self.blind


@dataclass(frozen=True)
class Table:
    """One recording: stamps, drive as recorded (plant's volts), displacement without and with noise
    [um], channels, rows that were kept and readings that are missing."""

    t_s: Floats
    u: Floats
    exact: Floats
    noise: Floats
    channels: dict[str, Floats]
    kept: Any
    missing: Any


@dataclass(frozen=True)
class Case:
    """A stage with its recordings by name (holdout included)."""

    plan: Plan
    hidden: tuple[Hidden, ...]
    stage: "Stage" = field(repr=False)
    chain: tuple[tuple[Effect, float], ...] = field(repr=False)
    tables: dict[str, Table] = field(repr=False)
    zero: float  # reading at rest [um]
    size: Size = field(repr=False)

    def recording(self, name: str, more: tuple[Effect, float] | None = None) -> Recording:
        """Return a recording as the tool gets it; more: one more effect in the stage."""
        table, rig = self.tables[name], self.plan.rig
        y = table.exact
        if more is not None:
            y = self.stage.read([*self.chain, more], name) + self.zero
        y = (y + table.noise) / rig.step_um
        y = np.round(y) * rig.step_um * rig.per_um
        y[table.missing] = np.nan
        drive = np.round(rig.low + table.u * rig.per_volt, 6)
        return Recording(
            t_s=table.t_s[table.kept], drive=drive[table.kept], displacement=y[table.kept],
            drive_unit=rig.drive_unit, displacement_unit=rig.unit,
            channels={k: v[table.kept] for k, v in table.channels.items()}, name=f"{name}.csv",
        )  # fmt: skip

    def given(self, more: tuple[Effect, float] | None = None) -> list[Recording]:
        """Return the recordings that the tool gets, without the held-out one."""
        return [self.recording(name, more) for name in self.tables if name != HELD]

    @property
    def noise(self) -> float:
        """Rms of the noise in the recordings' unit, including the reading's quantisation."""
        rig = self.plan.rig
        return float(np.hypot(rig.noise_um, rig.step_um / np.sqrt(12.0))) * rig.per_um


class Stage:
    """The chain of one stage: drive effects, hysteresis, stage effects, reading effects."""

    def __init__(
        self, hysteresis: Callable[[Floats], Floats], worlds: dict[str, World], every: int
    ) -> None:
        self.hysteresis, self.worlds, self.every = hysteresis, worlds, every

    @cached_property
    def bare(self) -> dict[str, Floats]:
        """Return the displacement without any effect, on the fine grid."""
        return {name: self.hysteresis(world.u) for name, world in self.worlds.items()}

    def read(self, chain: Sequence[tuple[Effect, float]], name: str) -> Floats:
        """Return the reading without noise, on the recorder's grid."""
        world = self.worlds[name]
        drive = world.u
        for effect, strength in chain:
            if effect.place == "drive":
                drive = effect.run(drive, world, strength)
        x = self.bare[name] if drive is world.u else self.hysteresis(drive)
        for place in ("stage", "reading"):
            for effect, strength in chain:
                if effect.place == place:
                    x = effect.run(x, world, strength)
        return x[world.t > -0.5 * world.h][:: self.every]

    def readings(self, chain: Sequence[tuple[Effect, float]]) -> Floats:
        """Return the readings of all recordings that the tool gets, end to end."""
        return np.concatenate([self.read(chain, n) for n in self.worlds if n != HELD])


def make_case(plan: Plan) -> Case:
    """Make the stage of a plan with its recordings; everything follows from the plan's seed."""
    rng = np.random.default_rng([plan.seed, 1])
    rig, dt = plan.rig, 1.0 / plan.rig.rate_hz
    every = max(LEAST_FINE, int(np.ceil(FINE_HZ * dt)))
    shape = HYSTERESES[plan.hysteresis](rng)
    effects = [EFFECTS[w.maker](rng, w.own, dt) for w in plan.effects]
    quiet_room = any(e.form == "warming up" for e in effects) or plan.before_s > 0
    worlds = {
        name: _world(rng, plan, i, every, quiet_room) for i, (name, _, _) in enumerate(plan.waves)
    }
    stage = Stage(lambda u: _from_rest(shape, u, rig.low < 0), worlds, every)
    seen = {n: (w.t > -0.5 * w.h) for n, w in worlds.items()}
    written = {n: np.round(w.u[seen[n]][::every], 4) for n, w in worlds.items()}
    nothing = stage.readings([])
    size = Size([u for n, u in written.items() if n != HELD], dt, nothing)
    noise = float(np.hypot(rig.noise_um, rig.step_um / np.sqrt(12.0)))
    class_left = rms(size.base.residual(nothing)) / noise
    chain: list[tuple[Effect, float]] = []
    for effect, wanted in zip(effects, plan.effects, strict=True):
        so_far = stage.readings(chain)

        def left(s: float, e: Effect = effect, before: Floats = so_far) -> float:
            return size.left(e.name, stage.readings([*chain, (e, s)]) - before)

        target = noise * max(wanted.size, ABOVE_CLASS * class_left)
        chain.append((effect, _solve(left, target, effect)))
    hidden = []
    for effect, strength in chain:  # with all others: a slew limit hides a resonance
        others = [other for other in chain if other[0] is not effect]
        difference = stage.readings(chain) - stage.readings(others)
        hidden.append(
            Hidden(
                effect.name, effect.form, ACTS_ON[effect.place],
                size.left(effect.name, difference) / noise, class_left,
                tuple(size.ties(effect.name, difference, noise * max(1.0, class_left))),
                effect.truth(strength),
                _is_blind(effect.truth(strength).get("frequency_hz", 0.0), plan),
            )
        )  # fmt: skip
    tables = {}
    zero = float(rng.choice([0.0, rng.uniform(-0.3, 0.5)]))
    for name, world in worlds.items():
        exact = stage.read(chain, name) + zero
        t = world.t[seen[name]][::every]
        given = {"temp_c": world.temp, "u2_v": world.u2}
        channels = {
            k: np.round(given[k][seen[name]][::every], 3 if k == "temp_c" else 4)
            for k in rig.channels
        }
        kept, missing = faults(rng, t.size, plan.fault if name != HELD else "", dt)
        hiss = noise_of(rng, t.size, rig, dt)
        tables[name] = Table(np.round(t, 9), written[name], exact, hiss, channels, kept, missing)
    return Case(plan, tuple(hidden), stage, tuple(chain), tables, zero, size)


def _is_blind(hz: float, plan: Plan) -> bool:
    """Return whether samples cannot show what is at a frequency, or to what it belongs."""
    return on_a_harmonic(hz, plan) or hz > plan.rig.rate_hz / 2.0


def on_a_harmonic(hz: float, plan: Plan) -> bool:
    """Return whether a line is too close to a multiple of the drive's frequency to resolve."""
    if plan.repeats_hz <= 0 or hz <= 0:
        return False
    off = abs(hz - plan.repeats_hz * round(hz / plan.repeats_hz))
    return off < 2.5 / min(seconds for name, _, seconds in plan.waves if name != HELD)


def _world(rng: np.random.Generator, plan: Plan, number: int, every: int, quiet: bool) -> World:
    dt = 1.0 / plan.rig.rate_hz
    _, drive, seconds = plan.waves[number]
    rows = round(seconds / dt)
    t = np.arange(rows * every + 1) * dt / every
    u, u2, temp = drive(rng, t, dt), drives.neighbour(rng, t, dt), drives.room(rng, t, quiet)
    if plan.before_s > 0:
        early = np.arange(-round(1.2 * plan.before_s / dt) * every, 0) * dt / every
        before = drives.step_to(early, float(u[0]), -plan.before_s, dt)
        t, u = np.r_[early, t], np.r_[before, u]
        u2, temp = np.r_[np.full(early.size, u2[0]), u2], np.r_[np.full(early.size, temp[0]), temp]
    return World(t, np.clip(u, 0.0, 10.0), temp, u2, plan.seed * 10 + number)


def _from_rest(shape: Callable[[Floats], Floats], u: Floats, bipolar: bool) -> Floats:
    """Run from 0 V; if the range has two signs, de-energised about its middle first."""
    if not bipolar:
        return shape(u)
    swing = np.linspace(1.0, 0.0, 800) * 4.9 * np.cos(np.arange(800) * 0.2)
    lead = np.r_[5.0 + swing, np.linspace(5.0, u[0], 50)]
    return shape(np.r_[lead, u])[lead.size :]


def _solve(size_of: Callable[[float], float], target: float, effect: Effect) -> float:
    """Find the strength that leaves the target, by secants in the logarithm, within limits."""
    s, low, high = effect.start, 0.0, effect.top
    for _ in range(10):
        size = size_of(s)
        if abs(size - target) < 0.05 * target:
            break
        low, high = (s, high) if size < target else (low, s)
        guess = s * float(np.clip(target / max(size, 1e-9), 0.1, 10.0)) ** 0.9
        if not low < guess < high:
            guess = high if high == effect.top and size < 0.5 * target else 0.5 * (low + high)
        if guess == s:
            break
        s = guess
    return s
