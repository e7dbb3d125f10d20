"""Paths in the plane: their shape and speed; they have no corner and return to where they began."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.drive_design.scans import Scan, scan_lissajous, scan_raster, scan_spiral
from dehyst.models.errors import BadInput

T = 1e-3
SCANS = {
    "raster": scan_raster(5.0, 4.0, 8, 0.5, T),
    "raster of odd lines": scan_raster(5.0, 4.0, 7, 0.5, T, 0.4),
    "spiral": scan_spiral(2.5, 0.5, 8.0, 3.0, T),
    "lissajous": scan_lissajous(5.0, 3.0, (2, 3), 2.0, T),
}


@pytest.mark.parametrize("name", SCANS)
def test_it_begins_and_ends_at_rest_at_one_place(name: str) -> None:
    scan = SCANS[name]
    for axis in (scan.x, scan.y):
        assert axis[0] == pytest.approx(axis[-1], abs=2e-3)
        speed = np.abs(np.diff(axis)) / T
        assert max(speed[0], speed[-1]) < 0.02 * speed.max()


@pytest.mark.parametrize("name", SCANS)
def test_it_has_no_corner(name: str) -> None:
    """The speed changes from sample to sample by what the shortest turn needs, and never jumps."""
    scan = SCANS[name]
    speed = np.diff(np.stack([scan.x, scan.y]), axis=1) / T
    change = np.max(np.abs(np.diff(speed, axis=1)))
    assert change < 0.05 * max(scan.speed)


def test_lines_of_a_raster_are_straight_level_and_even() -> None:
    scan = SCANS["raster"]
    lines = np.split(np.flatnonzero(scan.image), np.flatnonzero(np.diff(scan.y[scan.image])) + 1)
    assert len(lines) == 8
    np.testing.assert_allclose([scan.y[line[0]] for line in lines], np.linspace(-2.0, 2.0, 8))
    for k, line in enumerate(lines):
        speed = np.diff(scan.x[line]) / T
        np.testing.assert_allclose(speed, (1 if k % 2 == 0 else -1) * 5.0 / 0.4, rtol=1e-9)
        assert np.ptp(scan.x[line]) == pytest.approx(5.0, abs=3 * 12.5 * T)
    beyond = 12.5 * 0.1 / np.pi
    assert scan.x.max() == pytest.approx(2.5 + beyond, abs=1e-3)
    assert scan.speed[0] <= 12.5 * (1 + 1e-9)


def test_a_spiral_keeps_its_pitch_and_speed() -> None:
    scan = SCANS["spiral"]
    r, angle = np.hypot(scan.x, scan.y), np.unwrap(np.arctan2(scan.y, scan.x))
    on = scan.image & (r > 0.1)
    slope = np.polyfit(angle[on], r[on], 1)[0]
    assert 2 * np.pi * slope == pytest.approx(0.5, rel=1e-3)
    outer = np.flatnonzero(scan.image & (r > 1.0))
    speed = np.hypot(np.diff(scan.x), np.diff(scan.y))[outer[:-1]] / T
    np.testing.assert_allclose(speed, 8.0, rtol=0.01)
    assert np.max(np.diff(angle[on])) / T <= 2 * np.pi * 3.0 * 1.01
    assert r.max() == pytest.approx(2.5, abs=1e-3)


def test_a_lissajous_figure_is_its_equation() -> None:
    """The figure is a : b in its own coordinates, whatever the speed: by the Chebyshev identity
    T_3(cos) of the phases, x = cos 2p, y = sin 3p."""
    scan = SCANS["lissajous"]
    x, y = scan.x / 2.5, scan.y / 1.5
    # sin^2 3p = (1 - cos 6p) / 2, cos 6p = T_3(cos 2p) = 4 x^3 - 3 x
    np.testing.assert_allclose(y**2, 0.5 * (1.0 - (4 * x**3 - 3 * x)), atol=1e-9)
    full = scan.image
    assert np.max(np.abs(np.diff(scan.x)[full[:-1]])) / T == pytest.approx(
        2.5 * 2 * np.pi * 2 / 2.0, rel=1e-3
    )


@settings(max_examples=30, deadline=None)
@given(
    st.floats(0.1, 100.0),
    st.floats(0.1, 100.0),
    st.integers(2, 30),
    st.floats(0.05, 3.0),
    st.floats(0.05, 0.8),
)
def test_a_raster_is_nowhere_faster_than_its_lines(
    width: float, height: float, lines: int, line_s: float, turn: float
) -> None:
    scan: Scan = scan_raster(width, height, lines, line_s, 1e-3, turn)
    speed = width / (line_s * (1.0 - turn))
    to_next = 1.875 * height / (lines - 1) / (turn * line_s)
    assert scan.speed[0] <= speed * (1 + 1e-6)
    assert scan.speed[1] <= max(speed, to_next) * (1 + 1e-6)
    assert np.ptp(scan.y) == pytest.approx(height, rel=1e-6)
    assert np.ptp(scan.x) <= width + 2 * speed * turn * line_s / np.pi + 1e-9


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: scan_raster(0.0, 1.0, 4, 1.0, T), "width: must be above 0"),
        (lambda: scan_raster(1.0, 1.0, 1, 1.0, T), "at least 2 lines"),
        (lambda: scan_raster(1.0, 1.0, 4, 1.0, T, 0.95), "turn"),
        (lambda: scan_raster(1.0, 1.0, 4, 1.0, 1e-9), "samples"),
        (lambda: scan_spiral(1.0, 2.0, 1.0, 1.0, T), "pitch"),
        (lambda: scan_lissajous(1.0, 1.0, (0, 1), 1.0, T), "ratio"),
    ],
)
def test_what_cannot_be_is_refused(make: object, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        make()  # type: ignore[operator]
