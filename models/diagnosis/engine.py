"""The diagnosis from recordings to verdict. See the steps in the package's text."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dehyst.models.diagnosis.augment import augmented, compact
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.crossval import by_blocks
from dehyst.models.diagnosis.data import Data, Floats, prepare
from dehyst.models.diagnosis.decide import Search, Trial, excess, search
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.noise import noise_rms
from dehyst.models.diagnosis.result import Diagnosis, Finding, Value, View
from dehyst.models.forward import simulate
from dehyst.models.model import Model
from dehyst.models.recording import Recording

Progress = Callable[[str, float], None]
STRUCTURE = 0.35  # excess over the noise (rms ratio) that counts as structure left over


def diagnose(
    recordings: Sequence[Recording], model: Model | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Find the physics that the model of one stage leaves out.

    recordings: of one stage, with displacement. model: the model in use; None: the base is
    identified here. progress(text, fraction) is called now and then.
    Raises BadRecording where the recordings cannot be diagnosed.
    """
    say = progress or (lambda text, fraction: None)
    say("preparing", 0.0)
    data = prepare(recordings)
    problem = Problem(data, rich_base(data))
    null = problem.solve([])
    sigma = noise_rms(data, null.residual(data))
    say("base fitted", 0.1)
    found = search(problem, sigma, null, say)
    return _conclude(problem, found, model, say)


def _conclude(problem: Problem, found: Search, model: Model | None, say: Progress) -> Diagnosis:
    data, sigma = problem.data, found.sigma
    final = found.accepted
    say("holding out", 0.92)
    held_null, held_final = by_blocks(problem, found.null), by_blocks(problem, final)
    findings = tuple(_findings(problem, found))
    left = np.sqrt(excess(problem, final, sigma))
    at_first = np.sqrt(excess(problem, found.null, sigma))
    structure = left > STRUCTURE * sigma
    if not findings:
        verdict = "unknown" if structure else "clean"
    else:
        verdict = "partly" if structure and left > 0.4 * at_first else "explained"
    if verdict in ("unknown", "partly"):
        findings = (*findings, _unknown(float(left), float(at_first)))
    base = model or Model(
        compact(problem, found.null),
        augmented(problem, found.null, compact(problem, found.null)).validity,
        data.drive_unit,
        data.unit,
    )
    whole = augmented(problem, final, compact(problem, final))
    y_base = _base_prediction(data, base)
    views = tuple(_views(data, y_base, held_null.prediction, held_final.prediction))
    rms: dict[str, Any] = {
        "base": _by_recording(data, y_base),
        "shape": _by_recording(data, found.null.prediction),
        "augmented": _by_recording(data, final.prediction),
        "heldout_base": float(np.sqrt(held_null.mean_square)),
        "heldout_augmented": float(np.sqrt(held_final.mean_square)),
        "excess_first": float(at_first),
        "excess_left": float(left),
    }
    say("done", 1.0)
    return Diagnosis(
        verdict, sigma, data.unit, data.drive_unit, findings, (), rms, "", whole, base, views, {},
        tuple(_tried(problem, found)),
    )  # fmt: skip


def _findings(problem: Problem, found: Search) -> list[Finding]:
    final, data = found.accepted, problem.data
    whole = by_blocks(problem, final).mean_square
    explainable = max(by_blocks(problem, found.null).mean_square - found.sigma**2, 1e-30)
    out = []
    for effect, amplitudes in zip(final.effects, final.amplitudes, strict=True):
        rest = [e for e in final.effects if e is not effect]
        without = by_blocks(problem, problem.solve(rest, problem.output_of(final))).mean_square
        c = effect.candidate
        values = c.values(effect.theta, amplitudes)
        parameters = {k: Value(v, v, v, unit) for k, (v, unit) in values.items()}
        out.append(
            Finding(
                c.name, c.key, c.place, c.title, c.equation, c.source,
                float(np.clip((without - whole) / explainable, 0.0, 1.0)),
                {"rms": float(np.sqrt(max(without - whole, 0.0)))},
                parameters, (), {}, c.says(values),
            )
        )  # fmt: skip
    out.sort(key=lambda f: -f.share)
    return out


def _tried(problem: Problem, found: Search) -> list[dict[str, str]]:
    """For each round: root mean square that each candidate's refit removes."""
    n = int(problem.data.rows.sum())
    return [{t.candidate.key: _told(t, n) for t in trials} for trials in found.rounds]


def _told(t: Trial, n: int) -> str:
    text = f"{float(np.sqrt(max(t.gain, 0.0) / n)):.4g}"
    if t.constancy is not None:
        by = " ".join(f"{a:.2f}" for a in t.constancy.by_recording)
        text += f" spread {t.constancy.spread:.2f} wrong {t.constancy.wrong:.2f} [{by}]"
    return text + (f" ({t.refused})" if t.refused else "")


def _unknown(left: float, at_first: float) -> Finding:
    return Finding(
        "unknown", "unknown", "stage", "Unexplained structure", "", "",
        float(left**2 / max(at_first**2, 1e-30)), {"rms": left}, {}, (), {},
        "Something acts here that no entry of the library explains.",
    )  # fmt: skip


def _base_prediction(data: Data, base: Model) -> Floats:
    """The base model alone (N,), with one offset per recording as a nuisance."""
    out = np.empty(data.n)
    for i in range(len(data.names)):
        for p in np.unique(data.part[data.rec == i]):
            here = data.part == p
            out[here] = simulate(base.hysteresis, data.u[here], float(data.dt[here][0]))
        here = (data.rec == i) & data.rows
        out[data.rec == i] += float(np.mean(data.y[here] - out[here]))
    return out


def _views(data: Data, base: Floats, shape: Floats, aug: Floats) -> list[View]:
    out = []
    for i, name in enumerate(data.names):
        k = data.rec == i
        out.append(
            View(name, data.t[k], data.u[k], data.y[k], base[k], shape[k], aug[k],
                 data.rows[k])
        )  # fmt: skip
    return out


def _by_recording(data: Data, prediction: Floats) -> dict[str, float]:
    e = data.y - prediction
    return {
        name: float(np.sqrt(np.mean(e[(data.rec == i) & data.rows] ** 2)))
        for i, name in enumerate(data.names)
    }
