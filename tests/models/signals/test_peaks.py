"""The frequencies at which a residual rings are those of its largest part."""

import numpy as np

from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.recording import Recording
from dehyst.models.signals.peaks import peaks

T = np.arange(8000) / 5000.0


def test_the_strongest_ring_comes_first_however_quiet_another_recording_is() -> None:
    """Two weak lines stand higher above next to nothing than a mode above its own flanks."""
    rng = np.random.default_rng(4)
    quiet = 1e-6 * rng.standard_normal(T.size)
    quiet += 0.03 * np.sin(2 * np.pi * 33.0 * T) + 0.03 * np.sin(2 * np.pi * 52.0 * T)
    since = T % 0.064
    ring = np.exp(-200.0 * since) * np.sin(2 * np.pi * 771.0 * since)
    ring += 0.01 * rng.standard_normal(T.size)
    given = [Recording(T, np.sin(9.0 * T), np.sin(9.0 * T), name=f"{k}.csv") for k in range(2)]
    found = peaks(prepare(given), np.concatenate([quiet, ring]))
    assert abs(found[0] - 771.0) < 20.0
