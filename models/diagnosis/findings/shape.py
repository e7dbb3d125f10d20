"""Shape: what a hysteresis of any shape explains of the misfit of the model in use.

The rich base, fitted jointly with the effects, corrects the model's hysteresis. Where it predicts
held-out samples better than other parameter values in the model's own class would, the loop differs
from the model's. The form of the correction is classified by what explains it: a function of the
displacement alone (centre line: a nonlinear sensor or stage), one that differs between the branches
(asymmetry of the ceramic), a memory of the displacement of a fixed length (presliding friction), or
none of these (another class of hysteresis). One stage's recordings show the form, not the cause:
each form covers all causes that produce it.
"""

from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.base import no_base, numbers_base
from dehyst.models.diagnosis.data.locate import hot_spots, locate
from dehyst.models.diagnosis.effects import apply_output_effects
from dehyst.models.diagnosis.evidence import blockwise_held_out_error
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.screen import Screen, contribution_of
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import PHYSICS, list_candidates
from dehyst.models.physics.candidate import format_length
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.filters import dahl
from dehyst.models.signals.joined import Floats

DEGREE = 5  # of functions of the displacement
LENGTHS = np.array([0.003, 0.006, 0.012, 0.025, 0.05])  # of presliding, relative to the stroke
MOSTLY = 0.6  # of the correction's power, which one form must explain to be reported
MORE = 0.15  # that a richer form must explain beyond a plainer one
ROWS = 20_000  # used to compare the forms, about
SHOWN = 0.15  # of a cause's rms, which the base must leave to distinguish it from a shape

LOOKS = {
    "centre": "it is a function of the displacement alone, the same on both branches: a nonlinear "
    "sensor or stage",
    "branches": "the rising and the falling branch differ in curvature: an asymmetry of the "
    "ceramic, or a nonlinear sensor",
    "presliding": "it depends on the displacement since each reversal and fades within a fixed "
    "travel: presliding friction in the guide, or an asymmetry",
    "class": "it is spread over the loop: a hysteresis of another class, or a combination of "
    "asymmetry, sensor nonlinearity and friction",
}


@dataclass(frozen=True)
class Correction:
    """gain: mean square that the base removes of held-out samples, beyond what the effects do and,
    for a model that was identified here together with effects that distort it, beyond other
    parameter values in its class; numbers: mean square that those values leave; rms: of the
    correction."""

    gain: float
    numbers: float
    rms: float


CONTAINED = "The augmented model contains it, and it is compensated"
NOT_CONTAINED = (
    "The augmented model does not contain it, because it would not predict the held-out data "
    "better, or would not hold beyond the recorded data"
)


NOT_WRITTEN = (
    "The written model does not contain it, because it would not predict another recording better."
)
AT_HARMONICS = (
    "The written model does not contain it, because a drive of one period shows it only at the "
    "harmonics of this period: record drives of several periods, or steps."
)


def mark_not_contained(finding: Finding) -> Finding:
    """Return the finding for an augmented model that is written without the shape."""
    return replace(finding, says=finding.says.replace(CONTAINED, NOT_CONTAINED))


def mark_not_written(finding: Finding, at_harmonics: bool) -> Finding:
    """Return the finding for an effect that the written model does not contain. at_harmonics: the
    recording shows it at the harmonics of one period only."""
    why = AT_HARMONICS if at_harmonics else NOT_WRITTEN
    return replace(finding, says=f"{finding.says} {why}")


def measure_correction(
    problem: Problem, final: JointFit, bare_square: float, held_square: float
) -> Correction:
    """Measure what the base improves on the model in use. bare_square, held_square: mean square
    that the model alone leaves, and that the final fit leaves of held-out samples."""
    data = problem.data
    own = numbers_base(data, problem.diagnosed.model.hysteresis)
    numbers = Problem(data, own, problem.diagnosed)
    fit = numbers.solve(final.effects, problem.output_of(final) if final.effects else None)
    left = blockwise_held_out_error(numbers, fit)
    before = left
    if problem.diagnosed.given:
        # the model in use is in `before`, even where the base stands in for it
        alone = Problem(data, no_base(data), replace(problem.diagnosed, carries=True))
        before = alone.solve(final.effects, problem.output_of(final)).sse / int(data.rows.sum())
    elif not final.effects:
        before = bare_square  # without effects, all that the base explains is shape
    added = _correction(problem, final)[data.rows]
    return Correction(before - held_square, left, float(np.std(added)))


def absorbed_names(problem: Problem, final: JointFit, size: float) -> tuple[str, ...]:
    """Return names of causes driven by the drive that the base absorbs almost entirely, at an rms
    of about `size`: with this drive they cannot be distinguished from a loop of another shape."""
    screen = Screen(problem, final)
    best: dict[str, float] = {}
    taken = {e.candidate.key for e in final.effects}
    for c in list_candidates(problem.data):
        probes = c.probes(problem.data)
        if not c.driven or c.static or c.key in taken or not probes:
            continue
        for probe in probes:
            x = contribution_of(screen, c, probe)
            raw = float(np.std(x[problem.data.rows]))
            if raw >= 0.7 * size or probe is probes[-1]:  # the nearest: each is twice the last
                shown = rms(screen.projected(x[:, None]))
                best[c.name] = max(best.get(c.name, 0.0), shown / raw if raw > 1e-12 else 0.0)
                break
    return tuple(name for name, shown in best.items() if shown < SHOWN)


