"""From the search's last fit to named findings with shares, intervals and rivals, to a verdict, and
to what should be recorded next."""

from collections.abc import Sequence

import numpy as np

from dehyst.models.diagnosis.effects import Effect, on_bound
from dehyst.models.diagnosis.evidence import HeldOut, by_blocks, constancy, contribution
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.intervals import intervals
from dehyst.models.diagnosis.judge import SearchState
from dehyst.models.diagnosis.locate import hot_spots, locate
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.rivals import Rival, rivals
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import PHYSICS
from dehyst.models.physics.candidate import Candidate, small


def verdict_of(
    findings: Sequence[Finding], left: float, at_first: float, sigma: float, stroke: float
) -> str:
    """clean, explained, partly or unknown. left, at_first: rms excess over the noise, with all
    findings and without any."""
    structure = left > TUNING.structure_left * sigma and left > TUNING.fine_structure * stroke
    if not findings:
        return "unknown" if structure else "clean"
    return "partly" if structure and left**2 > TUNING.explained_left * at_first**2 else "explained"


def named(
    problem: Problem, found: SearchState, held_null: HeldOut, held_final: HeldOut
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
    if bounds and c.bounds_told:
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


def next_experiment(verdict: str, findings: Sequence[Finding], blind: Sequence[str]) -> str:
    """What to record next, in one sentence. blind: names that the recordings could not show."""
    apart = {
        frozenset({one.name, rival}): drive
        for one in PHYSICS.values()
        for rival, drive in one.told_from.items()
    }
    for f in findings:
        for rival in f.ambiguous_with:
            text = apart.get(frozenset({f.name, rival}))
            if text:
                return (
                    f"To tell {f.name} from {rival}, record {text} "
                    f"(dehyst excite --separate {f.name} {rival})."
                )
    if verdict in ("unknown", "partly"):
        return (
            "Record the same drive twice: what repeats is the stage, what does not is its "
            "surroundings; then log further channels (temperature, the neighbouring axes, force)."
        )
    if blind:
        return (
            f"These recordings cannot show {', '.join(blind)}; steps, holds of some seconds and a "
            "fast chirp over the full range would."
        )
    if findings:
        return "Track with the augmented model, record again and diagnose that recording."
    return "None is needed; diagnose again after a change of amplifier, sensor, load or mounting."
