"""A recording whose numbers are in a wrong unit by many powers of ten is refused in one sentence
that says so, with no warning; within the range of stages the fit does not depend on the unit."""

import warnings

import numpy as np
import pytest

from dehyst.models.diagnosis import diagnose
from dehyst.models.errors import BadRecording
from dehyst.models.identify.data.rows import LARGEST, SMALLEST, check_scale
from dehyst.models.identify.identification import identify_alone
from dehyst.models.identify.identified import Identification, Options
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Recording

N = 3000
T = 0.005 * np.arange(N)
U = 50 * (1 - np.cos(2 * np.pi * 0.5 * T)) * np.linspace(0.5, 1.0, N)
R = np.linspace(0.0, 40.0, 12)


def displacement() -> np.ndarray:
    z, out = np.zeros(R.size), np.empty(N)
    for i, u in enumerate(U):
        z = np.maximum(u - R, np.minimum(u + R, z))
        out[i] = 0.05 * u + 0.002 * z.sum()
    return out + 0.004 * np.random.default_rng(3).standard_normal(N)


Y = displacement()
"""(N,) displacement [um]."""


def identified(of_drive: float, of_displacement: float) -> Identification:
    recording = Recording(
        T, of_drive * U, of_displacement * Y, drive_unit="v", displacement_unit="um", name="a.csv"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return identify_alone([recording], Options(rate=False, order=12, saturation=1))


@pytest.mark.parametrize("factor", [1e-160, 1e-30, 1e-12, 1e12, 1e30])
@pytest.mark.parametrize("what", ["drive", "displacement", "both"])
def test_a_wrong_unit_is_named(factor: float, what: str) -> None:
    factors = (1.0 if what == "displacement" else factor, 1.0 if what == "drive" else factor)
    with pytest.raises(BadRecording) as error:
        identified(*factors)
    said = str(error.value)
    size = "small" if factor < 1.0 else "large"
    column = "displacement" if what == "displacement" else "drive"
    assert f"a.csv: the {column} moves over" in said
    assert f"which is too {size} for a stage: check the unit" in said


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_it_is_named_by_whatever_compares_with_a_recording(factor: float) -> None:
    model = identified(1.0, 1.0).model
    wrong = Recording(
        T, U, factor * Y, drive_unit=model.drive_unit, displacement_unit="um", name="b.csv"
    )
    for compare in (lambda: validate(model, wrong), lambda: diagnose([wrong], model)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(BadRecording, match=r"check the unit"):
                compare()


def test_a_few_wild_readings_are_no_wrong_unit() -> None:
    y = Y.copy()
    y[[700, 1500]] = 9.9e37
    wild = Recording(T, U, y, drive_unit="v", displacement_unit="um", name="c.csv")
    check_scale(wild)


def test_units_within_the_range_of_stages_change_nothing() -> None:
    left = identified(1.0, 1.0).model.fit.rms
    spans = np.ptp(U), np.ptp(Y)
    for factors in (
        (1.0, 2 * SMALLEST / spans[1]),
        (1.0, 0.5 * LARGEST / spans[1]),
        (2 * SMALLEST / spans[0], 0.5 * LARGEST / spans[1]),
        (0.5 * LARGEST / spans[0], 2 * SMALLEST / spans[1]),
    ):
        assert identified(*factors).model.fit.rms == pytest.approx(factors[1] * left, rel=1e-3)
