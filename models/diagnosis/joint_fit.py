"""The result of a joint fit of the base and the effects."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from dehyst.models.diagnosis.effects import Effect
from dehyst.models.signals.joined import Data, Floats


@dataclass(frozen=True)
class JointFit:
    """A joint fit. Arrays over all samples (N,); sums over the counted rows."""

    effects: tuple[Effect, ...]
    weights: Floats  # (width,) of the base's columns
    offsets: Floats  # (recordings,)
    amplitudes: tuple[Floats, ...]  # per effect, of its additive columns
    prediction: Floats
    sse: float
    cov: Floats  # inverse of the normal matrix, times noise variance: covariance of all weights
    design: Floats = field(repr=False)  # (counted rows, columns): offsets, base, additive
    fixed: Floats = field(repr=False)  # (N,): the model in use, filtered by the effects
    added: Floats = field(repr=False)  # (N,): what the base adds to it, filtered by the effects

    def residual(self, data: Data) -> Floats:
        """Return measured minus predicted (N,)."""
        return data.y - self.prediction

    def without_rows(self) -> "JointFit":
        """Return the fit without its arrays over the samples, for reporting only: its effects, its
        weights and the number of its columns are kept."""
        none = np.zeros(0)
        design = np.zeros((0, self.design.shape[1]))
        return replace(self, prediction=none, design=design, fixed=none, added=none)

    def amplitudes_of(self, effect: Effect) -> Floats:
        """Return the amplitudes of one effect's additive columns."""
        return self.amplitudes[self.effects.index(effect)]

    @property
    def effect_keys(self) -> tuple[str, ...]:
        """Keys of the effects."""
        return tuple(e.candidate.key for e in self.effects)


def solve_ridged(gram: Floats, moment: Floats, penalty: Floats) -> tuple[Floats, Floats]:
    """Return the weights (k,) of normal equations, and the inverse of their matrix. penalty: ridge
    of each column, relative to its mean square."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    normed = gram / np.outer(scale, scale) + np.diag(penalty)
    try:
        factor = cho_factor(normed, lower=True)
        w = cho_solve(factor, moment / scale) / scale
        cov = cho_solve(factor, np.eye(scale.size))
    except LinAlgError:
        cov = np.linalg.pinv(normed, rcond=1e-12, hermitian=True)
        w = cov @ (moment / scale) / scale
    return w, cov / np.outer(scale, scale)
