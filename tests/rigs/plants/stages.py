"""Stages for the proof: foreign hysteresis, hidden effects in foreign equations, by seed.

    stage = make_case(2007)          # everything follows from the seed
    write_case(stage, folder)        # identify.csv, check.csv, hold.csv, holdout.csv, truth.json

Seeds 1000 to 1999 are for tuning, 2000 and above for reporting only, 5000 and above repeat the
single effects in their textbook form (`own`), for the coverage of stated intervals.

How an effect is sized: `added_um` is the rms, over all samples of the three recordings that the
tool gets, of (displacement with the effect - displacement without), without noise. The strength
is solved so that it is 0.5, 1, 2 or 4 times the noise rms (1, 2, 4 or 8 for creep, drift and
clip, of which the refit takes most), or as near as the effect's plausible range allows.
`leftover_um` is the rms of that difference after a least-squares refit by a rich rate-independent
base: 25 plays of the drive with thresholds from 0 to 5 V, each in the powers 1 to 3, and an
offset for each recording. The bars are by leftover_um / noise_um.
"""

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from tests.rigs.plants import drives
from tests.rigs.plants.drives import DT, Floats
from tests.rigs.plants.effects import FINE, Effect, World
from tests.rigs.plants.effects_more import MAKERS, OUTSIDE
from tests.rigs.plants.hysteresis import CLASSES

TUNING, REPORT, OWN = 1000, 2000, 5000
SIZES = (2.0, 1.0, 4.0, 0.5)
TWICE = ("creep", "drift", "clip")  # the refit takes most of these: 1, 2, 4, 8 times the noise
GIVEN = ("identify", "check", "hold")
QUANTUM_UM = 5e-4
ABSORBED = ("asymmetry", "friction", "sensor")  # mostly inside a rate-independent base
PAIRABLE = tuple(name for name in MAKERS if name not in (*ABSORBED, "rate"))
OWN_FORMS = tuple(name for name in PAIRABLE if name != "clip")


@dataclass(frozen=True)
class Table:
    """One recording at 1 kHz; y_um is the reading with noise, exact_um without."""

    t_s: Floats
    u_v: Floats
    temp_c: Floats
    u2_v: Floats
    y_um: Floats
    exact_um: Floats


@dataclass(frozen=True)
class Hidden:
    """One hidden effect as it came out."""

    name: str
    form: str
    place: str
    wanted: float
    added_um: float
    leftover_um: float
    truth: dict[str, float]


@dataclass(frozen=True)
class Case:
    """One stage: what is hidden in it, and its recordings by name (holdout included)."""

    seed: int
    kind: str
    hysteresis: str
    noise_um: float
    hidden: tuple[Hidden, ...]
    leftover_um: float
    records: dict[str, Table] = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(h.name for h in self.hidden)


