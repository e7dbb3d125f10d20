"""Find the physics that the model in use leaves out: locate, name, model, show.

    diagnose(recordings, model=None, progress=None) -> Diagnosis

data/ is what the recordings are: prepare.py lays them on their grids and joins them, excerpt.py
cuts long ones, noise.py and colour.py measure the floor, survey.py tells what must be said first,
locate.py where a misfit sits. subject.py is the model in use. base.py explains all that a
rate-independent memory can, pasts.py tells how that memory began, columns.py keeps what a drive
makes of it; fit.py refits it and the effects of effects.py jointly. screen.py ranks
the candidates of dehyst.models.physics, shortlist.py which come next, judge.py says
which may count, search.py accepts one after the other, evidence.py holds out, intervals.py gives
the intervals. findings/ is what is said: reported.py drops what is not known well enough, rivals.py
finds near-ties, shape.py says what the base explains of the model in use, episodes.py what is there
for a part of the time, weigh.py what helps, decide.py names and gives the verdict, limits.py says
what would have been seen. augment.py writes a model, handout.py sees to it that it goes nowhere
astray. steps.py leads through the states, each frozen and made from the one before:

    Prepared, Based    based.py: the recordings and the model in use; what the search stands on
    Searched           searched.py: the effects that were found, and at which noise
    Judged             verdict.py: what is named, the verdict, the model that is written
    Diagnosis          result.py: what is reported
"""

from dehyst.models.diagnosis.result import DataQuality, Diagnosis, Finding, FitView, Limit, Value
from dehyst.models.diagnosis.steps import diagnose

__all__ = ["DataQuality", "Diagnosis", "Finding", "FitView", "Limit", "Value", "diagnose"]
