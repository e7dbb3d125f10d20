"""The diagnosis in frozen states, each made from the one before by one function:
Prepared -> SearchProblem -> Searched -> Judged -> Diagnosis (what is reported)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from dehyst.models.cascade.history import replay_recording
from dehyst.models.diagnosis.augment import state_fit, with_rows_early
from dehyst.models.diagnosis.data.locate import locate
from dehyst.models.diagnosis.data.survey import (
    BUTTERFLY_WARNING,
    ONE_SIDE,
    centred_residual,
    survey,
)
from dehyst.models.diagnosis.findings.decide import has_unknown, next_experiment
from dehyst.models.diagnosis.findings.limits import limits
from dehyst.models.diagnosis.findings.repeated_search import RepeatedSearch
from dehyst.models.diagnosis.findings.reported import is_narrow
from dehyst.models.diagnosis.findings.shape import mark_not_contained
from dehyst.models.diagnosis.held_out import in_the_last_state
from dehyst.models.diagnosis.judge import CandidateTrial, SearchState
from dehyst.models.diagnosis.result import Diagnosis, Finding, FitView, Progress, Value
from dehyst.models.diagnosis.search_problem import Prepared, choose_base, join_recordings
from dehyst.models.diagnosis.searched import look_for_causes
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.diagnosis.verdict import Judged, reach_verdict
from dehyst.models.model import Fit, Model
from dehyst.models.physics.candidate import Candidate, Sighting
from dehyst.models.recording import Recording
from dehyst.models.signals.error_size import finite_rms
from dehyst.models.signals.joined import Bools, Data, Floats


@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads wait for each other at this size
def diagnose(
    recordings: Sequence[Recording],
    model: Model | None = None,
    progress: Progress | None = None,
    several: Callable[..., Iterable[Any]] = map,
    with_limits: bool = True,
) -> Diagnosis:
    """Find the physics that the model in use leaves out.

    recordings: of one stage, with displacement. model: the model in use; None: the plain modified
    Prandtl-Ishlinskii model is identified here. progress(text, fraction) is called from time to
    time. several: how candidates are tried: `map`, or the map of a thread pool, each thread of
    which needs memory for a design matrix of all samples. with_limits: whether to compute what
    would have been seen, which takes about half of the time. Raises BadRecording where the
    recordings cannot be diagnosed, BadInput where the model cannot be run on them.
    """
    say = progress or (lambda text, fraction: None)
    prepared = join_recordings(recordings, model, say)
    judged = reach_verdict(look_for_causes(choose_base(prepared, several, say), say), say)
    left = judged.verdict in ("unknown", "partly") and not _is_mostly_named(judged.findings)
    odd = (prepared.diagnosed.odd or _find_odd(prepared)) if left else ""
    rest = [one for one in recordings if one.name != odd]
    if 1 < len(rest) == len(recordings) - 1:
        say(f"without {odd}", 0.0)
        others = diagnose(rest, model, progress, several, with_limits)
        settles = has_unknown(judged.findings) and not has_unknown(others.findings)
        if settles or others.verdict in ("clean", "explained"):
            (one,) = (one for one in recordings if one.name == odd)
            beyond = finite_rms(_predict_centred(others.model, one))
            says = (
                f"the recording {odd} does not match the others, and was left out"
                if beyond > TUNING.near * others.noise
                else f"the recording {odd} was left out of the fits, and the model predicts it"
            )
            return replace(others, data=replace(others.data, says=(says, *others.data.says)))
    return _report(judged, recordings, with_limits, say)


def _is_mostly_named(findings: Sequence[Finding]) -> bool:
    """Return whether effects of the library explain all but a minor part of the misfit: then a
    recording that the model in use does not predict is the one that shows them. A recording of
    another stage leaves more (friction may explain 0.7 of it)."""
    named = sum(f.share for f in findings if f.name not in ("shape", "unknown"))
    return named >= 1.0 - TUNING.minor


def _find_odd(prepared: Prepared) -> str:
    """Return the name of the one recording that a given model predicts much worse than all others;
    "" if there is none."""
    if not prepared.diagnosed.given or len(prepared.recordings) < TUNING.few:
        return ""
    model = prepared.diagnosed.model
    left = [finite_rms(_predict_centred(model, one)) for one in prepared.recordings]
    *_, second, worst = sorted(left)
    odd = prepared.recordings[int(np.argmax(left))].name
    return odd if worst > TUNING.foreign_times * second else ""


def _predict_centred(model: Model, one: Recording) -> Floats:
    """Return what a model leaves of a recording (N,), less its mean."""
    assert one.displacement is not None
    left = one.displacement - replay_recording(model, one).predicted
    return np.asarray(left - np.nanmean(left))


def _report(
    judged: Judged, recordings: Sequence[Recording], with_limits: bool, say: Progress
) -> Diagnosis:
    """Write the report of a verdict: findings, limits, errors before and after, pictures."""
    searched, found = judged.searched, judged.found
    written, verdict = judged.written, judged.verdict
    diagnosed, whole, fitted = searched.bare.diagnosed, searched.whole, judged.fitted
    say("limits", 0.96)
    findings = judged.findings
    untold = {n for f in findings for n in (f.name, *f.ambiguous_with)}
    wanted = with_limits and verdict in ("clean", "explained")
    limited = tuple(limits(found, untold, RepeatedSearch(found).names)) if wanted else ()
    blind = sorted({x.name for x in limited if x.value is None})
    further = next_experiment(verdict, findings, blind, whole)
    if not written.contains_shape:
        findings = tuple(mark_not_contained(f) for f in findings)
    for candidate, sighting in searched.seen:
        findings = with_sighting(findings, candidate, sighting)
    model = with_rows_early(written.model, whole)
    base_model = diagnosed.model if diagnosed.given else with_rows_early(diagnosed.model, whole)
    lasting = [e for e in found.accepted.effects if e.candidate.key in written.contains]
    now = in_the_last_state(lasting, whole)
    views = tuple(_views(whole, recordings, (base_model, model), now))
    rms: dict[str, Any] = {
        "model": {v.name: finite_rms((v.displacement - v.base)[v.counted]) for v in views},
        "augmented": {v.name: finite_rms((v.displacement - v.augmented)[v.counted]) for v in views},
        "rows": {v.name: int(np.count_nonzero(v.counted)) for v in views},
        "heldout_model": float(np.sqrt(written.held_in_use.mean_square)),
        "heldout_augmented": float(np.sqrt(written.held.mean_square)),
    }
    noises, left = (found.sigma, judged.noise), centred_residual(whole, diagnosed.predict(whole))
    warnings = searched.warnings
    if written.alone is not None and not written.holds_in_each_alone(judged.noise):
        times = np.sqrt(written.alone) / judged.noise
        warnings += (
            f"fitted to one of the two recordings, the model leaves {times:.2g} times the noise in "
            "the other: the difference between them is not explained; add a third recording",
        )
    if not written.holds_elsewhere(judged.noise):
        times = written.elsewhere / judged.noise
        error = f"has an error of {times:.2g} times the noise" if np.isfinite(times) else "diverges"
        warnings += (
            f"on loops of other sizes and positions the model {error} (estimated by leaving out "
            "parts of the recordings): record loops of several sizes throughout the range",
        )
    quality = survey(whole, fitted, noises, judged.unexplained, warnings)
    diagnosis = Diagnosis(
        verdict=verdict,
        data=quality,
        noise=judged.noise,
        unit=fitted.unit,
        drive_unit=fitted.drive_unit,
        findings=findings,
        would_have_seen=limited,
        rms=rms,
        next_experiment=ONE_SIDE if BUTTERFLY_WARNING in searched.warnings else further,
        model=model,
        base_model=base_model,
        views=views,
        locate=locate(whole, left, found.sigma),
        tried=tuple(_tried(found.counted, found)),
    )
    say("done", 1.0)
    if diagnosed.given and not written.gained:
        return diagnosis  # the model in use stays as it was given
    fit = Fit(diagnosis.before_after[1], rms["heldout_augmented"], judged.noise)
    stated = state_fit(model, whole, fit)
    return replace(diagnosis, model=stated, base_model=base_model if written.gained else stated)


def with_sighting(
    findings: Sequence[Finding], candidate: Candidate, sighting: Sighting
) -> tuple[Finding, ...]:
    """Return the findings; the one that was seen directly gets the evidence of its sighting, with
    the values that it fixes."""
    values = {key: Value(*interval) for key, interval in sighting.intervals.items()}

    def same(f: Finding) -> bool:
        return f.key == candidate.key and all(
            np.isclose(f.parameters[key].value, v.value)
            for key, v in values.items()
            if key in f.parameters  # else its interval was too wide to be reported
        )

    fixed = {key: value for key, value in values.items() if is_narrow(value)}
    return tuple(
        replace(f, says=sighting.says, parameters=fixed, ambiguous_with=()) if same(f) else f
        for f in findings
    )


def _tried(n: int, found: SearchState) -> list[dict[str, str]]:
    """Return, for each round, the rms that each candidate's refit removes."""
    return [{t.candidate.key: _describe_trial(t, n) for t in trials} for trials in found.rounds]


