"""What every model of the benchmark is: fitted to one recording, it predicts from drives alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize

from dehyst.models.recording import Floats, Recording

Predict = Callable[[Floats, Floats], Floats]
"""(times (N,) [s], drive (N,)) -> displacement (N,), from the state before the first sample on: no
measured displacement is fed back. Raises nothing; rows may be infinite where a model diverges."""

RIDGE = 1e-8  # of the largest diagonal element: keeps columns apart that the drive does not


@dataclass(frozen=True)
class Rival:
    """A model to be compared. fit: from a recording with drive and displacement, all rows finite,
    to what predicts; it may raise BadRecording. invertible: in words; source: where it is from."""

    name: str
    fit: Callable[[Recording], Predict]
    invertible: str
    source: str


@dataclass(frozen=True)
class Scale:
    """Drive as a share of the range that was fitted, 0 to 1; displacement in standard deviations
    about its mean."""

    u_low: float
    u_span: float
    y_mean: float
    y_std: float

    @classmethod
    def of(cls, recording: Recording) -> "Scale":
        """Of the recording that is fitted."""
        u, y = recording.drive, measured(recording)
        return cls(float(u.min()), float(np.ptp(u)) or 1.0, float(y.mean()), float(y.std()) or 1.0)

    def drive(self, u: Floats) -> Floats:
        """(N,) scaled."""
        return np.ascontiguousarray((u - self.u_low) / self.u_span)

    def displacement(self, y: Floats) -> Floats:
        """(N,) scaled."""
        return np.asarray((y - self.y_mean) / self.y_std)

    def back(self, y: Floats) -> Floats:
        """(N,) in the recording's unit."""
        return np.asarray(self.y_mean + self.y_std * y)


def measured(recording: Recording) -> Floats:
    """The displacement (N,) of a recording that has one."""
    assert recording.displacement is not None
    return recording.displacement


def solve_ridge(columns: Floats, y: Floats) -> Floats:
    """(m,) weights of columns (N, m), least squares with a little ridge."""
    gram = columns.T @ columns
    gram[np.diag_indices_from(gram)] += RIDGE * float(gram.diagonal().max())
    out: Floats = scipy.linalg.solve(gram, columns.T @ y, assume_a="pos")
    return out


def solve_not_negative(columns: Floats, y: Floats) -> tuple[Floats, float]:
    """(m,) weights >= 0 of columns (N, m), and a free offset: least squares."""
    centre, mean = columns.mean(axis=0), float(y.mean())
    m = centre.size
    ridge = np.sqrt(RIDGE * float(np.var(columns, axis=0).max()) * y.size) * np.eye(m)
    q, r = np.linalg.qr(np.vstack([columns - centre, ridge]))
    weights, _ = scipy.optimize.nnls(
        r, q.T @ np.concatenate([y - mean, np.zeros(m)]), maxiter=30 * m
    )
    return weights, mean - float(centre @ weights)
