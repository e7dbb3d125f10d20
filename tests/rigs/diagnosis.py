"""A diagnosis without its limits, for tests that judge the findings.

To determine what would have been detected, each cause is added and every question is repeated:
about half of the time that a diagnosis takes. Limits are judged by
tests/models/diagnosis/test_names.py, test_hard_recordings.py, test_data_first.py, test_times.py and
test_what_counts.py, and by the proof among the benchmarks.
"""

from collections.abc import Sequence

from dehyst.models.diagnosis import Diagnosis, diagnose
from dehyst.models.model import Model
from dehyst.models.recording import Recording


def diagnose_without_limits(
    recordings: Sequence[Recording], model: Model | None = None
) -> Diagnosis:
    """Run `diagnose` without the limits."""
    return diagnose(recordings, model, with_limits=False)
