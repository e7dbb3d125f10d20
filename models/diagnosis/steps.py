"""The diagnosis from recordings to verdict. See the steps in the package's text."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dehyst.models.diagnosis.augment import augmented, compact
from dehyst.models.diagnosis.base import compact_base, rich_base
from dehyst.models.diagnosis.decide import named, next_experiment, unknown, verdict_of
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.fit import JointFit, Problem
from dehyst.models.diagnosis.judge import CandidateTrial, SearchState, excess
from dehyst.models.diagnosis.limits import limits
from dehyst.models.diagnosis.locate import hot_spots, locate
from dehyst.models.diagnosis.noise import noise_rms
from dehyst.models.diagnosis.prepare import prepare, turns
from dehyst.models.diagnosis.result import Diagnosis, View
from dehyst.models.diagnosis.search import search
from dehyst.models.diagnosis.sightings import accept, retell, sightings
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.hysteresis.forward import simulate
from dehyst.models.model import Model
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Data, Floats

Progress = Callable[[str, float], None]


def diagnose(
    recordings: Sequence[Recording],
    model: Model | None = None,
    progress: Progress | None = None,
    several: Callable[..., Iterable[Any]] = map,
) -> Diagnosis:
    """Find the physics that the model of one stage leaves out.

    recordings: of one stage, with displacement. model: the model in use; None: the base is
    identified here. progress(text, fraction) is called now and then. several: how candidates are
    tried: `map`, or the map of a pool of threads, of which each needs a design of all samples.
    Raises BadRecording where the recordings cannot be diagnosed.
    """
    say = progress or (lambda text, fraction: None)
    say("preparing", 0.0)
    data = prepare(recordings)
    problem = Problem(data, rich_base(data), several)
    null = problem.solve([])
    sigma = noise_rms(data, null.residual(data))
    say("base fitted", 0.1)
    early = held_drive(problem, null, sigma)
    if early is not None:
        data, problem, null = early.data, early, early.solve([])
    rich, found = problem, _search(problem, sigma, null, say)
    over_rich = found
    in_sample = null.sse / int(data.rows.sum())
    if by_blocks(problem, null).mean_square > TUNING.compact_doubt**2 * in_sample:
        # too rich for what was recorded: does a compact base with effects foretell better?
        plain = replace(problem, base=compact_base(data))
        other = _search(plain, sigma, plain.solve([]), say, share=TUNING.compact_share)
        rich_error = by_blocks(problem, found.accepted).mean_square
        if by_blocks(plain, other.accepted).mean_square < rich_error:
            problem, found = plain, other
    found = _worth_telling(problem, found)
    seen = sightings(data, sigma)
    for candidate, sighting in seen:
        other = accept(_worth_telling(rich, over_rich), candidate, sighting)
        if candidate.key in other.accepted.effect_names:
            problem, found = rich, other
    diagnosis = _conclude(problem, found, model, say)
    for candidate, sighting in seen:
        findings = retell(diagnosis.findings, candidate, sighting)
        diagnosis = replace(diagnosis, findings=findings)
    return diagnosis


def held_drive(problem: Problem, null: JointFit, sigma: float) -> Problem | None:
    """The problem with the drive half a sample earlier, where that explains much of the misfit.

    Nothing physical leads the drive: a recorder that holds each command and reads at the end of
    the sample does, against the straight lines between samples that all models here assume.
    """
    data = problem.data
    ahead = 0.5 * (data.u + np.r_[data.u[1:], data.u[-1]])
    last = np.r_[data.starts[1:], True]
    ahead[last] = data.u[last]
    shifted = replace(data, u=ahead, early=True)
    if shifted.span <= 0:
        return None
    whole = replace(problem, data=shifted, base=rich_base(shifted))
    light = whole.light(TUNING.search_rows)
    fit = light.solve([])
    before = excess(problem, null, sigma)
    fall = before - excess(light, fit, sigma)
    if fall < max(TUNING.early_share * before, (TUNING.early_size * sigma) ** 2):
        return None
    return whole


def _search(
    problem: Problem,
    sigma: float,
    null: JointFit,
    say: Progress,
    share: float = TUNING.driven_share,
) -> SearchState:
    """The search on a part of the rows, its result fitted to all of them."""
    light = problem.light(TUNING.search_rows)
    found = search(light, sigma, null if light is problem else light.solve([]), say, share)
    say("fitting all samples", 0.86)
    final = found.accepted
    final = problem.refit(final.effects, rounds=8, settle=0.3 * sigma**2) if final.effects else null
    return replace(found, problem=problem, null=null, accepted=final)


def _worth_telling(problem: Problem, found: SearchState) -> SearchState:
    """Without the effects that do not help on held-out samples."""
    final, sigma = found.accepted, found.sigma
    first = by_blocks(problem, found.null).mean_square
    while final.effects:
        whole = by_blocks(problem, final).mean_square
        # beside a cause a hundred times as large, a second one of some noise rms still counts
        of_all = TUNING.helps_share * max(first - sigma**2, 0.0)
        of_rest = TUNING.helps_rest * max(whole - sigma**2, 0.0)
        losses = []
        for e in final.effects:
            most = TUNING.beside_driven if e.candidate.driven else TUNING.beside_free
            least = max((TUNING.helps * sigma) ** 2, min(of_all, (most * sigma) ** 2), of_rest)
            rest = [o for o in final.effects if o is not e]
            without = problem.solve(rest, problem.output_of(final))
            loss = by_blocks(problem, without).mean_square - whole
            losses.append((loss / least, e))
        loss, weakest = min(losses, key=lambda pair: pair[0])
        if loss > 1.0:
            break
        rest = [o for o in final.effects if o is not weakest]
        final = problem.refit(rest, settle=0.3 * sigma**2) if rest else found.null
    if (
        final.effects
        and first - by_blocks(problem, final).mean_square < (TUNING.helps * sigma) ** 2
    ):
        final = found.null  # each seems to need the others, and together they foretell nothing
    return replace(found, accepted=final)


def _conclude(
    problem: Problem, found: SearchState, model: Model | None, say: Progress
) -> Diagnosis:
    data, sigma = problem.data, found.sigma
    final = found.accepted
    say("holding out", 0.88)
    held_null, held_final = by_blocks(problem, found.null), by_blocks(problem, final)
    left = float(np.sqrt(_structure(problem, final, sigma)))
    at_first = float(np.sqrt(excess(problem, found.null, sigma)))
    say("intervals and rivals", 0.92)
    residual = final.residual(data)
    tables = locate(data, found.null.residual(data), sigma)
    findings = named(problem, found, held_null, held_final)
    verdict = verdict_of(findings, left, at_first, sigma, float(np.ptp(data.y)))
    if verdict in ("unknown", "partly"):
        where = hot_spots(locate(data, residual, sigma))
        findings = [*findings, unknown(left, at_first, where, data.unit)]
    say("limits", 0.96)
    limited = tuple(limits(found))
    base = model or base_model(problem, found)
    whole = augmented(problem, final, compact(problem, final))
    y_base = _base_prediction(data, base)
    views = tuple(_views(data, y_base, held_null.prediction, held_final.prediction))
    rms: dict[str, Any] = {
        "base": _by_recording(data, y_base),
        "shape": _by_recording(data, found.null.prediction),
        "augmented": _by_recording(data, final.prediction),
        "heldout_base": float(np.sqrt(held_null.mean_square)),
        "heldout_augmented": float(np.sqrt(held_final.mean_square)),
        "excess_first": at_first,
        "excess_left": left,
    }
    say("done", 1.0)
    return Diagnosis(
        verdict=verdict,
        noise=sigma,
        unit=data.unit,
        drive_unit=data.drive_unit,
        findings=tuple(findings),
        would_have_seen=limited,
        rms=rms,
        next_experiment=next_experiment(
            verdict, findings, sorted({x.name for x in limited if x.value is None})
        ),
        model=whole,
        base_model=base,
        views=views,
        locate=tables,
        tried=tuple(_tried(found.counted, found)),
        notes=tuple(notes_of(data)),
    )


def _structure(problem: Problem, final: JointFit, sigma: float) -> float:
    """Mean square misfit that no rate-independent memory could make either."""
    rich = rich_base(problem.data)
    if rich.width > problem.base.width:
        final = Problem(problem.data, rich).solve(final.effects, problem.output_of(final))
    return excess(problem, final, sigma)


def base_model(problem: Problem, found: SearchState) -> Model:
    """The hysteresis alone, compact and monotone, fitted without any effect."""
    plain = augmented(problem, found.null, compact(problem, found.null))
    return replace(plain, blocks=(), hysteresis=compact(problem, found.null))


def notes_of(data: Data) -> list[str]:
    """What the reader should know of the recordings."""
    out = []
    left_out = int((~data.rows).sum())
    if left_out:
        out.append(
            f"{left_out} samples at the start were left out: what the stage did before is unknown"
        )
    if data.early:
        out.append(
            "the reading leads the drive by half a sample: each command is held, not ramped; the "
            "diagnosis has taken it so"
        )
    if turns(data) < TUNING.few_turns:
        out.append("the drive hardly turns round: nothing that it causes can be told from the loop")
    if len(data.names) == 1:
        out.append("one recording only: nothing was held out on another waveform")
    return out


def _tried(n: int, found: SearchState) -> list[dict[str, str]]:
    """For each round: root mean square that each candidate's refit removes."""
    return [{t.candidate.key: _told(t, n) for t in trials} for trials in found.rounds]


def _told(t: CandidateTrial, n: int) -> str:
    text = f"{float(np.sqrt(max(t.gain, 0.0) / n)):.4g}"
    if t.constancy is not None:
        by = " ".join(f"{a:.2f}" for a in t.constancy.by_recording)
        text += f" spread {t.constancy.spread:.2f} wrong {t.constancy.wrong:.2f} [{by}]"
    return text + (f" ({t.refused})" if t.refused else "")


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
            View(name, data.t[k], data.u[k], data.y[k], base[k], shape[k], aug[k], data.rows[k])
        )
    return out


def _by_recording(data: Data, prediction: Floats) -> dict[str, float]:
    e = data.y - prediction
    return {
        name: float(np.sqrt(np.mean(e[(data.rec == i) & data.rows] ** 2)))
        for i, name in enumerate(data.names)
    }
