"""Virtual microscope: a calibration grid, a raster scan over it, and the distortion of the image.

The stage carries the tip. A pixel is shown at the target position, and holds the height of the grid
at the true position. The scan alternates: even rows are the trace, odd rows the retrace.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dehyst.models.drive_design.scans import Scan
from dehyst.models.recording import Floats

PITCH_UM, PIT_SHARE, HEIGHT_NM = 1.0, 0.5, 20.0  # a common calibration grid: square pits
TIP_UM = 0.03  # distance over which an edge is rounded
SEAM_BINS = 64  # along a line, in which trace and retrace are compared


def grid_height(x_um: Floats, y_um: Floats) -> Floats:
    """Return the height [nm] (N,) of the grid at (N,) positions: pits of PIT_SHARE of the pitch
    each way."""
    return -HEIGHT_NM * _inside(x_um) * _inside(y_um)


def _inside(at_um: Floats) -> Floats:
    """Return 0 outside to 1 inside a pit, along one axis, with edges rounded by the tip."""
    off = np.abs(np.mod(at_um / PITCH_UM, 1.0) - 0.5) - 0.5 * PIT_SHARE
    return np.asarray(0.5 * (1.0 - np.tanh(off * PITCH_UM / TIP_UM)))


@dataclass(frozen=True)
class Frame:
    """One frame. scan: its path about the centre; true_x, true_y: (N,) true positions of the stage
    [um]; centre: of the scan [um]; lines: number of rows; size_um: width and height of the
    image."""

    scan: Scan
    true_x: Floats
    true_y: Floats
    centre: tuple[float, float]
    lines: int
    size_um: float

    @cached_property
    def rows(self) -> list[slice]:
        """Samples of each line."""
        inside = np.concatenate([[False], self.scan.image, [False]])
        edges = np.flatnonzero(np.diff(inside.astype(np.int8)))
        return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist()]

    def picture(self, pixels: int) -> Floats:
        """Return (lines, pixels) heights [nm], the first row at the least y. Each pixel is
        interpolated linearly between the samples whose target x are nearest to its centre."""
        out = np.empty((self.lines, pixels))
        centres = ((np.arange(pixels) + 0.5) / pixels - 0.5) * self.size_um
        heights = grid_height(self.true_x, self.true_y)
        for k, row in enumerate(self.rows):
            x, z = self.scan.x[row], heights[row]
            order = np.argsort(x, kind="stable")
            out[k] = np.interp(centres, x[order], z[order])
        return out

    @cached_property
    def errors_um(self) -> tuple[Floats, Floats]:
        """(M,) errors of x and of y over the samples of the image [um]: true minus target position,
        after removing the shift and the scale of each axis, as a calibration with the grid
        would."""
        return (
            _calibrated(self.scan.x[self.scan.image], self.true_x[self.scan.image]),
            _calibrated(self.scan.y[self.scan.image], self.true_y[self.scan.image]),
        )

    @property
    def distortion_nm(self) -> float:
        """Rms distance between true and target position over the image [nm]."""
        x, y = self.errors_um
        return float(1e3 * np.sqrt(np.mean(x**2 + y**2)))

    @property
    def worst_nm(self) -> float:
        """Largest distance between true and target position [nm]."""
        x, y = self.errors_um
        return float(1e3 * np.sqrt(np.max(x**2 + y**2)))

    @property
    def uncalibrated_nm(self) -> float:
        """Like distortion_nm, but with only the shift removed [nm]."""
        off = [
            (true - wanted)[self.scan.image]
            for true, wanted in ((self.true_x, self.scan.x), (self.true_y, self.scan.y))
        ]
        return float(1e3 * np.sqrt(sum(np.var(one) for one in off)))

    @cached_property
    def along_lines(self) -> tuple[Floats, Floats]:
        """(SEAM_BINS,) true x at evenly spaced target x [um], averaged over the traces and over the
        retraces."""
        lines = [self._along(row) for row in self.rows]
        return np.mean(lines[0::2], axis=0), np.mean(lines[1::2], axis=0)

    @property
    def seam_nm(self) -> float:
        """Rms distance in x between trace and retrace at the same target x, along a line [nm]."""
        trace, retrace = self.along_lines
        return float(1e3 * np.sqrt(np.mean((trace - retrace) ** 2)))

    def _along(self, row: slice) -> Floats:
        """Return (SEAM_BINS,) true x at evenly spaced target x [um]."""
        x = self.scan.x[row]
        order = np.argsort(x, kind="stable")
        at = ((np.arange(SEAM_BINS) + 0.5) / SEAM_BINS - 0.5) * self.size_um
        return np.interp(at, x[order], self.true_x[row][order])


def _calibrated(wanted: Floats, true: Floats) -> Floats:
    """Return the residual (M,) of a straight-line fit of true over target."""
    off = wanted - wanted.mean()
    moved = true - true.mean()
    return np.asarray(moved - off * (off @ moved) / (off @ off))
