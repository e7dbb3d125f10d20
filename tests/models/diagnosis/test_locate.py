"""Where the misfit is: a line is located at its frequency, also between rows that do not count."""

from dataclasses import replace

import numpy as np
from tests.models.diagnosis.test_diagnosed_model import DT, N, drive

from dehyst.models.diagnosis.data.locate import locate
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.findings.decide import report_unknown
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


def test_no_place_holds_more_than_all_of_it() -> None:
    """Bins below the noise do not make the others hold more than the whole."""
    t = DT * np.arange(N)
    whole = prepare([Recording(t, drive(1), drive(1))])
    residual = np.where((t > 1.0) & (t < 1.2), 1.0, 0.0)
    for table in locate(whole, residual, 0.1)["time"].values():
        assert max(table["share"]) <= 1.0


def test_a_small_share_is_not_said_to_be_none() -> None:
    finding = report_unknown(0.1, 0.004, {"drive": "40% at 5.7 to 6 V"}, "um")
    assert finding.percent == "less than 1 %"
    assert "of this, 40% at 5.7 to 6 V of the drive" in finding.says
