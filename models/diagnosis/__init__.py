"""Find the physics that a stage's model leaves out: locate, name, model, show.

    diagnose(recordings, model=None, progress=None) -> Diagnosis

data.py prepares, noise.py measures the floor, base.py explains all that a rate-independent
memory can, candidates/ is the library of physics, fit.py refits everything jointly, decide.py
accepts, limits.py says what would have been seen, engine.py puts it together.
"""

from dehyst.models.diagnosis.engine import diagnose
from dehyst.models.diagnosis.result import Diagnosis, Finding, Limit, Value, View

__all__ = ["Diagnosis", "Finding", "Limit", "Value", "View", "diagnose"]
