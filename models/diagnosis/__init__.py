"""Find the physics that the model in use leaves out: locate, name, model, show.

    diagnose(recordings, model=None, progress=None) -> Diagnosis

data/ is what the recordings are: prepare.py lays them on their grids and joins them, excerpt.py
cuts long ones, noise.py and colour.py measure the floor, survey.py tells what must be said first,
locate.py where a misfit sits. subject.py is the model in use. base.py explains all that a
rate-independent memory can, pasts.py tells how that memory began, columns.py keeps what a drive
makes of it; fit.py refits it and the effects of effects.py jointly. screen.py ranks
the candidates of dehyst.models.physics, shortlist.py which come next, judge.py says
which may count, search.py accepts one after the other, evidence.py holds out, intervals.py gives
the intervals, and find.py chooses the base and the noise that the search stands on. findings/ is
what is said: reported.py drops what is not known well enough, rivals.py finds near-ties,
sightings.py takes what recordings show without a fit, shape.py says what the base explains of the
model in use, episodes.py what is there for a part of the time, weigh.py what helps, decide.py
names and gives the verdict, limits.py says what would have been seen. augment.py writes a model,
handout.py sees to it that it goes nowhere astray, and steps.py puts it together into the Diagnosis
of result.py.
"""

from dehyst.models.diagnosis.result import DataQuality, Diagnosis, Finding, FitView, Limit, Value
from dehyst.models.diagnosis.steps import diagnose

__all__ = ["DataQuality", "Diagnosis", "Finding", "FitView", "Limit", "Value", "diagnose"]
