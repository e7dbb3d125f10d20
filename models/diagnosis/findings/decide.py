"""Turn the search's last fit into named findings with shares, intervals and rivals, a verdict, and
a proposal of what to record next."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from dehyst.models.diagnosis.data.locate import hot_spots, locate
from dehyst.models.diagnosis.effects import Effect, parameters_at_bound
from dehyst.models.diagnosis.evidence import (
    Constancy,
    blockwise_held_out_error,
    constancy,
    contribution,
)
from dehyst.models.diagnosis.findings.growth import Growth, growth
from dehyst.models.diagnosis.findings.reported import unidentified
from dehyst.models.diagnosis.findings.rivals import RivalEffect, rivals
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.intervals import intervals
from dehyst.models.diagnosis.judge import SearchState
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import PHYSICS
from dehyst.models.physics.candidate import Candidate, format_length
from dehyst.models.signals.joined import Data


def has_unknown(findings: Sequence[Finding]) -> bool:
    """Return whether something is reported that no finding explains."""
    return any(f.name == "unknown" for f in findings)


def decide_verdict(
    findings: Sequence[Finding], left: float, at_first: float, any_loop: float, floor: float
) -> str:
    """Return clean, explained, partly or unknown. Rms beyond the noise: left, at_first: of the
    augmented model and of the model in use; any_loop: of a loop of any shape without physics,
    against which the explained part is measured. floor: rms of the noise, or the smallest error of
    any base. Where the stage itself changed, not all is explained."""
    structure = TUNING.strong * floor
    if not findings:
        return "unknown" if at_first > structure else "clean"
    if has_unknown(findings):
        return "unknown" if all(f.name == "unknown" for f in findings) else "partly"
    if left <= TUNING.clear * floor or left**2 <= TUNING.crumb * at_first**2:
        return "explained"
    if all(f.name == "shape" for f in findings):
        return "partly" if left > structure else "explained"
    part = TUNING.minor if left > structure else TUNING.half
    return "partly" if left**2 > part * any_loop**2 else "explained"


def report_effects(problem: Problem, found: SearchState, held: float) -> list[Finding]:
    """Return the findings of the accepted effects. share: mean square that each removes from
    held-out samples, later scaled to a share of the whole. held: mean square that all leave."""
    final, data, sigma = found.accepted, problem.data, found.sigma
    values = intervals(problem, final, sigma)
    keys = {"_um": f"_{data.unit}", "_v_": f"_{data.drive_unit}_", "_v": f"_{data.drive_unit}"}
    out = []
    for i, effect in enumerate(final.effects):
        rest = [e for e in final.effects if e is not effect]
        without = blockwise_held_out_error(problem, problem.without(final, effect))
        x, r = contribution(problem, final, effect)
        steady = constancy(problem, sigma, x, r)
        near = rivals(found, effect)
        if (span := effect.span) is None:
            changed = growth(data, sigma, x, r)
        else:
            sizes = (0.0, 1.0) if span.begins else (1.0, 0.0)
            changed = Growth(data.names[span.recording], span.at_s, *sizes)
        c = effect.candidate
        others = _other_names(c, near, rest)
        plain = {k: (v.value, v.unit) for k, v in values[i].items()}
        wide = unidentified(effect, values[i])
        evidence = {
            "removed_rms": float(np.sqrt(max(without - held, 0.0))),
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
                share=max(without - held, 0.0),
                evidence=evidence,
                parameters={_in_units(k, keys): v for k, v in values[i].items() if k not in wide},
                ambiguous_with=others,
                where={**hot_spots(locate(data, r, sigma)), **(changed.where if changed else {})},
                says=c.describe(plain) + _reservations(effect, near, others, steady, changed, wide),
            )
        )
    return out


def distribute_share(findings: Sequence[Finding], removed: float) -> list[Finding]:
    """Return the findings in rank order, with shares that add up to `removed`, the share of the
    explainable misfit that all remove together."""
    total = max(sum(f.share for f in findings), 1e-300) * (1.0 + 1e-12)  # rounded, still within 1
    return sort_by_strength([replace(f, share=removed * f.share / total) for f in findings])


def sort_by_strength(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings strongest first; of equal share, as they were given."""
    return sorted(findings, key=lambda f: -f.share)


def _in_units(key: str, units: dict[str, str]) -> str:
    """Return a parameter's key with the recordings' units in place of micrometres and volts."""
    if "_um" in key:
        return key.replace("_um", units["_um"], 1)
    if key.endswith("_v"):
        return key[:-2] + units["_v"]
    return key.replace("_v_", units["_v_"], 1)


