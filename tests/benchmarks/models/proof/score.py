"""Score one case: what was reported against what is hidden, as plain data for the tables.

An answer is diagnosis.json, so that an answer made by hand can be judged as well. Names in `SHAPES`
are never spurious if the stage's loop is not the model's.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tests.benchmarks.models.proof.recorder import Rig
from tests.benchmarks.models.proof.stages import HELD, Case, Hidden

from dehyst.models.cascade.history import replay
from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.model import Block, Model

SHAPES = ("shape", "asymmetry", "sensor")
LOOPS = ("rate", "friction", "clip", "slew")  # these bend the loop too, so `shape` is true
IN_IT = {"slew": ("lag",), "friction": ("lag", "delay", "rate")}
"""What a plant's equation contains in addition to its name: the amplifier's resistor before the
current limit, the viscous part of a guide's friction. Naming that too is not spurious."""
OF_ONE_RECORDING = ("hum", "earlier_creep")
"""Blocks with a phase, or of a past move: the held-out recording has its own. A stage here that
warms up does so in each recording alike, including that one: the model's block for it is kept."""
HOLES = ("every third", "rows", "readings", "stalls")
SETTLED = 0.06  # share of the held-out recording that is not judged


@dataclass(frozen=True)
class Truth:
    """What may be expected of a case. names: effects of the library, separable first; shape:
    whether the loop is not the model's; outside: something that is in no library."""

    hidden: tuple[Hidden, ...]
    foreign: bool

    @property
    def physics(self) -> tuple[Hidden, ...]:
        """The effects that should be named and are not a matter of shape."""
        return tuple(h for h in self.hidden if h.name not in (*SHAPES, "unknown"))

    @property
    def outside(self) -> bool:
        return any(h.name == "unknown" for h in self.hidden)

    @property
    def bent(self) -> bool:
        """Whether `shape` would be true."""
        return self.foreign or any(h.name in (*SHAPES, *LOOPS) for h in self.hidden)

    def to_dict(self) -> dict[str, Any]:
        """Convert to plain data."""
        return {
            "hidden": [
                {
                    "name": h.name, "form": h.form, "acts_on": h.acts_on, "left": h.left,
                    "class_left": h.class_left, "separable": h.separable, "ties": list(h.ties),
                    "truth": h.truth,
                }
                for h in self.hidden
            ],
            "bent": self.bent,
            "outside": self.outside,
        }  # fmt: skip


def truth_of(case: Case) -> Truth:
    """Return what is hidden in a case."""
    return Truth(case.hidden, case.plan.hysteresis != "in the class")


def score(truth: Truth, said: dict[str, Any], rig: Rig) -> dict[str, Any]:
    """Score an answer. said: diagnosis.json."""
    effects = said["effects"]
    names = [e["name"] for e in effects]
    ties = {e["name"]: list(e.get("ambiguous_with") or []) for e in effects}
    physics = [n for n in names if n not in (*SHAPES, "unknown")]
    asked = [h for h in truth.physics if h.separable]
    there = {h.name for h in truth.physics}
    fair = there | {n for h in truth.physics for n in (*h.ties, *_in_it(h))}
    spurious = [n for n in physics if n not in fair]
    if not truth.bent:
        spurious += [n for n in names if n in SHAPES]
    first = next(iter([*physics, *names]), "")
    got = [h.name for h in asked if _named(h, names, ties)]
    return {
        "asked": [h.name for h in asked],
        "got": got,
        "first": first,
        "first_right": bool(asked) and any(_right(h, first, ties) for h in asked),
        "spurious": spurious,
        "said": [n for n in names if n != "unknown"],
        "shape": any(n in SHAPES for n in names),
        "reported": said["verdict"] in ("unknown", "partly") or "unknown" in names,
        "acts_on": [
            e["acts_on"] == h.acts_on for e in effects for h in asked if e["name"] == h.name
        ],
        "parameters": [
            p
            for h in truth.physics
            for e in effects
            if e["name"] == h.name and [x.name for x in truth.physics].count(h.name) == 1
            for p in inside(h, e["parameters"], rig)
        ],
        "contradicted": contradicted(truth, said.get("would_have_seen") or [], names, rig),
        "rules": broken_rules(said),
    }


def _in_it(h: Hidden) -> tuple[str, ...]:
    return () if h.truth else IN_IT.get(h.name, ())  # textbook forms contain nothing else


def _right(h: Hidden, first: str, ties: dict[str, list[str]]) -> bool:
    """Return whether the effect is first by its own name; or by its double, if the judge cannot
    distinguish them either and the answer reports the tie."""
    return first == h.name or (first in h.ties and h.name in ties.get(first, []))


def _named(h: Hidden, names: Sequence[str], ties: dict[str, list[str]]) -> bool:
    return any(_right(h, name, ties) for name in names)


def inside(h: Hidden, stated: dict[str, Any], rig: Rig) -> list[dict[str, Any]]:
    """Return the true parameters that have a counterpart with an interval."""
    out = []
    for key, value in h.truth.items():
        true, found = converted(key, value, rig), _stated(key, stated)
        if found is None or found.get("low") is None or found.get("high") is None:
            continue
        held = bool(found["low"] <= true <= found["high"])
        out.append(
            {
                "key": f"{h.name}.{key}", "true": true, "value": found["value"],
                "low": found["low"], "high": found["high"], "inside": held,
            }
        )  # fmt: skip
    return out


WIDEST = 10.0  # largest factor that a finding's interval may span