def plan(seed: int) -> tuple[str, tuple[str, ...], tuple[float, ...]]:
    """(kind, effect names, wanted sizes): of twenty seeds six are clean, nine hold one effect,
    three a pair, two an effect of no library."""
    if seed >= OWN:
        k = seed - OWN
        name = OWN_FORMS[k % len(OWN_FORMS)]
        return "own", (name,), ((1.0, 2.0, 4.0)[(k // len(OWN_FORMS)) % 3],)
    block, slot = divmod(seed % 1000, 20)
    if slot < 6:
        return "clean", (), ()
    if slot < 15:
        k = block * 9 + slot - 6
        names = tuple(MAKERS)
        return "single", (names[k % len(names)],), (SIZES[(k + k // len(names)) % 4],)
    if slot < 18:
        rng = np.random.default_rng([seed, 77])
        pair = tuple(str(n) for n in rng.choice(PAIRABLE, 2, replace=False))
        return "pair", pair, tuple(float(s) for s in rng.choice([1.0, 2.0, 4.0], 2))
    k = block * 2 + slot - 18
    return "outside", (tuple(OUTSIDE)[k % len(OUTSIDE)],), ((2.0, 4.0, 1.0)[k % 3],)


def _waveforms(rng: np.random.Generator) -> dict[str, Floats]:
    check = drives.triangle if rng.random() < 0.4 else drives.periodic
    if rng.random() < 0.2:
        check = drives.chirp
    made = {
        "identify": drives.multisine(rng, 12.0),
        "check": check(rng, 12.0),
        "hold": drives.holds(rng, 30.0),
        "holdout": drives.mixed(rng),
    }
    return {name: np.round(np.clip(u, 0.0, 10.0), 4) for name, u in made.items()}


def _fine(x: Floats) -> Floats:
    return np.interp(np.arange((x.size - 1) * FINE + 1) / FINE, np.arange(x.size), x)


Chain = Sequence[tuple[Effect, float]]


class _Stage:
    """The chain of one stage: drive effects, hysteresis, stage effects, reading effects."""

    def __init__(self, hysteresis: Callable[[Floats], Floats], worlds: dict[str, World]) -> None:
        self.hysteresis, self.worlds = hysteresis, worlds
        self.bare = {name: hysteresis(world.u) for name, world in worlds.items()}

    def read(self, chain: Chain, name: str) -> Floats:
        """The reading without noise, on the recorder's grid."""
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
        return x[::FINE]

    def added(self, chain: Chain) -> Floats:
        """What the chain adds to the bare stage, over the recordings that the tool gets."""
        return np.concatenate([self.read(chain, n) - self.bare[n][::FINE] for n in GIVEN])


def make_case(seed: int) -> Case:
    """The stage of this seed with its four recordings."""
    kind, names, sizes = plan(seed)
    rng = np.random.default_rng([seed, 1])
    which = str(rng.choice(list(CLASSES)))
    hysteresis = CLASSES[which](rng)
    noise, zero = float(rng.uniform(0.014, 0.05)), float(rng.choice([0.0, rng.uniform(-0.3, 0.5)]))
    effects = [({**MAKERS, **OUTSIDE})[name](rng, kind == "own") for name in names]
    waves = _waveforms(rng)
    constant = any(e.constant_room for e in effects)
    channels = {
        name: (
            np.round(drives.room(rng, u.size, constant), 3),
            np.round(drives.neighbour(rng, u.size), 4),
        )
        for name, u in waves.items()
    }
    worlds = {
        name: World(
            np.arange((u.size - 1) * FINE + 1) * DT / FINE,
            _fine(u), _fine(channels[name][0]), _fine(channels[name][1]), seed * 10 + i,
        )
        for i, (name, u) in enumerate(waves.items())
    }  # fmt: skip

    stage = _Stage(hysteresis, worlds)
    refit = _rich_refit([waves[name] for name in GIVEN])
    chain, hidden = [], []
    for effect, size in zip(effects, sizes, strict=True):
        size *= 2.0 if effect.name in TWICE else 1.0
        strength = _solve(lambda s, e=effect: _rms(stage.added([(e, s)])), size * noise, effect)
        difference = stage.added([(effect, strength)])
        chain.append((effect, strength))
        hidden.append(
            Hidden(
                effect.name, effect.form, effect.place, size, _rms(difference),
                _rms(refit(difference)), effect.truth(strength),
            )
        )  # fmt: skip
    records = {}
    for name, u in waves.items():
        exact = stage.read(chain, name) + zero
        y = exact + noise * rng.standard_normal(u.size)
        t = np.arange(u.size) * DT
        reading = np.round(y / QUANTUM_UM) * QUANTUM_UM
        records[name] = Table(t, u, channels[name][0], channels[name][1], reading, exact)
    left = _rms(refit(stage.added(chain))) if chain else 0.0
    return Case(seed, kind, which, noise, tuple(hidden), left, records)


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _solve(size_of: Callable[[float], float], target: float, effect: Effect) -> float:
    """Strength that adds the target, by secants in the logarithm, within the plausible range."""
    s = effect.start
    low, high = 0.0, effect.top
    for _ in range(14):
        size = size_of(s)
        if abs(size - target) < 0.02 * target:
            break
        if size < target:
            low = s
        else:
            high = s
        guess = s * float(np.clip(target / max(size, 1e-9), 0.1, 10.0)) ** 0.9
        if not low < guess < high:
            guess = high if high == effect.top and size < 0.5 * target else 0.5 * (low + high)
        if guess == s:
            break
        s = guess
    return s


@njit(cache=True, nogil=True)
def _dead_bands(u: Floats, halves: Floats) -> Floats:
    out = np.empty((u.size, halves.size))
    p = np.zeros(halves.size)
    for t in range(u.size):
        for i in range(halves.size):
            p[i] = max(u[t] - halves[i], min(u[t] + halves[i], p[i]))
            out[t, i] = p[i]
    return out


def rich_columns(u: Floats) -> Floats:
    """(N, 75): the plays of the module's text for a drive u (N,), in the powers 1 to 3."""
    halves = np.r_[0.0, np.exp(np.linspace(np.log(0.02), np.log(5.0), 24))]
    plays = _dead_bands(u, halves) / 5.0
    return np.hstack([plays, plays**2, plays**3])


def _rich_refit(waves: Sequence[Floats]) -> Callable[[Floats], Floats]:
    """Residual after the rich base of the module's text, as a function of the difference."""
    blocks = []
    for i, u in enumerate(waves):
        offsets = np.zeros((u.size, len(waves)))
        offsets[:, i] = 1.0
        blocks.append(np.hstack([rich_columns(u), offsets]))
    a = np.vstack(blocks)
    gram = a.T @ a
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-8
    factor = np.linalg.cholesky(gram)

    def residual(d: Floats) -> Floats:
        return d - a @ np.linalg.solve(factor.T, np.linalg.solve(factor, a.T @ d))

    return residual


def write_case(case: Case, folder: Path) -> None:
    """The files of a sealed case, and truth.json beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, r in case.records.items():
        columns = [("t_s", r.t_s, ".3f"), ("u_v", r.u_v, ".4f"), ("y_um", r.y_um, ".4f")]
        columns += [("temp_c", r.temp_c, ".3f"), ("u2_v", r.u2_v, ".4f")]
        if name == "holdout":
            del columns[2]
        with (folder / f"{name}.csv").open("w", newline="") as file:
            out = csv.writer(file, lineterminator="\n")
            out.writerow([c[0] for c in columns])
            out.writerows(zip(*([f"{v:{f}}" for v in x] for _, x, f in columns), strict=True))
    (folder / "truth.json").write_text(json.dumps(truth(case), indent=1))


def truth(case: Case) -> dict[str, Any]:
    """What is hidden, as plain data."""
    return {
        "seed": case.seed,
        "kind": case.kind,
        "hysteresis": case.hysteresis,
        "noise_um": case.noise_um,
        "leftover_um": case.leftover_um,
        "hidden": [vars(h) for h in case.hidden],
    }
