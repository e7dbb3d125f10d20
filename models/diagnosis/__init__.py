"""Find the physics that a stage's model leaves out: locate, name, model, show.

    diagnose(recordings, model=None, progress=None) -> Diagnosis

prepare.py joins the recordings, noise.py measures the floor, locate.py says where the misfit sits,
base.py explains all that a rate-independent memory can; fit.py refits it and the effects of
effects.py jointly. screen.py ranks the candidates that dehyst.models.physics hands out, judge.py
says which may count, search.py accepts one after the other, evidence.py holds out, rivals.py finds
near-ties, intervals.py the intervals; sightings.py takes what recordings show without a fit.
decide.py names and gives the verdict, limits.py says what would have been seen, augment.py writes
the model, and steps.py puts it together into the Diagnosis of result.py.
"""

from dehyst.models.diagnosis.result import Diagnosis, Finding, Limit, Value, View
from dehyst.models.diagnosis.steps import diagnose

__all__ = ["Diagnosis", "Finding", "Limit", "Value", "View", "diagnose"]