def broken_rules(said: dict[str, Any]) -> list[str]:
    """Return where an answer breaks the general rules for answers, whatever is hidden."""
    out = []
    effects, limits = said["effects"], said.get("would_have_seen") or []
    tied = {tie for e in effects for tie in e.get("ambiguous_with") or []}
    stated = [x["name"] for x in limits if x.get("above", x.get("below")) is not None]
    if stated and said["verdict"] in ("unknown", "partly"):
        out.append(f"limits under the verdict {said['verdict']}")
    out += [f"a limit for {n}, which is in a tie" for n in stated if n in tied]
    out += [f"a limit for {e['name']}, which is named" for e in effects if e["name"] in stated]
    if sum(e.get("share") or 0.0 for e in effects) > 1.005:
        out.append("shares of more than 100 %")
    for e in effects:
        for key, p in e["parameters"].items():
            low, high = p.get("low"), p.get("high")
            if low is None or high is None or low * high <= 0:
                continue
            if max(high / low, low / high) > WIDEST:
                out.append(f"{e['name']}.{key} from {low:.3g} to {high:.3g}")
    return out


KEYS = {
    "rate": r"rate_.*_per_s", "max": r"max_.*", "amplitude": r"amplitude_.*",
    "expansion": r"expansion_.*", "gain_per_unit": r"gain_.*_per_unit",
}  # fmt: skip


def _stated(key: str, stated: dict[str, Any]) -> Any:
    pattern = KEYS.get(key, re.escape(key))
    return next((v for k, v in stated.items() if re.fullmatch(pattern, k)), None)


def converted(key: str, value: float, rig: Rig) -> float:
    """Convert a parameter of the plant (V, um) to the recording's units."""
    if key == "rate":
        return value * rig.per_volt
    if key == "max":
        return rig.low + value * rig.per_volt
    if key in ("amplitude", "expansion", "gain_per_unit"):
        return value * rig.per_um
    return value


LIMITED = {
    "delay": "delay_s", "lag": "tau_s", "creep": "gain_per_decade", "hum": "amplitude",
    "drift": "expansion", "slew": "rate", "clip": "max", "coupling": "gain_per_unit",
    "resonance": "frequency_hz",
}  # fmt: skip


def contradicted(
    truth: Truth, limits: Sequence[dict[str, Any]], names: Sequence[str], rig: Rig
) -> list[str]:
    """Return limits that the hidden effects prove false: exceeded, and not named."""
    out = []
    for h in truth.physics:
        key = LIMITED.get(h.name, "")
        if key not in h.truth or h.name in names:
            continue
        true = abs(converted(key, h.truth[key], rig))
        for one in limits:
            if one["name"] != h.name:
                continue
            above, below = one.get("above"), one.get("below")
            if (above is not None and true > above) or (below is not None and true < below):
                bound = f"above {above}" if above is not None else f"below {below}"
                out.append(f"{h.name} {bound} {one['unit']}, and {true:.4g} is there")
    return out


def figures(case: Case, diagnosis: Diagnosis) -> dict[str, Any]:
    """Return errors against the exact displacement, in rms of the noise: the model in use on the
    given recordings, and both on the held-out recording (offset and phases of named lines
    refitted)."""
    said, base = diagnosis.to_dict(), diagnosis.base_model
    lines = tuple(
        float(p["value"])
        for e in said["effects"]
        if e["name"] == "hum"
        for key, p in e["parameters"].items()
        if key.startswith("frequency")
    )
    given = [name for name in case.tables if name != HELD]
    errors = np.concatenate([_error(case, name, base, ()) for name in given])
    out = {"model": float(np.sqrt(np.mean(errors**2)))}
    for key, model in (("held_model", base), ("held_augmented", diagnosis.model)):
        error = _error(case, HELD, model, lines)
        out[key] = float(np.std(error[int(SETTLED * error.size) :]))
    noise = case.noise
    return {k: v / noise for k, v in out.items()} | {
        "noise": noise,
        "noise_said": said["noise"]["rms"] / noise,
        "disagrees": disagreement(case, diagnosis),
    }


def disagreement(case: Case, diagnosis: Diagnosis) -> float:
    """Return the largest factor between a reported rms error and that of the written model after
    the history that fits, both about their mean and over the samples that count; 1 if rows are
    missing."""
    worst, stated = 1.0, diagnosis.to_dict()["rms"]
    if case.plan.fault.startswith(HOLES):
        return worst
    for recording, view in zip(case.given(), diagnosis.views, strict=True):
        assert recording.displacement is not None
        for key, model in (("model", diagnosis.base_model), ("augmented", diagnosis.model)):
            y = replay(
                model,
                recording.t_s,
                recording.drive,
                recording.channels,
                recording.displacement,
            ).predicted
            left = recording.displacement - y
            error = float(np.std(left[view.counted]))
            ratio = error / max(stated[key][recording.name], 1e-12)
            worst = max(worst, ratio, 1.0 / max(ratio, 1e-12))
    return worst


def _error(case: Case, name: str, model: Model, lines: tuple[float, ...]) -> Any:
    """Return the exact displacement minus the model's, without its mean, the lines at any phase,
    and creep of an earlier move at any size."""
    table, rig = case.tables[name], case.plan.rig
    drive = rig.low + table.u * rig.per_volt

    def run(blocks: list[Block]) -> Any:
        return simulate(replace(model, blocks=tuple(blocks)), table.t_s, drive, table.channels)

    blocks = [b for b in model.blocks if b.kind not in OF_ONE_RECORDING]
    plain = run(blocks)
    error = table.exact * rig.per_um - plain
    columns = [np.ones(error.size)]
    columns += [run([*blocks, b]) - plain for b in model.blocks if b.kind == "earlier_creep"]
    for f in lines:
        columns += [np.sin(2 * np.pi * f * table.t_s), np.cos(2 * np.pi * f * table.t_s)]
    a = np.column_stack(columns)
    return error - a @ np.linalg.lstsq(a, error, rcond=None)[0]
