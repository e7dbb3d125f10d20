"""The start of a recording that begins at zero is judged correctly: de-energised or not.

Neither creep nor a lag changes the result; an exercise before the recording does.

The stage is the simulated one, of another class than the model; the drive is a sum of sines from
rest. The result itself is reported, so no threshold is needed.
"""

import numpy as np
import pytest

from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.identify.data.rows import read_rows
from dehyst.models.identify.setup import set_up
from dehyst.models.identify.start import start_agrees
from dehyst.models.recording import Floats, Recording

T = 1e-3
EFFECTS = {
    "none": {},
    "creep": {"creep_gain_per_decade": 0.03},
    "more creep": {"creep_gain_per_decade": 0.05},
    "lag": {"sensor_tau_s": 3e-3},
}


def exploring(seed: int, seconds: float = 20.0) -> Floats:
    """Return an open-loop drive for the identification: sines over the range, from rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / T)) * T
    u = sum(np.sin(2 * np.pi * (f * t + rng.random())) for f in (0.31, 0.73, 1.9, 4.1, 9.7))
    return (72.0 + 66.0 * u / np.max(np.abs(u))) * np.clip(t / 0.5, 0, 1)


def recorded(effect: str, exercised: bool, seed: int) -> Recording:
    """Return 20 s of the stage, either de-energised before or moved over its range for 5 s."""
    quiet = StageSettings(seed=seed).quiet(
        hysteresis_width=0.12, asymmetry=0.15, sensor_noise_um=0.01, **EFFECTS[effect]
    )
    stage = SimulatedStage(quiet)
    if exercised:
        for volts in 75.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(0.0, 5.0, 0.005))):
            stage.advance(0.005, volts)
        stage.settle(0.0, ramp_s=1.0, rest_s=2.0)
    drive = exploring(seed)
    reading = np.empty(drive.size)
    for k, volts in enumerate(drive):
        stage.advance(T, volts)
        reading[k] = stage.reading_um()
    return Recording(T * np.arange(drive.size), drive, reading, name="start.csv")


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("seed", [2, 4])
def test_the_start_is_reported_beside_what_depends_on_time(effect: str, seed: int) -> None:
    for exercised in (False, True):
        setup = set_up([read_rows(recorded(effect, exercised, seed))], monotone=True)
        assert setup.virgin
        assert start_agrees(setup, rate=False) is not exercised
        assert start_agrees(setup, rate=True) is not exercised
