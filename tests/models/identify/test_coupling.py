"""Identified coupling from other axes, compared with the gains that made the recordings."""

import numpy as np
import pytest

from dehyst.models.cascade.simulate import simulate
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.identify import Identification, Options, identify
from dehyst.models.model import Hysteresis
from dehyst.models.modelfile import dumps, loads
from dehyst.models.recording import Floats, Recording

T, NOISE = 5e-3, 0.02
X = Hysteresis(
    r=np.array([0.0, 8.0, 20.0, 40.0]),
    b=np.array([0.07, 0.02, 0.015, 0.01]),
    k=np.zeros(4),
    c=np.array([0.0, 1.0]),
    u_offset=0.0,
)
Y = Hysteresis(
    r=np.array([0.0, 15.0, 30.0]),
    b=np.array([0.08, 0.02, 0.02]),
    k=np.zeros(3),
    c=np.array([0.0, 1.0]),
    u_offset=0.0,
)


def waves(n: int, hz: float) -> Floats:
    t = np.arange(n) * T
    envelope = np.interp(t / t[-1], [0.0, 0.3, 0.6, 1.0], [1.0, 1.0, 0.3, 1.0])
    return 70.0 * (1.0 - envelope * np.cos(2 * np.pi * hz * t))


def run(seed: int, gain: float, apart: bool = True) -> Recording:
    """Return a recording in which x moves alone, then y alone, then both; or always both."""
    n = 1000
    rest = np.zeros(n)
    parts = ((waves(n, 1.0), rest), (rest, waves(n, 0.8)), (waves(n, 1.0), waves(n, 0.77)))
    if not apart:
        parts = ((waves(3 * n, 1.0), waves(3 * n, 0.97)),)
    ux = np.concatenate([part[0] for part in parts])
    uy = np.concatenate([part[1] for part in parts])
    noise = np.random.default_rng(seed).standard_normal((2, ux.size)) * NOISE
    y = simulate_hysteresis(Y, uy, T)
    x = simulate_hysteresis(X, ux, T) + gain * (y - 2.0)
    channels = {"axis.y": y + noise[1], "axis.y.drive": uy}
    return Recording(
        np.arange(ux.size) * T, ux, x + noise[0], channels=channels, name=f"run {seed}"
    )


def left(found: Identification, recording: Recording) -> float:
    assert recording.displacement is not None
    model = loads(dumps(found.model))
    y = simulate(model, recording.t_s, recording.drive, recording.channels)
    return float(np.std(recording.displacement - y))


@pytest.mark.parametrize("apart", [True, False])
def test_the_gain_is_found_and_kept(apart: bool) -> None:
    found = identify([run(1, 0.03, apart)], Options(rate=False, saturation=1))
    (block,) = found.model.blocks
    assert (block.kind, block.place, block.channel) == ("coupling", "stage", "axis.y")
    assert block.params["gain_um_per_unit"] == pytest.approx(0.03, abs=3e-4)
    assert left(found, run(2, 0.03)) < 1.15 * NOISE
    assert any("axis.y moves this axis by +0.0" in note for note in found.notes)


def test_nothing_is_kept_where_nothing_is() -> None:
    found = identify([run(3, 0.0)], Options(rate=False, saturation=1))
    assert found.couplings == ()
    assert found.model.blocks == ()


def test_the_drive_stands_in_where_there_is_no_displacement() -> None:
    one = run(4, 0.03)
    channels = {"axis.y.drive": one.channels["axis.y.drive"]}
    found = identify(
        [Recording(one.t_s, one.drive, one.displacement, channels=channels)],
        Options(rate=False, saturation=1),
    )
    (block,) = found.model.blocks
    assert block.channel == "axis.y.drive"
    assert block.params["gain_um_per_unit"] == pytest.approx(0.03 * 0.105, rel=0.15)
