"""Choose the problem that the search works on: Prepared -> SearchProblem. The base is rich, and is
added to the identified model where that alone predicts better; the drive is shifted earlier where
the recorder holds each command or is a row off."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dehyst.models.diagnosis.base import no_base, rich_base
from dehyst.models.diagnosis.data.between import with_path_between
from dehyst.models.diagnosis.data.excerpt import excerpt
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.prepare import prepare, were_de_energised
from dehyst.models.diagnosis.diagnosed_model import (
    DiagnosedModel,
    fit_plain_model,
    identify_plain_model,
    take_given_model,
)
from dehyst.models.diagnosis.evidence import blockwise_held_out_error
from dehyst.models.diagnosis.findings.episodes import Episode, find_episodes
from dehyst.models.diagnosis.findings.stage_changes import find_stage_change
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import base_error, misfit_beyond_noise, try_candidate
from dehyst.models.diagnosis.pasts import choose_pasts
from dehyst.models.diagnosis.result import Progress
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import format_length
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Data


@dataclass(frozen=True)
class Prepared:
    """recordings: as they are diagnosed; whole: all their samples; data: those that are fitted,
    each recording with the past that fits it best; diagnosed: the model in use."""

    recordings: Sequence[Recording]
    whole: Data
    data: Data
    diagnosed: DiagnosedModel


@dataclass(frozen=True)
class SearchStart:
    """A problem, its fit without effects, and the assumed noise [rms]."""

    problem: Problem
    null: JointFit
    sigma: float

    def with_problem(self, problem: Problem) -> "SearchStart":
        """Return the same on another problem."""
        same = problem is self.problem
        return self if same else replace(self, problem=problem, null=problem.solve([]))

    def with_estimated_noise(self) -> "SearchStart":
        """Return the same with the noise estimated from the fit's residual."""
        data = self.problem.data
        return replace(self, sigma=noise_rms(data, self.null.residual(data)))


@dataclass(frozen=True)
class SearchProblem:
    """The problem that the search works on. whole: all samples; bare: the model in use alone;
    start: base and drive that explain most without effects, the episode subtracted from the
    reading; foreign: the warning about a model of another stage, or ""."""

    whole: Data
    bare: Problem
    start: SearchStart
    episode: Episode | None
    foreign: str


def join_recordings(
    recordings: Sequence[Recording], model: Model | None, say: Progress, rows_early: int = 0
) -> Prepared:
    """Return the recordings on their grids, and the model in use, which is identified if none is
    given. rows_early: by how many rows their drive was moved."""
    say("preparing", 0.0)
    whole = prepare(recordings, were_de_energised(recordings))
    whole = replace(whole, rows_early=rows_early)
    say("the model in use", 0.02)
    data = choose_pasts(excerpt(whole))
    diagnosed = (
        identify_plain_model(recordings, data) if model is None else take_given_model(model, data)
    )
    return Prepared(recordings, whole, data, diagnosed)


