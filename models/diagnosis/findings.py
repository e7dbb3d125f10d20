"""From the search's last fit to named findings with shares, intervals, rivals, and a verdict."""

from collections.abc import Sequence

import numpy as np

from dehyst.models.diagnosis.ambiguity import Rival, rivals
from dehyst.models.diagnosis.candidates.interface import Candidate, small
from dehyst.models.diagnosis.crossval import HeldOut, by_blocks
from dehyst.models.diagnosis.decide import Search
from dehyst.models.diagnosis.evidence import constancy, contribution
from dehyst.models.diagnosis.fit import Effect, Problem, on_bound
from dehyst.models.diagnosis.intervals import intervals
from dehyst.models.diagnosis.locate import hot_spots, locate
from dehyst.models.diagnosis.result import Finding

STRUCTURE = 0.45  # excess over the noise (rms ratio) that counts as structure left over
EXPLAINED = 0.15  # part of the first excess power that may be left when things are explained
FINE = 2e-4  # of the displacement's range: misfit below this is no structure worth a name


def verdict_of(
    findings: Sequence[Finding], left: float, at_first: float, sigma: float, stroke: float
) -> str:
    """clean, explained, partly or unknown. left, at_first: rms excess over the noise, with all
    findings and without any."""
    structure = left > STRUCTURE * sigma and left > FINE * stroke
    if not findings:
        return "unknown" if structure else "clean"
    return "partly" if structure and left**2 > EXPLAINED * at_first**2 else "explained"


def named(
    problem: Problem, found: Search, held_null: HeldOut, held_final: HeldOut
) -> list[Finding]:
    """Findings of the accepted effects, strongest first; two of one kind are told as one."""
    final, data, sigma = found.accepted, problem.data, found.sigma
    whole = held_final.mean_square
    explainable = max(held_null.mean_square - sigma**2, 1e-30)
    values = intervals(problem, final, sigma)
    keys = {"_um": f"_{data.unit}", "_v_": f"_{data.drive_unit}_", "_v": f"_{data.drive_unit}"}
    out = []
    for i, effect in enumerate(final.effects):
        rest = [e for e in final.effects if e is not effect]
        without = by_blocks(problem, problem.solve(rest, problem.output_of(final))).mean_square
        x, r = contribution(problem, final, effect)
        steady = constancy(problem, sigma, x, r)
        near = rivals(found, effect)
        c = effect.candidate
        plain = {k: (v.value, v.unit) for k, v in values[i].items()}
        evidence = {
            "removed_rms": float(np.sqrt(max(without - whole, 0.0))),
            "spread": steady.spread,
        }
        for name, amount in zip(data.names, steady.by_recording, strict=True):
            evidence[f"amount_in_{name}"] = float(amount)
        out.append(
            Finding(
                name=c.name,
                key=c.key,
                place=c.place,
                title=c.title,
                equation=c.equation,
                source=c.source,
                share=float(np.clip((without - whole) / explainable, 0.0, 1.0)),
                evidence=evidence,
                parameters={_in_units(k, keys): v for k, v in values[i].items()},
                ambiguous_with=_other_names(c, near),
                where=hot_spots(locate(data, r, sigma)),
                says=c.says(plain) + _reservations(effect, near, steady.spread),
            )
        )
    return sorted(out, key=lambda f: -f.share)


def _in_units(key: str, units: dict[str, str]) -> str:
    """A parameter's key with the recordings' units in place of micrometres and volts."""
    if "_um" in key:
        return key.replace("_um", units["_um"], 1)
    if key.endswith("_v"):
        return key[:-2] + units["_v"]
    return key.replace("_v_", units["_v_"], 1)


def _other_names(c: Candidate, near: Sequence[Rival]) -> tuple[str, ...]:
    out: list[str] = []
    for r in near:
        if r.name != c.name and r.name not in out:
            out.append(r.name)
    return tuple(out)


def _reservations(effect: Effect, near: Sequence[Rival], spread: float) -> str:
    """What the sentence must add so that it does not promise too much."""
    c, text = effect.candidate, ""
    if any(r.name == c.name and r.place != c.place for r in near):
        text += " These recordings cannot tell whether it is the amplifier or the sensor."
    others = _other_names(c, near)
    if others:
        text += f" It could as well be {' or '.join(others)}."
    if spread > 0.5:
        text += " Its size is not the same everywhere: like it, unconfirmed."
    bounds = on_bound(effect)
    if bounds and c.name not in ("resonance", "clip"):
        text += f" Not identified here: {', '.join(bounds)}."
    return text


def unknown(left: float, at_first: float, where: dict[str, str], unit: str) -> Finding:
    """The finding for structure that nothing in the library explains."""
    places = "; ".join(f"{k.replace('_', ' ')}: {v}" for k, v in where.items())
    return Finding(
        name="unknown",
        key="unknown",
        place="",
        title="Unexplained structure",
        equation="",
        source="",
        share=float(np.clip(left**2 / max(at_first**2, 1e-30), 0.0, 1.0)),
        evidence={"left_rms": left},
        parameters={},
        ambiguous_with=(),
        where=where,
        says=(
            f"Something acts here that nothing in the library explains ({small((left, unit))} rms)"
            + (f"; it sits at {places}." if places else ", spread over everything.")
        ),
    )
