"""A delay and a lag are found from ordinary drives and reported as what they are."""

import numpy as np
import pytest
from scipy import signal
from tests.rigs.outside import plays

from dehyst.models.identify import identify
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Floats, Recording

RATE_HZ, NOISE_UM, SECONDS = 1000.0, 0.008, 8.0
T = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
R = np.linspace(0.0, 70.0, 24)
W = 0.1 * np.exp(-R / 15.0) / np.exp(-R / 15.0).sum()
FLYBACK = 0.1  # share of a line of the raster
LINE = (2.0 * T) % 1.0
DRIVES = {
    "raster": 100.0 * np.minimum(LINE / (1.0 - FLYBACK), (1.0 - LINE) / FLYBACK),
    "sweep": 50.0 - 50.0 * np.cos(2 * np.pi * (0.2 * T + 0.2 * T**2)),
    "staircase": np.repeat(np.r_[0.0, np.random.default_rng(1).uniform(0.0, 100.0, 19)], 400),
}
OTHER = 50.0 - 30.0 * np.cos(2 * np.pi * 1.3 * T) - 20.0 * np.cos(2 * np.pi * 2.9 * T)


def delayed(y: Floats) -> Floats:
    """Return it three samples late."""
    return np.r_[np.full(3, y[0]), y[:-3]]


def lagged(y: Floats) -> Floats:
    """Return the response of a first-order lag of 5 ms to it, held between the samples."""
    num, den, _ = signal.cont2discrete(([1.0], [0.005, 1.0]), 1.0 / RATE_HZ)
    return np.asarray(signal.lfilter(num.ravel(), den, y - y[0]) + y[0])


EFFECTS = {"delay": (delayed, "delay_s", 0.003), "lag": (lagged, "tau_s", 0.005)}


def record(u: Floats, effect: str, seed: int) -> Recording:
    y = EFFECTS[effect][0](plays(u, R, W))
    noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(T[: u.size], u, y + noise, name="recording.csv")


@pytest.mark.parametrize(
    ("effect", "drive"),
    [
        ("delay", "raster"),
        ("delay", "sweep"),
        ("delay", "staircase"),
        ("lag", "raster"),
        ("lag", "sweep"),
    ],
)
def test_one_drive_shows_what_it_is_and_predicts_another(effect: str, drive: str) -> None:
    _, parameter, true_s = EFFECTS[effect]
    found = identify([record(DRIVES[drive], effect, 2)])
    (block,) = found.model.blocks
    assert block.kind == effect
    held_s = 0.25 / RATE_HZ if effect == "lag" else 0.0  # up to half a sample later
    assert block.params[parameter] == pytest.approx(true_s + held_s, abs=0.45 / RATE_HZ)
    assert validate(found.model, record(OTHER, effect, 3)).rms < 3.0 * NOISE_UM