def choose_base(
    prepared: Prepared, several: Callable[..., Iterable[Any]], say: Progress
) -> SearchProblem:
    """Choose the base, the drive and its path between the samples by what they explain without
    effects."""
    data, diagnosed = prepared.data, prepared.diagnosed
    problem = Problem(data, rich_base(data), diagnosed, several)
    rich = SearchStart(problem, problem.solve([]), 0.0).with_estimated_noise()
    bare = Problem(data, no_base(data), replace(diagnosed, carries=True), several)
    foreign = warn_of_another_stage(bare, rich.null, rich.sigma)
    if foreign:
        say(foreign, 0.1)
    say("base fitted", 0.1)
    earlier = None if data.rows_early else choose_earlier_drive(problem, rich.null, rich.sigma)
    if earlier is not None and earlier.data.early == 1.0:  # repeat with the drives moved
        moved = [move_drive_a_row_earlier(one) for one in prepared.recordings]
        model = diagnosed.model if diagnosed.given else None
        return choose_base(join_recordings(moved, model, say, rows_early=1), several, say)
    early = rich.with_problem(earlier or problem)
    search_start = early.with_problem(choose_model_under_base(early.problem, early.null))
    fed = replace(
        search_start,
        problem=choose_zero_order_hold(search_start.problem, search_start.null, search_start.sigma),
    )
    finer = with_path_between(fed.problem.data, fed.sigma)
    if finer is not fed.problem.data:
        fed = fed.with_problem(replace(fed.problem, data=finer)).with_estimated_noise()
    # what acts for part of the time is reported with that time; no other physics explains it
    episode = find_episodes(finer, fed.null.residual(finer), fed.sigma)
    if episode is None:
        episode = find_stage_change(fed.problem, fed.null, fed.sigma)
    if episode is not None:
        without = replace(finer, y=finer.y - episode.removed)
        problem = replace(fed.problem, data=without)
        if episode.of_stage and not diagnosed.given:  # it was identified across the change
            plain = fit_plain_model(without, diagnosed.model.hysteresis.r)
            bare = replace(bare, diagnosed=replace(bare.diagnosed, model=plain))
            problem = replace(problem, diagnosed=replace(problem.diagnosed, model=plain))
        fed = fed.with_problem(problem)
    return SearchProblem(prepared.whole, bare, fed, episode, foreign)


def choose_model_under_base(problem: Problem, null: JointFit) -> Problem:
    """Return the problem with the base added to the model in use, or with the base alone, whichever
    predicts better.

    The base is added to an identified model where that model alone predicts better than the base:
    then no effect has distorted it, and the base need not find it again. A given model is removed
    where the base predicts much better without it: an effect has distorted it so that the base
    cannot correct it. (Creep makes a recording that begins at rest look as if the stage had been
    moved before.) A given model with blocks stays: otherwise its blocks would be found as if they
    were new.
    """
    diagnosed, over_base = problem.diagnosed, blockwise_held_out_error(problem, null)
    if diagnosed.carries:
        if diagnosed.model.blocks:
            return problem
        freed = replace(problem, diagnosed=replace(diagnosed, carries=False))
        without = blockwise_held_out_error(freed, freed.solve([]))
        return freed if without < TUNING.most * over_base else problem
    data = problem.data
    carried = replace(problem, diagnosed=replace(diagnosed, carries=True))
    alone = replace(carried, base=no_base(data)).solve([]).sse / int(data.rows.sum())
    return carried if alone < over_base else problem


def choose_earlier_drive(problem: Problem, null: JointFit, sigma: float) -> Problem | None:
    """Return the problem with the drive half a sample or a whole sample earlier, where that
    explains much of the misfit. A whole sample must explain all of it, or most of it and much more
    than half a sample does, because loops that narrow with the rate look early, too. Return None
    where a drive one sample later explains as much: then something is late.

    Nothing physical leads the drive. A recorder that holds each command and reads at the end of the
    sample makes the reading lead by half a sample, relative to the straight lines between samples
    that all models here assume; one that writes a reading into the row before makes it lead by a
    whole sample.
    """
    found, left = None, misfit_beyond_noise(problem, null, sigma)
    most = TUNING.quarter * left
    for samples in (0.5, 1.0):
        data = _with_drive_moved(problem.data, samples)
        moved = replace(problem, data=data, base=rich_base(data))
        leaves = _misfit_of_any_loop(moved, sigma)
        nothing = max(TUNING.strong * sigma, base_error(data)) ** 2
        much = found is not None and leaves <= min(most, TUNING.half * left)
        if samples == 1.0 and leaves > nothing and not much:
            break
        # where half a sample already explains much, a whole one only has to be better
        least = TUNING.clear if found is None else TUNING.visible
        if left - leaves >= max(TUNING.half * left, (least * sigma) ** 2):
            found, left = moved, leaves
    if found is None:
        return None
    late = _with_drive_moved(problem.data, -1.0)
    return found if _misfit_of_any_loop(replace(found, data=late), sigma) > left else None


