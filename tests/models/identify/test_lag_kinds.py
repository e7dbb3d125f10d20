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


TAU_S = 0.005


def delayed(y: Floats) -> Floats:
    """Return it three samples late."""
    return np.r_[np.full(3, y[0]), y[:-3]]


def lagged(y: Floats, moves: str = "held from each sample on") -> Floats:
    """Return the response of a first-order lag to it, which moves in this way between samples."""
    method = "foh" if moves == "in lines" else "zoh"
    num, den, _ = signal.cont2discrete(([1.0], [TAU_S, 1.0]), 1.0 / RATE_HZ, method)
    if moves == "held since the sample before":
        num = np.roll(num, -1)
    return np.asarray(signal.lfilter(num.ravel(), den, y - y[0]) + y[0])


EFFECTS = {"delay": (delayed, "delay_s", 0.003), "lag": (lagged, "tau_s", TAU_S)}
INPUTS = {  # how it moves between samples: (input is held, delay of a period)
    "in lines": (0.0, False),
    "held since the sample before": (1.0, False),
    "held from each sample on": (1.0, True),
}


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
    *before, block = found.model.blocks
    assert block.kind == effect
    assert [one.params for one in before] == [{"delay_s": 1.0 / RATE_HZ}] * (effect == "lag")
    assert block.params[parameter] == pytest.approx(true_s, abs=0.2 / RATE_HZ)
    assert validate(found.model, record(OTHER, effect, 3)).rms < 3.0 * NOISE_UM


@pytest.mark.parametrize("moves", INPUTS)
@pytest.mark.parametrize("place", ["drive", "sensor"])
@pytest.mark.parametrize("drive", ["staircase", "raster"])
def test_how_the_input_of_a_lag_moves_between_samples_is_found(
    drive: str, place: str, moves: str
) -> None:
    """If the input is held and the model's moves in straight lines, the lag is half a sample off,
    which another drive shows."""

    def make(u: Floats, seed: int) -> Recording:
        y = plays(lagged(u, moves), R, W) if place == "drive" else lagged(plays(u, R, W), moves)
        noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
        return Recording(T[: u.size], u, y + noise, name="recording.csv")

    model = identify([make(DRIVES[drive], 2)]).model
    *before, lag = model.blocks
    held, late = INPUTS[moves]
    assert (lag.kind, lag.place, lag.params.get("held", 0.0)) == ("lag", place, held)
    assert lag.params["tau_s"] == pytest.approx(TAU_S, rel=0.02)
    assert [block.params["delay_s"] for block in before] == [1.0 / RATE_HZ] * late
    assert validate(model, make(OTHER, 3)).rms < 1.25 * NOISE_UM
