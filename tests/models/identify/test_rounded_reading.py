"""The noise of a coarsely quantised reading, against the error that its rounding makes."""

import numpy as np
import pytest
from tests.rigs.outside import plays

from dehyst.models.identify import identify
from dehyst.models.identify.uncertainty import estimate_noise
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Floats, Recording
from dehyst.models.signals.rounding import quantum

N, NOISE_UM = 4000, 0.005
T = np.arange(N) * 2e-3


def drive() -> Floats:
    """Triangles of three sizes."""
    size = np.where(T < 4, 1.0, np.where(T < 6, 0.6, 0.3))
    return 50 - 50 * (2 * np.abs(2 * (T % 1) - 1) - 1) * size


def recorded(step_um: float) -> Recording:
    y = plays(drive(), np.array([0.0, 5.0, 10.0, 20.0, 30.0]), np.array([6, 2, 1.5, 1, 1]) * 0.01)
    y = y + np.random.default_rng(3).normal(0.0, NOISE_UM, N)
    return Recording(T, drive(), np.round(y / step_um) * step_um, name="rounded.csv")


@pytest.mark.parametrize("step_um", [0.02, 0.1, 0.5])
def test_the_noise_of_a_rounded_reading_is_that_of_its_rounding(step_um: float) -> None:
    one = recorded(step_um)
    found = identify([one])
    expected = np.hypot(step_um / np.sqrt(12.0), NOISE_UM)
    assert found.noise_rms == pytest.approx(expected, rel=0.1)
    judged = validate(found.model, one)
    assert judged.noise == pytest.approx(expected, rel=0.1)
    assert judged.interval_is == ""


@pytest.mark.parametrize("noise_steps", [0.0, 0.1, 0.3, 1.0, 2.0])
@pytest.mark.parametrize("rows", [300, 2000])
def test_any_noise_on_any_ramp_is_found(rows: int, noise_steps: float) -> None:
    rng = np.random.default_rng(rows)
    true = 25.0 + 25.0 * np.cos(2 * np.pi * np.arange(8000) / (1.0137 * rows))
    error = np.round(true + noise_steps * rng.standard_normal(8000)) - true
    assert estimate_noise(error, quantum(np.round(true))) == pytest.approx(
        float(np.std(error)), rel=0.2
    )


@pytest.mark.parametrize("seed", range(20))
def test_a_reading_without_steps_is_judged_as_ever(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = int(rng.choice([200, 1000, 8000]))
    kinds = (
        rng.standard_normal(size), rng.standard_t(2, size), rng.laplace(0.0, 1.0, size),
        np.cumsum(rng.standard_normal(size)),
    )  # fmt: skip
    residual = kinds[seed % len(kinds)]
    median = 1.4826 * float(np.median(np.abs(np.diff(residual, 2)))) / np.sqrt(6.0)
    assert estimate_noise(residual, quantum(residual)) == median


@pytest.mark.parametrize("periods_a_row", [1 / 16, 0.12, 0.2, 0.25, 0.313, 0.37, 0.48])
def test_a_line_of_hum_is_no_noise(periods_a_row: float) -> None:
    """50 Hz read 200 times a second changes from row to row as much as white noise does."""
    rows = np.arange(2000)
    white = 0.02 * np.random.default_rng(1).standard_normal(rows.size)
    line = 0.5 * np.sin(2 * np.pi * periods_a_row * rows)
    assert estimate_noise(white + line) < 0.11
    assert estimate_noise(white) == pytest.approx(0.02, rel=0.05)
