"""The whole cascade: running it sample by sample gives the array form; the compensator undoes what
moves the stage and leaves what only affects the sensor."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dehyst.models.cascade.simulate import simulate_parts
from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.monotone import nearest_monotone
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.modelfile import shipped

DT = 1e-3
BLOCKS = {
    "creep": Block(
        "creep", "stage", {"gain_per_decade": 0.015, "tau_min_s": 0.01, "tau_max_s": 100.0}
    ),
    "resonance": Block(
        "resonance", "stage", {"frequency_hz": 180.0, "damping": 0.05, "share": 1.0}
    ),
    "stage lag": Block("lag", "stage", {"tau_s": 2e-3}),
    "drive lag": Block("lag", "drive", {"tau_s": 1e-3}),
    "delay": Block("delay", "stage", {"delay_s": 3.3e-3}),
    "drift": Block(
        "drift",
        "stage",
        {"gain_per_k": 0.01, "expansion_um_per_k": 0.2, "reference_c": 20.0},
        "temp_c",
    ),
    "coupling": Block("coupling", "stage", {"gain_um_per_unit": 0.05}, "u2_v"),
    "polynomial": Block("polynomial", "stage", {"coefficients": (0.1, 1.02, -0.004)}),
    "slow drift": Block(
        "slow_drift",
        "stage",
        {"gain_per_k": 0.01, "expansion_um_per_k": 0.2, "reference_c": 20.0, "tau_s": 0.2},
        "temp_c",
    ),
    "coupled memory": Block(
        "coupled_memory",
        "stage",
        {
            "thresholds": (0.2, 1.0),
            "gains_um": (0.3, 0.1),
            "tau_s": 0.01,
            "scale": 2.0,
            "reference": 1.0,
        },
        "u2_v",
    ),
    "coupled mode": Block(
        "coupled_mode",
        "stage",
        {"frequency_hz": 40.0, "damping": 0.1, "gain_um_per_unit": 0.1},
        "u2_v",
    ),
    "friction": Block(
        "friction",
        "stage",
        {"length_um": 0.4, "stribeck_um_per_s": 100.0, "sliding_um": 0.1, "extra_um": 0.05},
    ),
    "dry friction": Block(
        "friction",
        "stage",
        {
            "length_um": 0.21,
            "stribeck_um_per_s": 100.0,
            "sliding_um": 0.2,
            "extra_um": 0.0,
            "exponent": 0.0,
        },
    ),
    "bristles": Block(
        "bristles",
        "stage",
        {
            "length_um": 0.2,
            "stribeck_um_per_s": 40.0,
            "excess": 0.5,
            "sliding_um": 0.05,
            "gain_um_per_v": 1.1,
        },
    ),
    "shape": Block(
        "shape",
        "stage",
        {
            "thresholds_v": (0.5, 2.0),
            "weights_2": (0.8, 0.4),
            "weights_3": (0.0, -0.5),
            "scale_v": 10.0,
        },
    ),
    "rate": Block(
        "rate",
        "stage",
        {
            "thresholds_v": (0.3, 1.0, 2.5),
            "weights": (0.5, 0.4, 0.3),
            "dilation": 0.05,
            "slopes": (0.004, 0.003, 0.002),
            "power": 0.4,
            "smoothing_s": 0.01,
            "scale_v": 5.0,
            "center_v": 5.0,
        },
    ),
    "memory": Block(
        "memory",
        "stage",
        {
            "lengths_v": (2.0, 5.0),
            "weights_1": (0.1, 0.1),
            "weights_2": (0.2, -0.1),
            "weights_3": 0.0,
            "weights_4": 0.0,
            "weights_5": 0.0,
            "scale_v": 5.0,
            "center_v": 5.0,
        },
    ),
    "one sided": Block(
        "one_sided",
        "stage",
        {"threshold_v": 1.0, "rising_um_per_v2": -0.1, "falling_um_per_v2": 0.2},
    ),
}
SENSOR = Block("lag", "sensor", {"tau_s": 5e-3})
CHANNELS = ("temp_c", "u2_v")


def _model(*blocks: Block, rate: bool = False) -> Model:
    paper = shipped("paper-eq12")
    model = paper if rate else nearest_monotone(paper)[0]
    return Model(model.hysteresis, Validity(0.0, 10.0, 200.0), blocks=blocks)


def _target(seconds: float = 1.0) -> np.ndarray:
    t = np.arange(round(seconds / DT)) * DT
    return 5.5 - 2.5 * np.cos(2 * np.pi * 4 * t) + 0.5 * np.sin(2 * np.pi * 9 * t)


def _channels(n: int) -> dict[str, np.ndarray]:
    t = np.arange(n) * DT
    return {"temp_c": 21.0 + 0.5 * t, "u2_v": 3.0 + np.sin(2 * np.pi * 3 * t)}


def _tracking(model: Model, preview_s: float, knows: Model | None = None) -> float:
    """Return the rms error [um] of the plant `model` after 0.3 s for a compensator of `knows`."""
    knows = knows or model
    comp = Compensator(knows, DT, 0.0, 10.0, 1e4, "auto", preview_s)
    target = _target()
    channels = _channels(target.size)
    columns = np.zeros((target.size, len(comp.channels)))
    for j, name in enumerate(comp.channels):
        columns[:, j] = channels[name]
    drive = invert_streamed(comp, target, columns).drive
    # One sample at rest first: blocks settle there, as the compensator's do.
    rested = {name: np.concatenate([values[:1], values]) for name, values in channels.items()}
    stage = simulate_parts(model, DT, np.concatenate([[0.0], drive]), rested).stage[1:]
    return float(np.sqrt(np.mean((stage - target)[300:-100] ** 2)))


def test_one_sample_at_a_time_is_the_array_form() -> None:
    model = _model(*BLOCKS.values(), SENSOR)
    comp = Compensator(model, DT, 0.0, 10.0, 1e9, "static")
    u = 5 + 4 * np.sin(np.arange(800) * 0.03)
    channels = _channels(u.size)
    parts = simulate_parts(model, DT, u, channels)
    state = comp.init(float(u[0]))
    stage, reading = [], []
    for i, value in enumerate(u):
        state.channels[:] = [channels[name][i] for name in comp.channels]
        comp.applied(state, float(value))
        stage.append(state.predicted)
        reading.append(state.reading)
    # Blocks settle at another first input here, and forget it.
    late = slice(400, None)
    assert np.max(np.abs(np.array(stage) - parts.stage)[late]) < 0.02
    assert np.max(np.abs(np.array(reading) - parts.reading)[late]) < 0.02


@pytest.mark.parametrize("name", sorted(BLOCKS))
def test_each_block_that_moves_the_stage_is_compensated(name: str) -> None:
    model = _model(BLOCKS[name])
    with_block = _tracking(model, 0.05)
    without = _tracking(model, 0.05, _model())
    assert with_block < 0.005
    assert with_block < 0.3 * without


@pytest.mark.parametrize("rate", [False, True])
def test_all_blocks_together(rate: bool) -> None:
    blocks = [BLOCKS[k] for k in ("drive lag", "creep", "resonance", "delay", "drift", "coupling")]
    model = _model(*blocks, rate=rate)
    assert _tracking(model, 0.1) < 0.05
    assert _tracking(model, 0.1, _model(rate=rate)) > 0.25


@pytest.mark.parametrize("rate", [False, True])
def test_a_delay_of_the_drive_is_undone_like_one_of_the_stage(rate: bool) -> None:
    """The next drive is computed from the drive that was output, not from the delayed one."""
    late = Block("delay", "drive", {"delay_s": 3.3e-3})
    at_stage = _tracking(_model(BLOCKS["delay"], rate=rate), 0.1)
    assert _tracking(_model(late, rate=rate), 0.1) < at_stage + 1e-3


def test_the_sensors_own_filter_is_not_compensated() -> None:
    plain, filtered = _model(), _model(SENSOR)
    assert _tracking(filtered, 0.05) == pytest.approx(_tracking(plain, 0.05), abs=1e-9)


def test_a_delay_asks_for_targets_ahead() -> None:
    comp = Compensator(_model(BLOCKS["delay"]), DT, 0.0, 10.0, 1e4, "auto", 0.05)
    assert comp.mode == "preview"
    assert comp.latency_s >= 3.3e-3
    assert "delay" in comp.reason


def test_slew_and_clip_blocks_narrow_the_limits() -> None:
    blocks = (
        Block("slew", "drive", {"rate_v_per_s": 40.0}),
        Block("clip", "drive", {"min_v": 1.0, "max_v": 8.0}),
    )
    comp = Compensator(_model(*blocks), DT, 0.0, 10.0, 1e4)
    assert (comp.low, comp.high, comp.rate) == (1.0, 8.0, 40.0)
    with pytest.raises(BadInput, match="leave nothing"):
        Compensator(_model(*blocks), DT, 8.5, 10.0, 1e4)


def test_a_shape_beside_the_hysteresis_is_followed() -> None:
    shape = Block(
        "shape",
        "stage",
        {
            "thresholds_v": (0.5, 2.0),
            "weights_2": (0.2, 0.1),
            "weights_3": (0.0, 0.1),
            "scale_v": 10.0,
        },
    )
    hysteresis = Hysteresis(r=[0.0, 1.0, 2.0], b=[0.7, 0.2, 0.1], c=[0.0, 1.0])
    model = Model(hysteresis, Validity(0.0, 10.0), blocks=(shape,))
    assert _tracking(model, 0.0) < 0.02
    assert math.isfinite(_tracking(model, 0.1))


@pytest.mark.parametrize("samples", [1.0, 2.0, 3.0])
def test_a_lead_of_whole_samples_gives_what_the_later_samples_give(samples: float) -> None:
    """Also where the drive jumps, on which an extrapolation overshoots and turns the plays."""
    rng = np.random.default_rng(7)
    u = np.repeat(rng.uniform(0.0, 10.0, 60), 20)
    model = shipped("paper-eq12")
    ahead = Block("lead", "drive", {"tau_s": samples * DT})
    led = simulate_parts(replace(model, blocks=(ahead, *model.blocks)), DT, u).reading
    later = simulate_parts(model, DT, u[int(samples) :]).reading
    np.testing.assert_allclose(led[: later.size], later, atol=1e-9)


def test_what_remains_of_a_lead_is_that_of_a_part_of_a_sample() -> None:
    u = 5.0 + 4.0 * np.sin(2 * np.pi * 3.0 * DT * np.arange(1000))
    model = shipped("paper-eq12")
    leads = [Block("lead", "drive", {"tau_s": samples * DT}) for samples in (1.4, 0.4)]
    led, part = (replace(model, blocks=(one, *model.blocks)) for one in leads)
    np.testing.assert_allclose(
        simulate_parts(led, DT, u).reading[:-1], simulate_parts(part, DT, u[1:]).reading, atol=1e-9
    )
