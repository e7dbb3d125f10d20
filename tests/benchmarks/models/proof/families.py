"""The families of cases: which stage, which effects, which rig, which waveforms; all by seed.

A case is named by its family and number ("past-3") and follows from these and the run's seed alone,
so that any one can be made again. A family is a function of (random numbers, number) that returns
what its plan has in addition to the defaults. `COUNTS` is the full proof's share of each; those of
"hardware" (servos and recorders like real hardware) have no plan, and are made by `hardware.py`.
"""

import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from tests.benchmarks.models.proof.recorder import Rig
from tests.benchmarks.models.proof.stages import FOREIGN, HELD, OUTSIDE, PARTED, Plan, Wanted
from tests.rigs.plants import drives
from tests.rigs.plants.effects_shape import SHAPES

Rng = np.random.Generator
SINGLES = (
    "creep", "resonance", "delay", "lag", "slew", "clip", "drift", "hum", "coupling", "rate",
    "friction",
)  # fmt: skip
TOGETHER = ("creep", "resonance", "delay", "lag", "slew", "drift", "hum", "coupling")
ALIKE = ({"delay", "lag"}, {"lag", "slew"}, {"delay", "slew"})  # never requested together
COUNTS = {
    "single": 33, "shape": 24, "past": 18, "part": 14, "pair": 18, "triple": 10, "quiet": 12,
    "waveform": 11, "slow": 8, "units": 10, "faults": 12, "clean": 16, "outside": 14,
    "hardware": 36,
}  # fmt: skip
ROWS = 34_000  # approximate total of the three recordings that the tool gets


HARDWARE = "hardware"


def cases(count: int, families: Sequence[str] = ()) -> list[str]:
    """Return `count` names of cases of these families (all: in the proof's shares), mixed."""
    wanted = list(families) or list(COUNTS)
    places = []
    for order, family in enumerate(wanted):
        places += [((k + 0.5) / COUNTS[family], order, f"{family}-{k}") for k in range(count)]
    places.sort()
    return [name for _, _, name in places[:count]]


def plans(seed: int, count: int, families: Sequence[str] = ()) -> list[Plan]:
    """Return the same as plans, for the families that have one."""
    return [plan(seed, *parse(name)) for name in cases(count, families or list(FAMILIES))]


def plan(seed: int, family: str, number: int) -> Plan:
    """Return the plan of one case."""
    own = zlib.crc32(f"{seed}/{family}/{number}".encode())
    rng = np.random.default_rng(own)
    rig = Rig(noise_um=float(rng.uniform(0.014, 0.05)))
    given: dict[str, Any] = {"rig": rig, "hysteresis": _foreign(rng), "effects": ()}
    given.update(FAMILIES[family](rng, number))
    given.setdefault("waves", _usual(rng, given["rig"]))
    return Plan(f"{family}-{number}", family, own, **given)


def parse(case: str) -> tuple[str, int]:
    """Split "past-3" into family and number. Raises ValueError."""
    family, _, number = case.rpartition("-")
    if family not in COUNTS or not number.isdigit():
        raise ValueError(f"{case}: no such case; families: {', '.join(COUNTS)}")
    return family, int(number)


def _foreign(rng: Rng) -> str:
    return str(rng.choice(list(FOREIGN)))


def _effect(rng: Rng, name: str, own: bool = False, low: float = 1.2, high: float = 6.0) -> Wanted:
    """Return an effect of random size; creep, most of which a base absorbs, is not enlarged."""
    if name == "creep":
        low, high = 1.1, max(1.2, 0.4 * high)
    return Wanted(name, float(np.exp(rng.uniform(np.log(low), np.log(high)))), own)


def _usual(rng: Rng, rig: Rig, rows: int = ROWS) -> tuple[Any, ...]:
    """Return a multisine, a periodic drive or a sweep, holds; and another multisine, held out."""
    dt = 1.0 / rig.rate_hz
    kinds = (drives.triangle, drives.periodic, drives.periodic, drives.chirp)
    check = kinds[int(rng.integers(len(kinds)))]
    return (
        ("identify", drives.multisine, 0.27 * rows * dt),
        ("check", check, 0.23 * rows * dt),
        ("hold", drives.holds, 0.5 * rows * dt),
        (HELD, drives.mixed, 0.3 * rows * dt),
    )


