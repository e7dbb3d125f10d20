"""Where the misfit is: a line is located at its frequency, also between rows that do not count."""

from dataclasses import replace

import numpy as np
from tests.models.diagnosis.test_diagnosed_model import DT, N, drive

from dehyst.models.diagnosis.data.locate import locate
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.recording import Recording

LINE_HZ = 37.0


def test_a_line_is_in_its_band_whichever_rows_count() -> None:
    t = DT * np.arange(N)
    u = drive(1)
    whole = prepare([Recording(t, u, u)])
    residual = np.sin(2 * np.pi * LINE_HZ * whole.t)
    third = np.arange(N) % 3 != 0
    for rows in (whole.rows, whole.rows & third, whole.rows & (t < 0.7 * t[-1])):
        bands = locate(replace(whole, rows=rows), residual, 0.01)["band"]
        strongest = int(np.argmax(bands["share"]))
        assert bands["edges"][strongest] <= LINE_HZ <= bands["edges"][strongest + 1]
        assert bands["share"][strongest] > 0.6
