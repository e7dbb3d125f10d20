"""Output of `dehyst bench`: the error of each model on each case, and a description of the
models."""

import math
from collections.abc import Sequence
from statistics import median
from typing import Any

from dehyst.daemon.benchmark.rivals.interface import Rival
from dehyst.daemon.benchmark.rivals.table import THIS
from dehyst.daemon.benchmark.run import Score

REFERENCE = "classical PI"  # model whose cost is 1
TIE = 1.05  # errors up to this multiple of the least one tie for first place


def scores_to_json(scores: Sequence[Score], left_out: Sequence[str]) -> dict[str, Any]:
    """Return the results as a dictionary. scores: identical in every run; cost_ratio: measured, so
    it varies."""
    return {
        "scores": [one.to_json() for one in scores],
        "lost": lost(scores),
        "left_out": list(left_out),
        "cost_ratio": {k: _finite(v) for k, v in cost_ratios(scores).items()},
    }


def markdown(scores: Sequence[Score], rivals: Sequence[Rival], left_out: Sequence[str]) -> str:
    """Return both tables, the cases that this project loses, and what was left out."""
    names = [one.name for one in rivals]
    lines = [
        "Error held out, percent of the range (rms); the smallest of each row in bold:",
        "",
        f"| case | {' | '.join(names)} |",
        "|---" * (len(names) + 1) + "|",
    ]
    for case, of in _by_case(scores).items():
        least = min(one.share for one in of)
        cells = [_cell(one, least) for one in of]
        lines.append(f"| {case} | {' | '.join(cells)} |")
    ratios = cost_ratios(scores)
    lines += [
        "",
        f"| model | invertible | rows needed, median | cost per sample, {REFERENCE} = 1 | source |",
        "|---|---|---|---|---|",
    ]
    for rival in rivals:
        rows = [one.rows for one in scores if one.rival == rival.name and one.rows is not None]
        needed = f"{median(rows):.0f}" if rows else "-"
        cost = f"{ratios[rival.name]:.2g}" if math.isfinite(ratios[rival.name]) else "-"
        lines.append(f"| {rival.name} | {rival.invertible} | {needed} | {cost} | {rival.source} |")
    lines.append("")
    beaten = lost(scores)
    lines.append(
        f"{THIS.name} does not have the smallest error on {len(beaten)} of "
        f"{len(_by_case(scores))} cases:"
        if beaten
        else f"{THIS.name} has the smallest error on every case."
    )
    lines += [
        f"- {one['case']}: {one['best']} {one['best_percent']:.3g} %, {THIS.name} "
        + (f"{one['this_percent']:.3g} %" if one["this_percent"] is not None else "no model")
        for one in beaten
    ]
    refused = [one for one in scores if one.refused]
    lines += [f"- no model of {one.rival} on {one.case}: {one.refused}" for one in refused]
    lines += [f"- left out: {text}" for text in left_out]
    return "\n".join(lines)


def lost(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Return the cases on which another model's error is smaller than this project's by more than a
    tie."""
    out = []
    for case, of in _by_case(scores).items():
        best = min(of, key=lambda one: one.share)
        own = next((one for one in of if one.rival == THIS.name), None)
        if own is not None and own.share > TIE * best.share:
            out.append(
                {
                    "case": case,
                    "best": best.rival,
                    "best_percent": best.to_json()["error_percent"],
                    "this_percent": own.to_json()["error_percent"],
                }
            )
    return out


def cost_ratios(scores: Sequence[Score]) -> dict[str, float]:
    """Return, by model, the median over the cases of its cost relative to the reference; NaN: not
    known."""
    reference = {one.case: one.cost_ns for one in scores if one.rival == REFERENCE}
    found: dict[str, list[float]] = {one.rival: [] for one in scores}
    for one in scores:
        ratio = one.cost_ns / reference.get(one.case, math.nan)
        if math.isfinite(ratio):
            found[one.rival].append(ratio)
    return {name: median(ratios) if ratios else math.nan for name, ratios in found.items()}


def _by_case(scores: Sequence[Score]) -> dict[str, list[Score]]:
    out: dict[str, list[Score]] = {}
    for one in scores:
        out.setdefault(one.case, []).append(one)
    return out


def _cell(one: Score, least: float) -> str:
    if one.refused:
        return "no model"
    if not math.isfinite(one.share):
        return "diverges"
    text = f"{one.to_json()['error_percent']:.3g}"  # same digits as in the list of lost cases
    return f"**{text}**" if one.share <= least else text


def _finite(value: float) -> float | None:
    return float(f"{value:.2g}") if math.isfinite(value) else None
