"""One case judged: what was named against what is hidden, and the held-out waveform foretold."""

from typing import Any

import numpy as np
from tests.rigs.plants.stages import GIVEN, Case, Table, rich_columns

from dehyst.models.cascade.simulate import simulate
from dehyst.models.model import Model
from dehyst.models.recording import Recording

SETTLED = 500  # samples of the soft start that are not judged


def recording(name: str, table: Table) -> Recording:
    """A recording as the tool gets it."""
    return Recording(
        t_s=table.t_s, drive=table.u_v, displacement=table.y_um,
        channels={"temp_c": table.temp_c, "u2_v": table.u2_v}, name=f"{name}.csv",
    )  # fmt: skip


def given(case: Case) -> list[Recording]:
    """The recordings with displacement; the held-out one is kept back."""
    return [recording(name, case.records[name]) for name in GIVEN]


def judge(case: Case, diagnosis: Any, seconds: float) -> dict[str, Any]:
    """A row of plain data for the tables."""
    said = diagnosis.to_dict()
    effects = [
        {
            "name": e["name"],
            "share": e.get("share"),
            "ambiguous_with": list(e.get("ambiguous_with") or []),
        }
        for e in said["effects"]
    ]
    held = case.records["holdout"]
    base = _misfit(held, diagnosis.base_model, ())
    lines = _lines(said["effects"])
    full = _misfit(held, diagnosis.model, lines)
    return {
        "seed": case.seed,
        "kind": case.kind,
        "hysteresis": case.hysteresis,
        "noise_um": case.noise_um,
        "hidden": [
            {"name": h.name, "form": h.form, "ratio": h.leftover_um / case.noise_um}
            for h in case.hidden
        ],
        "ratio": case.leftover_um / case.noise_um,
        "verdict": said["verdict"],
        "effects": effects,
        "noise_said_um": said["noise"]["rms"],
        "base_um": base,
        "model_um": full,
        "removed": 1.0 - (full / base) ** 2 if base > 0 else 0.0,
        "rich_um": _rich_misfit(case),
        "parameters": _inside(case, said["effects"], diagnosis.model),
        "seconds": seconds,
    }


def _rich_misfit(case: Case) -> float:
    """Held-out misfit of the rich rate-independent base of proof_stages, fitted to the given
    recordings [um]: what hysteresis of another shape alone would reach."""
    tables = [case.records[name] for name in GIVEN]
    columns = [np.column_stack([rich_columns(r.u_v), np.ones(r.u_v.size)]) for r in tables]
    a, y = np.vstack(columns), np.concatenate([r.y_um for r in tables])
    gram = a.T @ a
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-7
    weights = np.linalg.solve(gram, a.T @ y)
    held = case.records["holdout"]
    error = held.exact_um - rich_columns(held.u_v) @ weights[:-1]
    return float(np.std(error[SETTLED:]))


def _lines(effects: list[dict[str, Any]]) -> tuple[float, ...]:
    """Frequencies of the lines that were named: their phases are refitted on a new recording."""
    return tuple(
        float(p["value"])
        for e in effects
        if e["name"] == "hum"
        for key, p in e["parameters"].items()
        if key.startswith("frequency")
    )


def _misfit(held: Table, model: Model, lines: tuple[float, ...]) -> float:
    """Rms error against the exact displacement [um]; the offset and the lines' phases refitted.

    The exact displacement has no noise in it, so this is the explainable part itself.
    """
    channels = {"temp_c": held.temp_c, "u2_v": held.u2_v}
    if lines:  # the model's own lines have the phases of other recordings
        model = _without_lines(model)
    error = (held.exact_um - simulate(model, held.t_s, held.u_v, channels))[SETTLED:]
    t = held.t_s[SETTLED:]
    columns = [np.ones(t.size)]
    for f in lines:
        columns += [np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)]
    a = np.column_stack(columns)
    left = error - a @ np.linalg.lstsq(a, error, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def _without_lines(model: Model) -> Model:
    from dataclasses import replace

    return replace(model, blocks=tuple(b for b in model.blocks if b.kind != "hum"))


def _inside(case: Case, effects: list[dict[str, Any]], model: Model) -> list[dict[str, Any]]:
    """Parameters of the textbook form with their stated interval, where the name is right."""
    if case.kind != "own":
        return []
    out = []
    for hidden in case.hidden:
        found = next((e for e in effects if e["name"] == hidden.name), None)
        if found is None:
            continue
        for key, true in hidden.truth.items():
            stated = found["parameters"].get(key)
            if stated is None or stated.get("low") is None or stated.get("high") is None:
                out.append({"name": hidden.name, "key": key, "stated": False})
                continue
            if key == "gain_per_k":  # the tool's gain is relative to the value at its reference
                block = next(b for b in model.blocks if b.kind == "drift")
                true = true / (1.0 + true * (float(block.params["reference_c"]) - 22.0))
            out.append(
                {
                    "name": hidden.name, "key": key, "stated": True, "true": true,
                    "value": stated["value"], "low": stated["low"], "high": stated["high"],
                    "inside": bool(stated["low"] <= true <= stated["high"]),
                }
            )  # fmt: skip
    return out