def _other_names(
    c: Candidate, near: Sequence[RivalEffect], beside: Sequence[Effect]
) -> tuple[str, ...]:
    """Return the names that would do as well. A drift found together with creep may be that creep's
    own past, in a form other than the library's."""
    names = [r.name for r in near]
    if c.is_last_resort:
        names += [e.candidate.name for e in beside if e.candidate.name in c.confused_with]
    return tuple(dict.fromkeys(n for n in names if n != c.name))


def _reservations(
    effect: Effect,
    near: Sequence[RivalEffect],
    others: Sequence[str],
    steady: Constancy,
    changed: Growth | None,
    wide: Sequence[str],
) -> str:
    """Return the reservations that the sentence needs so that it does not claim too much."""
    c, text = effect.candidate, ""
    if any(r.name == c.name and r.place != c.place for r in near):
        text += " These recordings cannot show whether it is the amplifier or the sensor."
    if others:
        text += f" It could also be {' or '.join(others)}."
    if changed is not None:
        text += f" {changed.says}"
    elif steady.spread > TUNING.half:
        text += " Its size is not constant, so treat it as unconfirmed."
    bounds = list(dict.fromkeys([*parameters_at_bound(effect), *wide]))
    if bounds and c.reports_bounds:
        text += f" Not identified here: {', '.join(bounds)}."
    return text


WHERE = {
    "drive": "of the drive",
    "rate": "of its rate",
    "since_turn": "after a reversal",
    "in_hold": "into a hold",
}
"""What the tables of `locate` are about, after "40% at 5.7 to 6 V"; others say it themselves."""


def report_unknown(
    left: float, share: float, where: dict[str, str], unit: str, when: str = ""
) -> Finding:
    """Return the finding for structure that nothing in the library explains. left: rms; share:
    share of the explainable misfit; when: text on when it occurs."""
    places = ", ".join(f"{v} {WHERE.get(k, '')}".rstrip() for k, v in where.items())
    nowhere = "." if when else ", spread over the whole recording."
    return Finding(
        name="unknown",
        key="unknown",
        place="",
        title="Unexplained structure",
        equation="",
        source="",
        share=share,
        evidence={"left_rms": left},
        parameters={},
        ambiguous_with=(),
        where=where,
        says=(
            f"No effect in the library explains this part ({format_length((left, unit))} rms)"
            + (f"; {when}" if when else "")
            + (f"; of this, {places}." if places else nowhere)
        ),
    )


def _recorded_limits(data: Data) -> str:
    """Return the options of `dehyst excite` for a drive of the range, rate and length that were
    recorded."""
    samples = max(int(np.bincount(data.rec).max()), 2 * TUNING.least_samples)
    unit = "" if data.drive_unit == "v" else f" --unit {data.drive_unit}"
    return (
        f"--range {data.u_min:.4g} {data.u_min + data.span:.4g}{unit} "
        f"--sampling {1.0 / data.period:.4g} --duration {samples * data.period:.4g}"
    )


def next_experiment(
    verdict: str, findings: Sequence[Finding], blind: Sequence[str], data: Data
) -> str:
    """Return what to record next, in one sentence. blind: names that the recordings could not
    show; data: what was recorded, whose range, rate and length the experiment keeps to."""
    apart = {
        frozenset({one.name, rival}): drive
        for one in PHYSICS.values()
        for rival, drive in one.distinguished_by.items()
    }
    for f in findings:
        # a shape has no experiment of its own: distinguish its possible causes
        for one, other in combinations((f.name, *f.ambiguous_with), 2):
            text = apart.get(frozenset({one, other}))
            if text:
                return (
                    f"To distinguish {one} from {other}, record {text} "
                    f"(`dehyst excite --separate {one} {other} {_recorded_limits(data)} "
                    "-o separate.csv`)."
                )
    if verdict in ("unknown", "partly"):
        return (
            "Record the same drive twice: what repeats comes from the stage, what does not from "
            "its surroundings; then log further channels (temperature, neighbouring axes, force)."
        )
    if blind:
        return (
            f"These recordings cannot show {', '.join(blind)}; steps, holds of several seconds "
            "and a fast chirp over the full range can."
        )
    if findings:
        return "Track with the augmented model, record again and diagnose that recording."
    return (
        "No further experiment is needed; diagnose again after a change of amplifier, sensor, "
        "load or mounting."
    )