def single(rng: Rng, number: int) -> dict[str, Any]:
    """Every name in turn; half of them in textbook form."""
    name = SINGLES[number % len(SINGLES)]
    if name == "drift" and rng.random() < 0.3:
        name = "warm-up"
    return {"effects": (_effect(rng, name, (number // len(SINGLES)) % 2 == 0),)}


def shape(rng: Rng, number: int) -> dict[str, Any]:
    """A bend of each kind on a stage of the library's class; every second one is of another."""
    if number % 2:
        return {"hysteresis": tuple(FOREIGN)[(number // 2) % len(FOREIGN)]}
    bend = tuple(SHAPES)[(number // 2) % len(SHAPES)]
    return {"hysteresis": "in the class", "effects": (_effect(rng, bend, False, 2.0, 8.0),)}


def past(rng: Rng, number: int) -> dict[str, Any]:
    """The stage was moved 0.5 to 15 s before the recording, and has been creeping or warming since;
    every sixth one does neither."""
    before = float(rng.choice([0.5, 1.0, 1.0, 3.0, 15.0]))
    level = float(rng.uniform(4.0, 7.5))
    swing = float(rng.uniform(0.3, 0.9)) * min(level, 10.0 - level)
    kind = ("creep", "creep", "warm-up", "creep", "warm-up", "")[number % 6]
    scan = drives.small_scan(level, swing)
    waves = (("scan-1", scan, 12.0), ("scan-2", scan, 16.0), (HELD, scan, 8.0))
    effects = (_effect(rng, kind, False, 1.5, 8.0),) if kind else ()
    return {"effects": effects, "waves": waves, "before_s": before}


def part(rng: Rng, number: int) -> dict[str, Any]:
    """Hum for a third of the time, a slip, a gain that changes in mid-record, play that appears."""
    names = (*PARTED, "hum for a third", "gain step", "loosened")
    return {"effects": (_effect(rng, names[number % len(names)], False, 1.5),)}


def pair(rng: Rng, number: int, count: int = 2) -> dict[str, Any]:
    """Two effects that cannot be mistaken for each other."""
    while True:
        names = [str(n) for n in rng.choice(TOGETHER, count, replace=False)]
        if not any(alike <= set(names) for alike in ALIKE):
            break
    own = bool(number % 2)
    return {"effects": tuple(_effect(rng, n, own, 1.5) for n in names)}


def triple(rng: Rng, number: int) -> dict[str, Any]:
    """Three such effects."""
    return pair(rng, number, 3)


def quiet(rng: Rng, number: int) -> dict[str, Any]:
    """Noise of at most 1e-4 of the span, so that the misfit of the loop's class exceeds it."""
    rate = float(rng.choice([1000.0, 2000.0, 5000.0]))
    noise = 10.0 * float(np.exp(rng.uniform(np.log(2e-5), np.log(1.2e-4))))
    rig = Rig(rate_hz=rate, noise_um=noise, step_um=noise / 8.0, channels=())
    name = ("", "resonance", "", "lag", "creep", "")[number % 6]
    effects = (_effect(rng, name, False, 1.5, 4.0),) if name else ()
    return {"rig": rig, "effects": effects, "waves": _usual(rng, rig)}


def waveform(rng: Rng, number: int) -> dict[str, Any]:
    """One sine or triangle, 0.5 to 2 Hz, 12 to 60 s; every third one has hum, creep or a lag."""
    hz = float(rng.choice([0.5, 1.0, 2.0, rng.uniform(0.5, 2.0)]))
    seconds = float(rng.choice([12.0, 30.0, 50.0]))
    if number % 2:
        drive = drives.triangle_at(hz, float(rng.uniform(7.0, 9.7)))
    else:
        drive = drives.sine_at(hz)
    name = ("hum", "creep", "lag")[(number // 3) % 3] if number % 3 == 2 else ""
    effects = (_effect(rng, name, False, 1.5),) if name else ()
    waves = (("run", drive, seconds), (HELD, drive, 8.0))
    return {"effects": effects, "waves": waves, "repeats_hz": hz}


def slow(rng: Rng, number: int) -> dict[str, Any]:
    """Sines of 5 and 10 Hz, sampled at 50 Hz (every second one at 100 Hz)."""
    rig = Rig(rate_hz=50.0 if number % 2 else 100.0, noise_um=0.02, channels=())
    name = ("delay", "", "lag", "hum")[number // 2 % 4]
    whole = bool(number % 3)
    sines = drives.sine_at(*(5.0, 10.0) if whole else (5.0 * rng.uniform(0.9, 1.1), 8.1))
    effects = (_effect(rng, name, True, 2.0, 10.0),) if name else ()
    waves = (("sines", sines, 60.0), ("again", sines, 40.0), (HELD, sines, 20.0))
    hz = 5.0 if whole else 0.0
    return {"rig": rig, "effects": effects, "waves": waves, "repeats_hz": hz}


RIGS: tuple[dict[str, Any], ...] = (
    {"drive_unit": "v", "high": 100.0, "unit": "nm", "per_um": 1000.0},
    {"drive_unit": "v", "high": 150.0, "unit": "um", "per_um": 12.0},
    {"drive_unit": "v", "low": -10.0, "high": 10.0, "unit": "v", "per_um": 0.1},
    {"drive_unit": "v", "low": -75.0, "high": 75.0, "unit": "counts", "per_um": 2500.0},
    {"drive_unit": "um", "high": 20.0, "unit": "um", "per_um": 2.0, "rate_hz": 10_000.0},
)


def units(rng: Rng, number: int) -> dict[str, Any]:
    """Other units, ranges, signs and rates; every third one has no effect."""
    rig = Rig(noise_um=float(rng.uniform(0.005, 0.04)), **RIGS[number % len(RIGS)])
    name = "" if number % 3 == 2 else str(rng.choice(TOGETHER))
    effects = (_effect(rng, name, True),) if name else ()
    return {"rig": rig, "effects": effects, "waves": _usual(rng, rig)}


FAULTS = (
    "every third reading missing", "stalls", "coarse steps", "coloured noise", "rows missing",
    "readings missing in blocks",
)  # fmt: skip


def faults(rng: Rng, number: int) -> dict[str, Any]:
    """Faults of the recorder; every second one also has an effect."""
    fault = FAULTS[number % len(FAULTS)]
    noise = float(rng.uniform(0.014, 0.04))
    rig = Rig(noise_um=noise)
    if fault == "coarse steps":
        rig = Rig(noise_um=0.3 * noise, step_um=float(rng.uniform(3.0, 5.0)) * noise)
    if fault == "coloured noise":
        rig = Rig(noise_um=noise, corner_hz=float(rng.uniform(3.0, 40.0)))
    name = str(rng.choice(["creep", "hum", "lag", "coupling"])) if (number // 6) % 2 else ""
    effects = (_effect(rng, name, False, 2.0),) if name else ()
    return {"rig": rig, "effects": effects, "fault": fault}


def clean(rng: Rng, number: int) -> dict[str, Any]:
    """Nothing hidden: half of them in the library's class, half not."""
    return {"hysteresis": "in the class" if number % 2 else _foreign(rng)}


def outside(rng: Rng, number: int) -> dict[str, Any]:
    """Effects that are not in any library."""
    return {"effects": (_effect(rng, tuple(OUTSIDE)[number % len(OUTSIDE)], False, 1.5),)}


FAMILIES: dict[str, Callable[[Rng, int], dict[str, Any]]] = {
    f.__name__: f
    for f in (
        single, shape, past, part, pair, triple, quiet, waveform, slow, units, faults, clean,
        outside,
    )
}  # fmt: skip
