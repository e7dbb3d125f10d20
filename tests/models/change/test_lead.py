"""The lead-in of a recording only sets the hysteresis memory; it is not fitted."""

import numpy as np

from dehyst.models.change.lead import blank_lead, drop_lead
from dehyst.models.recording import Recording

ONE = Recording(
    10.0 + 0.1 * np.arange(50), np.arange(50.0), 2.0 * np.arange(50), channels={"c": np.arange(50)}
)


def test_the_first_seconds_have_a_drive_and_no_reading() -> None:
    led = blank_lead(ONE, 2.0)
    assert led.displacement is not None
    assert np.isnan(led.displacement[:20]).all()
    assert np.array_equal(led.displacement[20:], 2.0 * np.arange(20, 50))
    assert np.array_equal(led.drive, ONE.drive)
    assert blank_lead(ONE, 0.0) is ONE


def test_what_counts_alone() -> None:
    rest = drop_lead(ONE, 2.0)
    assert rest.t_s[0] == 12.0
    assert rest.displacement is not None
    assert np.array_equal(rest.displacement, 2.0 * np.arange(20, 50))
    assert np.array_equal(rest.channels["c"], np.arange(20, 50))
    assert drop_lead(ONE, 0.0) is ONE
    assert drop_lead(ONE, 99.0) is ONE  # keeping all is better than keeping nothing
