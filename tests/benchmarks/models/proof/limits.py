"""Tests of exclusion limits: the effect at that size, by the proof's own equations, in the data.

A limit says "an effect above this would have been seen". So the effect is added to the stage
slightly above (or below) the limit, the recordings are made again with the same noise, and the tool
diagnoses them. The limit is true if the tool names the effect, or lists it as a tie.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from tests.benchmarks.models.proof.stages import Case, on_a_harmonic
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.effects import (
    Effect,
    World,
    charge,
    delayed,
    linear_filter,
    low_pass,
    memory,
)
from tests.rigs.plants.effects_more import bristles

BEYOND = 1.05
Ask = Callable[[Case, tuple[Effect, float]], dict[str, Any]]


def checkable(limits: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the limits that have a value and whose effect can be added."""
    return [one for one in limits if bound(one) is not None and one["name"] in MAKERS]


def bound(limit: dict[str, Any]) -> float | None:
    """Return the value of a limit."""
    value = limit.get("above", limit.get("below"))
    return None if value is None else float(value)


def holds(case: Case, limit: dict[str, Any], ask: Ask, rng: np.random.Generator) -> dict[str, Any]:
    """Return whether a limit is true; ask: diagnosis.json of the case with one more effect. left:
    what a rich base leaves of the effect [rms of the noise]."""
    more = beyond(case, limit, rng)
    said = ask(case, more)
    without, stage = case.stage.readings(case.chain), case.stage
    left = case.size.left(limit["name"], stage.readings([*case.chain, more]) - without)
    names = [e["name"] for e in said["effects"]]
    ties = [tie for e in said["effects"] for tie in e.get("ambiguous_with") or []]
    side = "above" if "above" in limit else "below"
    return {
        "limit": f"{limit['name']} {side} {bound(limit):.4g} {limit['unit']}",
        "name": limit["name"],
        "left": left * case.plan.rig.per_um / case.noise,
        "true": limit["name"] in names or limit["name"] in ties,
        "answer": f"{said['verdict']}: {', '.join(names) or '-'}",
    }


def beyond(case: Case, limit: dict[str, Any], rng: np.random.Generator) -> tuple[Effect, float]:
    """Return the effect and its strength, in the plant's units, slightly beyond a limit."""
    value = bound(limit)
    assert value is not None
    if limit["name"] == "clip":  # a level, not an amount
        value -= 0.005 * 10.0 * case.plan.rig.per_volt
    else:
        value *= BEYOND if "above" in limit else 1.0 / BEYOND
    return MAKERS[limit["name"]](case, value, rng)


def _um(case: Case, value: float) -> float:
    return value / case.plan.rig.per_um


def _effect(name: str, place: str, run: Callable[[Floats, World, float], Floats]) -> Effect:
    return Effect(name, "at its limit", place, run, 0.0, np.inf, lambda s: {})


def _creep(case: Case, g: float, rng: np.random.Generator) -> tuple[Effect, float]:
    def run(x: Floats, w: World, s: float) -> Floats:
        return x + s * memory(x, np.log10(1.0 + (w.t - w.t[0]) / 0.1))

    return _effect("creep", "stage", run), g


def _delay(case: Case, d: float, rng: np.random.Generator) -> tuple[Effect, float]:
    return _effect("delay", "reading", lambda x, w, s: delayed(x, s, w.h)), d


def _lag(case: Case, tau: float, rng: np.random.Generator) -> tuple[Effect, float]:
    return _effect("lag", "reading", lambda x, w, s: low_pass(x, s, w.h)), tau


def _resonance(case: Case, hz: float, rng: np.random.Generator) -> tuple[Effect, float]:
    def run(x: Floats, w: World, s: float) -> Floats:
        n = 2 * np.pi * s
        return linear_filter([n * n], [1.0, 0.04 * n, n * n], x, w.h)

    return _effect("resonance", "stage", run), hz


def _slew(case: Case, rate: float, rng: np.random.Generator) -> tuple[Effect, float]:
    volts = rate / case.plan.rig.per_volt
    return _effect("slew", "drive", lambda x, w, s: charge(x, s, 0.0, 0.0, w.h)), volts


def _clip(case: Case, top: float, rng: np.random.Generator) -> tuple[Effect, float]:
    rig = case.plan.rig
    volts = (top - rig.low) / rig.per_volt
    return _effect("clip", "drive", lambda x, w, s: np.minimum(x, s)), volts


def _drift(case: Case, gain: float, rng: np.random.Generator) -> tuple[Effect, float]:
    return _effect("drift", "stage", lambda x, w, s: x + s * (w.temp - 22.0)), _um(case, gain)


def _hum(case: Case, size: float, rng: np.random.Generator) -> tuple[Effect, float]:
    nyquist = 0.5 * case.plan.rig.rate_hz
    hz = float(rng.choice([50.0, 60.0])) if nyquist > 150.0 else 0.3 * nyquist
    hz *= float(rng.uniform(0.97, 1.03))
    if on_a_harmonic(hz, case.plan):  # the limit excludes these frequencies
        hz += 0.5 * case.plan.repeats_hz
    phase = rng.random()

    def run(x: Floats, w: World, s: float) -> Floats:
        return x + s * np.sin(2 * np.pi * (hz * w.t + phase))

    return _effect("hum", "reading", run), _um(case, size)


def _coupling(case: Case, gain: float, rng: np.random.Generator) -> tuple[Effect, float]:
    return _effect("coupling", "stage", lambda x, w, s: x + s * (w.u2 - 5.0)), _um(case, gain)


def _stroke(case: Case) -> float:
    return max(float(np.ptp(t.exact)) for t in case.tables.values())


def _friction(case: Case, size: float, rng: np.random.Generator) -> tuple[Effect, float]:
    stroke = _stroke(case)

    def run(x: Floats, w: World, s: float) -> Floats:  # vanishes at speed: no Coulomb part
        tiny = 1e-9 * stroke
        z = bristles(x, tiny, 0.01 * stroke, 2.0 * stroke, w.h)
        return x - s * z / (0.01 * stroke)

    return _effect("friction", "stage", run), _um(case, size)


def _sensor(case: Case, size: float, rng: np.random.Generator) -> tuple[Effect, float]:
    period, phase = 0.2 * _stroke(case), 2 * np.pi * rng.random()

    def run(x: Floats, w: World, s: float) -> Floats:
        return x + s * np.sin(2 * np.pi * x / period + phase)

    return _effect("sensor", "reading", run), _um(case, size)


Maker = Callable[[Case, float, np.random.Generator], tuple[Effect, float]]
MAKERS: dict[str, Maker] = {
    "creep": _creep, "delay": _delay, "lag": _lag, "resonance": _resonance, "slew": _slew,
    "clip": _clip, "drift": _drift, "hum": _hum, "coupling": _coupling, "friction": _friction,
    "sensor": _sensor,
}  # fmt: skip
