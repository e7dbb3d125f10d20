"""Find the physics that the model in use leaves out: locate, name, model, show.

    diagnose(recordings, model=None, progress=None) -> Diagnosis

prepare.py lays the recordings on their grids and joins them (excerpt.py cuts long ones),
subject.py is the model in use, noise.py measures the floor, locate.py says where the misfit sits,
base.py explains all that a rate-independent memory can; fit.py refits it and the effects of
effects.py jointly. screen.py ranks the candidates that dehyst.models.physics hands out, judge.py
says which may count, search.py accepts one after the other, evidence.py holds out, told.py drops
what is not known well enough, rivals.py finds near-ties, intervals.py the intervals; sightings.py
takes what recordings show without a fit. shape.py says what the base explains of the model in
use, episodes.py what is there for a part of the time, colour.py what is noise of another colour.
decide.py names and gives the verdict, limits.py says what would have been seen, survey.py what is
to be said of the recordings first, augment.py writes the model, and steps.py puts it together
into the Diagnosis of result.py.
"""

from dehyst.models.diagnosis.result import DataQuality, Diagnosis, Finding, Limit, Value, View
from dehyst.models.diagnosis.steps import diagnose

__all__ = ["DataQuality", "Diagnosis", "Finding", "Limit", "Value", "View", "diagnose"]
