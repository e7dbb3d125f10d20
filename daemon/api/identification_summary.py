"""Summaries of a `dehyst identify` result: a dictionary for machines, text for people."""

import shlex
from pathlib import Path
from typing import Any

from dehyst.daemon.report.choice import explain_choice
from dehyst.daemon.report.verdict import verdict
from dehyst.models.drive_design.coverage import Coverage
from dehyst.models.identify import Identification, describe
from dehyst.models.model import Block, Fit
from dehyst.models.physics import KINDS
from dehyst.models.signals.error_size import Z95
from dehyst.models.units import how_many, spell_size, spell_unit

NEXT = (
    "next: record another waveform, and check that the model predicts it: "
    "dehyst validate {} REC.csv"
)


def _missing(result: Identification, covered: Coverage) -> list[str]:
    return [*covered.missing, *(covered.missing_rate if result.shape.rate else ())]


def summary(
    result: Identification, covered: Coverage, output: Path, seconds: float, report: Path | None
) -> dict[str, Any]:
    """Return the result as a dictionary for JSON output."""
    fit, v, figures = result.model.fit, result.model.validity, describe(result.model)
    return {
        "model": str(output),
        "report": str(report) if report else None,
        "structure": result.shape.name,
        "static": not result.shape.rate,
        "order": result.model.hysteresis.n,
        "saturation": max((1, *result.shape.powers)),
        "bias": result.shape.even,
        "unit": result.model.displacement_unit,
        "rms": fit.rms,
        "holdout_rms": fit.holdout_rms,
        "noise_rms": fit.noise_rms,
        "band": fit.band,
        "stroke": figures.stroke,
        "gain": figures.gain,
        "hysteresis": figures.hysteresis,
        "offset": figures.offset,
        "recordings": [
            {"name": one.name, "rms": one.rms, "noise_rms": one.noise} for one in result.recordings
        ],
        "choice": explain_choice(result),
        "blocks": [block_name(block) for block in result.model.blocks],
        "validity": {
            "drive_min": v.drive_min,
            "drive_max": v.drive_max,
            "rate_max": v.rate_max,
            "acceleration_max": v.acceleration_max,
            "band_hz": v.band_hz,
            "slowest_s": v.slowest_s,
            "period_s": v.period_s,
            "drive_unit": result.model.drive_unit,
        },
        "tried": [
            {
                "structure": c.shape.name,
                "drive_offset": c.offset,
                "dynamics": c.lag.name if c.lag is not None else "",
                "holdout_rms": c.held_rms,
                "invertible": c.invertible,
            }
            for c in result.tried
        ],
        "orders": [{"order": n, "fit_rms": rms} for n, rms in result.orders],
        "parameters": list_intervals(result),
        "notes": list(result.notes),
        "missing": _missing(result, covered),
        "seconds": round(seconds, 3),
    }


def block_name(block: Block) -> str:
    """Describe a block in words, with its parameters in their units."""
    params = KINDS[block.kind].params
    numbers = [
        f"{one.name.replace('_', ' ')} {spell_size(float(value), one.unit or '1')}"
        for one in params
        for key, value in block.params.items()
        if one.matches(key) and key not in ("share", "held") and not isinstance(value, tuple)
    ]
    if block.params.get("held"):
        numbers.append("its input held between the rows")
    return f"{KINDS[block.kind].says} at the {block.place} ({', '.join(numbers)})"


def list_intervals(result: Identification) -> dict[str, Any]:
    """Return every number that the data determine, with its 95 % interval, by threshold and by
    power.

    slopes: dz/du after each operator has joined in, at the largest rate that the drive can have
    there after a reversal, `rate`, and at minus that rate (static model: one slope for all rates);
    low and high are null if a slope is on its bound.
    """
    h, n = result.model.hysteresis, result.model.hysteresis.n
    names = ("at_rate_max", "at_minus_rate_max") if result.shape.rate else ("at_all_rates",)
    slopes, errors, bound = result.params.slopes, result.errors.slopes, result.at_bound
    return {
        "slopes": [
            {"threshold": float(h.r[i])}
            | ({"rate": float(result.rates[i])} if result.shape.rate else {})
            | {
                name: _interval(slopes[i + j * n], errors[i + j * n], bool(bound[i + j * n]))
                for j, name in enumerate(names)
            }
            for i in range(n)
        ],
        "saturation": [
            {"power": power} | _interval(h.c[power], error)
            for power, error in zip(result.shape.powers, result.errors.c, strict=True)
        ],
        "offsets": [
            {"recording": i + 2} | _interval(value, error)
            for i, (value, error) in enumerate(
                zip(result.params.shifts, result.errors.shifts, strict=True)
            )
        ],
    }


def _interval(value: float, error: float, on_bound: bool = False) -> dict[str, Any]:
    value, half = float(value), Z95 * float(error)
    low, high = (None, None) if on_bound else (value - half, value + half)
    return {"value": value, "low": low, "high": high}


def _interval_words(fit: Fit, unit: str) -> str:
    if fit.band is None and fit.holdout_rms and not fit.leaves_mostly_noise:
        return (
            "no 95 % prediction interval for other drives: the error on left-out stretches, "
            f"{fit.holdout_rms:.4g} {unit} rms, is not mostly noise; another waveform may cause "
            "half to three times as much, and dehyst diagnose names what the model leaves out"
        )
    if fit.band is None:
        return (
            "this recording does not determine a prediction interval for other drives: drive "
            "loops of several sizes at several rates (dehyst excite designs such a drive)"
        )
    return (
        f"95 % prediction interval for other drives in this range: +-{fit.band:.4g} {unit}, not "
        "counting the gauge's noise and a constant offset"
    )


def describe_result(
    result: Identification, covered: Coverage, output: Path, report: Path | None
) -> str:
    """Return the result as text."""
    fit, v = result.model.fit, result.model.validity
    unit = spell_unit(result.model.displacement_unit)
    drive = spell_unit(result.model.drive_unit)
    n = result.model.hysteresis.n
    lines = [describe(result.model).sentence()]
    lines += [
        f"{one.name}: error {one.rms:.4g} {unit} rms, noise {one.noise:.4g}"
        for one in result.recordings
    ]
    lines += [
        f"{output}: {result.shape.name}, {how_many(n, 'operator')}"
        + "".join(f", {block_name(block)}" for block in result.model.blocks),
        f"fit {fit.rms:.4g} {unit} rms, held-out data {fit.holdout_rms:.4g}, noise "
        f"{fit.noise_rms:.4g}; " + _interval_words(fit, unit),
        verdict(result),
        f"valid from {v.drive_min:.4g} to {v.drive_max:.4g} {drive}"
        + (f", up to {v.rate_max:.4g} {drive}/s" if v.rate_max else "")
        + (
            f", for drives that cross 5 % of it in {v.slowest_s:.3g} s or less"
            if v.slowest_s
            else ""
        ),
    ]
    lines += [f"note: {note}" for note in result.notes]
    lines += [f"missing: {text}" for text in _missing(result, covered)]
    if report:
        lines.append(f"report: {report}")
    lines.append(NEXT.format(shlex.quote(str(output))))
    return "\n".join(lines)
