"""The experiment that separates two candidates, compared with what physics says of each pair."""

import numpy as np
import pytest

from dehyst.models.drive_design.separation import EFFECTS, separate
from dehyst.models.drive_design.waveforms import WAVEFORMS, Limits
from dehyst.models.errors import BadInput

LIMITS = Limits(0.0, 10.0, 2000.0, 1e-3, 8.0)


@pytest.mark.parametrize("waveform", WAVEFORMS, ids=lambda w: w.name)
@pytest.mark.parametrize("rate", [40.0, 5000.0])
def test_every_waveform_keeps_inside_range_and_rate(waveform, rate):
    limits = Limits(-1.0, 4.0, rate, 2e-3, 6.0)
    u = waveform.make(limits)
    assert u.shape == limits.times.shape
    assert u.min() >= -1.0 - 1e-9
    assert u.max() <= 4.0 + 1e-9
    assert np.max(np.abs(np.diff(u))) <= rate * limits.period_s
    assert abs(u[0] - limits.drive_min) <= rate * limits.period_s


def test_what_does_not_move_with_the_drive_needs_no_drive():
    worth = {s.waveform.name: s.worth for s in separate("coupling", "drift", LIMITS).tried}
    assert worth["rest"] > 0.7 * max(worth.values())


def test_lag_and_delay_need_high_frequencies():
    experiment = separate("delay", "lag", LIMITS)
    assert experiment.chosen.waveform.name in ("three speeds", "large sweep", "small sweep")
    worth = {s.waveform.name: s.worth for s in experiment.tried}
    assert worth["slow triangle"] < 0.05 * experiment.chosen.worth


def test_creep_and_lag_need_holds():
    experiment = separate("creep", "lag", LIMITS)
    assert experiment.chosen.worth > 0.005
    assert "rms" in experiment.says


def test_order_does_not_matter_and_the_best_comes_first():
    ab, ba = separate("slew", "lag", LIMITS), separate("lag", "slew", LIMITS)
    assert ab.chosen.waveform == ba.chosen.waveform
    assert ab.chosen.left_a == pytest.approx(ba.chosen.left_b)
    worth = [s.worth for s in ab.tried]
    assert worth == sorted(worth, reverse=True)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_can_be_set_against_another(name):
    rival = "creep" if name != "creep" else "delay"
    short = Limits(0.0, 10.0, 2000.0, 2e-3, 4.0)
    experiment = separate(name, rival, short)
    assert np.isfinite(experiment.chosen.worth)
    assert experiment.drive.size == short.times.size


def test_unknown_and_equal_names_are_refused():
    with pytest.raises(BadInput, match="known are"):
        separate("gremlins", "lag", LIMITS)
    with pytest.raises(BadInput, match="same"):
        separate("lag", "lag", LIMITS)
    with pytest.raises(BadInput, match="range"):
        Limits(1.0, 1.0, 1.0, 1e-3)