def move_drive_a_row_earlier(recording: Recording) -> Recording:
    """Return a recording with the drive of each row in the row before; the last row keeps its
    own."""
    drive = np.append(recording.drive[1:], recording.drive[-1])
    return replace(recording, drive=drive)


def _with_drive_moved(data: Data, samples: float) -> Data:
    """Return the data with the drive that many samples earlier: half a sample by interpolation,
    otherwise by whole rows."""
    if samples == 0.5:
        u = data.u + 0.5 * np.where(data.starts, 0.0, np.diff(data.u, prepend=0.0))
        return replace(data, u=u, early=samples)
    at = np.clip(np.arange(data.n) + int(samples), 0, data.n - 1)
    at = np.where(data.part[at] == data.part, at, np.arange(data.n))
    return replace(data, u=data.u[at], early=samples)


def _misfit_of_any_loop(problem: Problem, sigma: float) -> float:
    """Return the mean square beyond the noise that a loop of any shape leaves."""
    light = problem.with_fewer_rows(TUNING.search_rows)
    return misfit_beyond_noise(light, light.solve([]), sigma)


def choose_zero_order_hold(problem: Problem, null: JointFit, sigma: float) -> Problem:
    """Return the problem with lags and modes fed by steps, where one of them then leaves much less.

    A control loop writes a command and holds it. If only the hysteresis lies between the drive and
    a reading taken just before the next command, the hold does not show; dynamics after the
    hysteresis respond half a sample earlier than straight lines between the samples predict. Fitted
    with straight lines, a mode leaves as much again as its own share, and friction is reported in
    addition.
    """
    if (
        problem.data.early
        or misfit_beyond_noise(problem, null, sigma) < (TUNING.strong * sigma) ** 2
    ):
        return problem
    light = problem.with_fewer_rows(TUNING.limit_rows)
    start = light.solve([])
    straight = _least_misfit(light, start, sigma)
    least = max(TUNING.half * straight, (TUNING.strong * sigma) ** 2)
    if straight <= least:
        return problem
    steps = _least_misfit(light.with_zero_order_hold(), start, sigma)
    return problem.with_zero_order_hold() if straight - steps > least else problem


def _least_misfit(problem: Problem, start: JointFit, sigma: float) -> float:
    """Return the least mean square beyond the noise that one candidate leaves, of those that show
    how they are fed: the plainest of each name that acts on the hysteresis' output, within a period
    of the drive. A mode that rings through a whole recording is not the stage's: it copies a line
    of the surroundings."""
    shortest_s = float((np.bincount(problem.data.rec) * problem.data.period).min())
    screen, left = Screen(problem, start), [misfit_beyond_noise(problem, start, sigma)]
    fed = [c for c in list_candidates(problem.data) if c.mode == "output" and not c.lasting]
    for candidate in {c.name: c for c in reversed(fed)}.values():
        ranked = screen.starts(candidate)
        if ranked and ranked[0][0] > 0:
            trial = try_candidate(problem, sigma, start, candidate, ranked[0][1])
            ring = candidate.free_oscillation(trial.fit.effects[-1].theta)
            if ring is None or ring[1] * TUNING.minor * shortest_s > 1.0:
                left.append(misfit_beyond_noise(problem, trial.fit, sigma))
    return min(left)


def warn_of_another_stage(bare: Problem, null: JointFit, sigma: float) -> str:
    """Return the warning for a given model that is far off these recordings; "" where it is not."""
    if not bare.diagnosed.given:
        return ""
    n = int(bare.data.rows.sum())
    left = float(np.sqrt(bare.solve([]).sse / n))
    best = max(float(np.sqrt(null.sse / n)), sigma)
    stroke = float(np.ptp(bare.data.y))
    if left < max(TUNING.crumb * stroke, TUNING.foreign_times * best):
        return ""
    unit = bare.data.unit
    return (
        "the model does not fit this stage in its present state: it leaves "
        f"{format_length((left, unit))} rms of a stroke of {stroke:.3g} {unit}, where a hysteresis "
        f"fitted here leaves {format_length((best, unit))}; identify a model from these recordings"
    )
