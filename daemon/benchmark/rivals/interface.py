"""Interface of every model in the benchmark: fitted to one recording, it predicts from drives
alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize

from dehyst.models.recording import Floats, Recording

Predict = Callable[[Floats, Floats], Floats]
"""(times (N,) [s], drive (N,)) -> displacement (N,), starting from the state before the first
sample; no measured displacement is fed back. Raises nothing; rows may be infinite if a model
diverges."""

RIDGE = 1e-8  # of the largest diagonal element: separates columns that the drive does not


@dataclass(frozen=True)
class Rival:
    """A model to be compared. fit: takes a recording with drive and displacement, all rows finite,
    and returns the prediction function; it may raise BadRecording. invertible: in words; source:
    reference."""

    name: str
    fit: Callable[[Recording], Predict]
    invertible: str
    source: str


@dataclass(frozen=True)
class Scale:
    """Scaling: drive as a share of the fitted range, 0 to 1; displacement in standard deviations
    about its mean."""

    u_low: float
    u_span: float
    y_mean: float
    y_std: float

    @classmethod
    def of(cls, recording: Recording) -> "Scale":
        """Return the scaling of the fitted recording."""
        u, y = recording.drive, measured(recording)
        return cls(float(u.min()), float(np.ptp(u)) or 1.0, float(y.mean()), float(y.std()) or 1.0)

    def drive(self, u: Floats) -> Floats:
        """Return the drive (N,) scaled."""
        return np.ascontiguousarray((u - self.u_low) / self.u_span)

    def displacement(self, y: Floats) -> Floats:
        """Return the displacement (N,) scaled."""
        return np.asarray((y - self.y_mean) / self.y_std)

    def back(self, y: Floats) -> Floats:
        """Return the displacement (N,) in the recording's unit."""
        return np.asarray(self.y_mean + self.y_std * y)


def measured(recording: Recording) -> Floats:
    """Return the displacement (N,) of a recording that has one."""
    assert recording.displacement is not None
    return recording.displacement


def solve_ridge(columns: Floats, y: Floats) -> Floats:
    """Return (m,) weights of columns (N, m) by least squares with a small ridge."""
    gram = columns.T @ columns
    gram[np.diag_indices_from(gram)] += RIDGE * float(gram.diagonal().max())
    out: Floats = scipy.linalg.solve(gram, columns.T @ y, assume_a="pos")
    return out


def solve_not_negative(columns: Floats, y: Floats) -> tuple[Floats, float]:
    """Return (m,) weights >= 0 of columns (N, m) and a free offset, by least squares."""
    centre, mean = columns.mean(axis=0), float(y.mean())
    m = centre.size
    ridge = np.sqrt(RIDGE * float(np.var(columns, axis=0).max()) * y.size) * np.eye(m)
    q, r = np.linalg.qr(np.vstack([columns - centre, ridge]))
    weights, _ = scipy.optimize.nnls(
        r, q.T @ np.concatenate([y - mean, np.zeros(m)]), maxiter=30 * m
    )
    return weights, mean - float(centre @ weights)
