"""The virtual microscope against known positions: what counts as distortion and as seam."""

import numpy as np
import pytest

from dehyst.daemon.imaging.microscope import PITCH_UM, Frame, grid_height
from dehyst.models.drive_design.scans import Scan, scan_raster
from dehyst.models.recording import Floats

LINES, SIZE = 24, 8.0


@pytest.fixture(scope="module")
def scan() -> Scan:
    return scan_raster(SIZE, SIZE, LINES, 0.2, 1e-3)


def frame(scan: Scan, x: Floats, y: Floats) -> Frame:
    return Frame(scan, x, y, (0.0, 0.0), LINES, SIZE)


def test_every_line_is_a_row(scan: Scan) -> None:
    rows = frame(scan, scan.x, scan.y).rows
    assert len(rows) == LINES
    for k, row in enumerate(rows):
        assert np.ptp(scan.y[row]) == 0.0
        assert np.all(np.diff(scan.x[row]) * (1 - 2 * (k % 2)) > 0)


def test_shift_and_scale_are_no_distortion(scan: Scan) -> None:
    one = frame(scan, 1.1 * scan.x + 7.0, 0.9 * scan.y - 3.0)
    assert one.distortion_nm == pytest.approx(0.0, abs=1e-6)
    x, y = scan.x[scan.image].std(), scan.y[scan.image].std()
    assert one.uncalibrated_nm == pytest.approx(1e3 * np.hypot(0.1 * x, 0.1 * y))


def test_a_known_bend_is_the_distortion(scan: Scan) -> None:
    bend = 0.2 * np.sin(4 * np.pi * scan.y / SIZE)  # x is off by another amount in each row
    assert frame(scan, scan.x + bend, scan.y).distortion_nm == pytest.approx(
        1e3 * bend[scan.image].std(), rel=1e-4
    )


def test_what_happens_in_the_turns_does_not_count(scan: Scan) -> None:
    x = np.where(scan.image, scan.x, scan.x + 1.0)
    assert frame(scan, x, scan.y).distortion_nm == pytest.approx(0.0, abs=1e-6)


def test_the_seam_is_the_distance_of_trace_and_retrace(scan: Scan) -> None:
    x = scan.x.copy()
    for k, row in enumerate(frame(scan, x, scan.y).rows):
        x[row] += 0.04 if k % 2 == 0 else -0.06
    one = frame(scan, x, scan.y)
    assert one.seam_nm == pytest.approx(100.0, rel=1e-3)
    assert frame(scan, scan.x, scan.y).seam_nm == pytest.approx(0.0, abs=1e-6)


def test_the_picture_shows_the_grid_where_it_was_wanted(scan: Scan) -> None:
    pixels = 400
    shown = frame(scan, scan.x, scan.y).picture(pixels)
    assert shown.shape == (LINES, pixels)
    at = ((np.arange(pixels) + 0.5) / pixels - 0.5) * SIZE
    rows = np.linspace(-0.5, 0.5, LINES) * SIZE
    want = grid_height(np.tile(at, (LINES, 1)), np.tile(rows[:, None], (1, pixels)))
    assert np.sqrt(np.mean((shown - want) ** 2)) < 0.5  # of 20 nm: pixels between samples


def test_the_grid_repeats_with_its_pitch() -> None:
    x = np.linspace(-3.0, 3.0, 601)
    z = grid_height(x, np.full(x.size, 0.5 * PITCH_UM))
    assert np.allclose(z[100:], z[:-100], atol=1e-9)
    assert z.min() == pytest.approx(-20.0, abs=0.1)
    assert np.mean(z < -10.0) == pytest.approx(0.5, abs=0.02)
