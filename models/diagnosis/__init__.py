"""Find the physics that the model in use leaves out: locate the misfit, name its cause, write a
model, report.

    diagnose(recordings, model=None, progress=None) -> Diagnosis

data/ describes the recordings: prepare.py lays them on their grids and joins them, excerpt.py cuts
long ones, noise.py and colour.py estimate the noise floor, survey.py collects the warnings that
come first, locate.py finds where the misfit is. diagnosed_model.py holds the model in use. base.py
explains all that a rate-independent memory can, pasts.py finds how that memory began, columns.py
caches the base's columns for a drive; fit.py refits the base and the effects of effects.py jointly.
screen.py ranks the candidates of dehyst.models.physics, shortlist.py decides which to try next,
judge.py decides which may count, search.py accepts one after the other, evidence.py holds data out,
intervals.py computes the intervals. findings/ is what is reported: reported.py drops effects that
are not known well enough, rivals.py finds near-ties, shape.py reports what the base explains of the
misfit of the model in use, episodes.py finds lines present for part of the time, stage_changes.py a
sudden change of the stage itself, spans.py effects that begin or end within a recording, weigh.py
decides what helps, decide.py writes the findings and the verdict, limits.py computes what would
have been seen. augment.py writes a model, written_model.py chooses the one that is written and
rejects those that diverge. steps.py runs the states in order, each frozen and made from the one
before:

    Prepared, SearchProblem    search_problem.py: the recordings and the model in use; base and
                               drive of the search
    Searched           searched.py: the effects that were found, and at which noise
    Judged             verdict.py: what is named, the verdict, the model that is written
    Diagnosis          result.py: what is reported
"""

from dehyst.models.diagnosis.result import DataQuality, Diagnosis, Finding, FitView, Limit, Value
from dehyst.models.diagnosis.steps import diagnose

__all__ = ["DataQuality", "Diagnosis", "Finding", "FitView", "Limit", "Value", "diagnose"]