def _describe_trial(t: CandidateTrial, n: int) -> str:
    text = f"{float(np.sqrt(max(t.gain, 0.0) / n)):.4g}"
    if t.constancy is not None:
        by = " ".join(f"{a:.2f}" for a in t.constancy.by_recording)
        text += f" spread {t.constancy.spread:.2f} wrong {t.constancy.wrong:.2f} [{by}]"
    return text + (f" ({t.refused})" if t.refused else "")


def _views(
    data: Data, recordings: Sequence[Recording], models: Sequence[Model], now: Bools
) -> list[FitView]:
    """Return each recording with the predictions of the model in use and of the written model,
    simulated on the recording as it is: rows without a channel that a model reads do not count.
    data: all samples; now: (N,) those at which the stage was as the written model describes it."""
    out = []
    for i, one in enumerate(recordings):
        k = (data.rec == i) & (data.raw_index >= 0)
        said = [replay_recording(m, one).predicted[data.raw_index[k]] for m in models]
        y, counted = data.y[k], data.rows[k] & np.isfinite(said).all(axis=0)
        base, full = (x + _level(y - x, counted) for x in said)
        out.append(
            FitView(one.name, data.t[k], data.u[k], y, base, full, counted, counted & now[k])
        )
    return out


def _level(error: Floats, counted: Bools) -> float:
    """Return the mean over the rows that count; 0 where there is none."""
    return float(np.nanmean(error[counted])) if counted.any() else 0.0
