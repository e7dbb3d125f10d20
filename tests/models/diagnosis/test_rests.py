"""What a drive in steps that rests after each one shows: a mode that rings, a reading a row late.
The stages are integrated here, by no equation of the library."""

from functools import cache

import numpy as np
import pytest
from scipy import signal
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.plants.hysteresis import maxwell_slip

from dehyst.models import modelfile
from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.diagnosis.data.drive_path import (
    count_distinct_moments,
    count_distinct_places,
    has_rests,
)
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.recording import Floats, Recording

RATE_HZ, N, REST = 2000.0, 8000, 250  # samples
T = np.arange(N) / RATE_HZ
NOISE_UM = 0.01
SINE = 5.0 - 4.0 * np.cos(2 * np.pi * 2.0 * T)


def steps(seed: int) -> Floats:
    """Return random levels of 0 to 10 V, each held for REST samples."""
    levels = np.r_[0.0, np.random.default_rng(seed).uniform(0.5, 9.5, N // REST)]
    return levels[(np.arange(N) + REST // 2) // REST]


def two_levels() -> Floats:
    """Return a square wave."""
    return np.where((np.arange(N) // REST) % 2 > 0, 8.0, 2.0) * (np.arange(N) >= REST)


def staircase() -> Floats:
    """Return one way up and one way down, in equal steps."""
    up = np.arange(N) // REST
    return np.minimum(up, N // REST - 1 - up) * 0.5


DRIVES = {"random levels": steps(1), "two levels": two_levels(), "staircase": staircase()}


def reading(
    u: Floats, frequency_hz: float | None, damping: float = 0.01, late: int = 0, seed: int = 0
) -> Recording:
    """Return a recording in which each command is held, and read before the next one (late: a
    row later)."""
    y = maxwell_slip(np.random.default_rng(8))(u)
    if frequency_hz is not None:
        w = 2 * np.pi * frequency_hz
        system = ([w * w], [1.0, 2 * damping * w, w * w])
        held = np.append(y[1:], y[-1]) - y[0]
        y = signal.lsim(system, held, T, interp=False)[1] + y[0]
    y = np.concatenate([np.repeat(y[:1], late), y[: y.size - late]])
    noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(T, u, y + noise, name=f"{seed}.csv")


@cache
def found(drive: str, frequency_hz: float | None, late: int = 0) -> Diagnosis:
    return diagnose_without_limits([reading(DRIVES[drive], frequency_hz, late=late)])


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("frequency_hz", [110.0, 350.0])
def test_a_mode_that_rings_after_steps_alone_is_named(drive: str, frequency_hz: float) -> None:
    """The drive comes to no more places than a base has columns, and in a rest it stays at one: no
    memory of the path rings there."""
    d = found(drive, frequency_hz)
    mode = d.findings[0]
    assert mode.name == "resonance"
    assert mode.parameters["frequency_hz"].value == pytest.approx(frequency_hz, rel=3e-3)
    assert mode.parameters["damping"].low < 0.01 < mode.parameters["damping"].high
    assert not {f.name for f in d.findings} - {"resonance", "shape"}


@pytest.mark.parametrize("drive", DRIVES)
def test_a_stage_without_a_mode_rings_in_no_rest(drive: str) -> None:
    assert not {f.name for f in found(drive, None).findings} - {"shape", "unknown"}


@pytest.mark.parametrize("late", [0, 1])
def test_the_written_model_predicts_other_steps_and_a_sine(late: int) -> None:
    """It states that its mode is fed by steps; a reading that is a row late is a delay of a row."""
    d = found("random levels", 110.0, late)
    written = modelfile.loads(modelfile.dumps(d.model))
    assert [b.params["held"] for b in written.blocks if b.kind == "resonance"] == [1.0]
    delays = [b.params["delay_s"] for b in written.blocks if b.kind == "delay"]
    assert delays == pytest.approx([1.0 / RATE_HZ] * late, rel=0.02)
    for u, most in ((steps(5), 0.1), (SINE, 0.7)):  # steps show little of a sine's loop
        other = reading(u, 110.0, late=late, seed=3)
        left = [
            np.std((other.displacement - simulate(m, T, u))[REST:]) for m in (written, d.base_model)
        ]
        assert left[0] < most * left[1]


def test_a_mode_beside_a_quiet_recording_is_named() -> None:
    """The quiet one has peaks of its own, high above next to nothing."""
    given = [reading(SINE, 350.0, seed=1), reading(steps(2), 350.0, seed=2)]
    d = diagnose_without_limits(given)
    assert d.findings[0].name == "resonance"
    assert d.findings[0].parameters["frequency_hz"].value == pytest.approx(350.0, rel=3e-3)


def test_the_moments_of_a_rest_are_counted_and_its_place_once() -> None:
    data = prepare([reading(two_levels(), None)])
    assert count_distinct_places(data) < 12
    assert 2 * REST < count_distinct_moments(data) < 4 * REST
    assert has_rests(data)
    moving = prepare([reading(SINE, None)])
    assert count_distinct_moments(moving) < 1.1 * count_distinct_places(moving)
    slowly = prepare([reading(10.0 * T / T[-1], None)])  # however little it moves in a sample
    assert not has_rests(moving)
    assert not has_rests(slowly)