def shape_finding(
    problem: Problem, final: JointFit, sigma: float, correction: Correction, share: float
) -> Finding:
    """Return the finding for the shape, with the form of its correction."""
    data = problem.data
    d = _correction(problem, final)
    parts = _looks(problem, final, d)
    look = _choose(parts)
    words, alike = LOOKS[look], [one for one in PHYSICS.values() if look in one.looks]
    names = [one.name for one in sorted(alike, key=lambda one: one.looks[look])]
    hidden = absorbed_names(problem, final, correction.rms)
    if hidden:
        words += f"; with this drive {' or '.join(hidden)} would look the same"
    where = hot_spots(locate(data, np.where(data.rows, d, 0.0), 0.0))
    evidence = {
        "correction_rms": correction.rms,
        "removed_rms": float(np.sqrt(max(correction.gain, 0.0))),
        "other_numbers_leave_rms": float(np.sqrt(correction.numbers)),
        **{f"explained_by_{k}": v for k, v in parts.items()},
    }
    says = (
        f"The loop differs from the model's by {format_length((correction.rms, data.unit))} rms. "
        f"{words[0].upper()}{words[1:]}. {CONTAINED}."
    )
    numbers = format_length((float(np.sqrt(correction.numbers)), data.unit))
    if correction.numbers < sigma**2 + 0.3 * max(correction.gain, 0.0):  # of it: little is left
        removed = format_length((float(np.sqrt(max(correction.gain, 0.0))), data.unit))
        says = (
            f"The model's parameters differ from this stage's by {removed} rms: other values in "
            f"the same class would leave {numbers}. "
        )
        if problem.diagnosed.given:
            says += "Identify again from these recordings"
        else:
            says += "These recordings show too little of the loop to identify it"
        says += f". {CONTAINED}."
    return Finding(
        name="shape",
        key="shape",
        place="stage",
        title="Loop of another shape than the model's",
        equation="y = h(u) + sum_i sum_p w_ip H_i^p + sum_j (w_j + ...) Z_j",
        source="play operators with polynomial envelopes; Dahl operators (Dahl 1976)",
        share=share,
        evidence=evidence,
        parameters={},
        ambiguous_with=(*names, *hidden),
        where=where,
        says=says,
    )


def _correction(problem: Problem, final: JointFit) -> Floats:
    """Return (N,) what the base adds to the model that carries it; else the part of it that no
    other parameter values in the model's class produce. Its mean over the counted rows is
    removed."""
    data = problem.data
    d = final.added
    if not problem.diagnosed.carries:
        own = numbers_base(data, problem.diagnosed.model.hysteresis)
        v = problem.drive_at_hysteresis(final.effects)
        columns = apply_output_effects(data.path, final.effects, own.columns(v, data.path.forgets))
        columns = data.sampled(columns)
        x = np.column_stack([np.ones(data.n), columns])
        x /= np.sqrt(np.maximum(np.mean(x**2, axis=0), 1e-30))
        xr = x[data.rows]
        gram = xr.T @ xr + TUNING.ridge * xr.shape[0] * np.eye(xr.shape[1])
        d = d - x @ np.linalg.solve(gram, xr.T @ d[data.rows])
    return np.where(data.rows, d - d[data.rows].mean(), 0.0)


def _looks(problem: Problem, final: JointFit, d: Floats) -> dict[str, float]:
    """Return the share of the correction's power that each form explains, each including the
    plainer ones' terms."""
    data = problem.data
    y = problem.output_of(final)
    rows = problem.row_index[:: max(1, problem.row_index.size // ROWS)]
    low, stroke = float(y[rows].min()), max(float(np.ptp(y[rows])), 1e-300)
    x = 2.0 * (y - low) / stroke - 1.0
    level: Floats = np.polynomial.legendre.legvander(x[rows], DEGREE).astype(np.float64)
    smooth = np.convolve(np.diff(y, prepend=y[0]), np.ones(5), "same")
    moving = np.where(np.abs(smooth) > 1e-9 * stroke, np.sign(smooth), 0.0)  # rounding
    held = np.maximum.accumulate(np.where(moving != 0, np.arange(y.size), 0))
    rising = moving[held][rows]
    branches: Floats = np.hstack([level, level * rising[:, None]]).astype(np.float64)
    memory = dahl(LENGTHS * stroke, y, data.forgets)[rows]
    presliding = max(
        _explained(np.column_stack([level, memory[:, j]]), d[rows]) for j in range(LENGTHS.size)
    )
    return {
        "centre": _explained(level, d[rows]),
        "branches": _explained(branches, d[rows]),
        "presliding": presliding,
    }


def _choose(parts: dict[str, float]) -> str:
    """Return the plainest form that explains most of it."""
    best = "class"
    if parts["branches"] > MOSTLY:
        best = "branches"
    if parts["presliding"] > max(MOSTLY, parts["branches"] - 0.05):  # 0.05: it has fewer terms
        best = "presliding"
    if parts["centre"] > MOSTLY and parts["centre"] > max(parts.values()) - MORE:
        best = "centre"
    return best


def _explained(x: Floats, d: Floats) -> float:
    d = d - d.mean()
    w = np.linalg.lstsq(x, d, rcond=1e-10)[0]
    return float(1.0 - np.sum((d - x @ w) ** 2) / max(float(d @ d), 1e-300))
