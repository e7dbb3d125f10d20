"""Estimate cheaply what each start of a candidate would gain: its first-order effect with the whole
base refitted (projection off every fitted column), without nonlinear refits."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dehyst.models.arrays import Bools, Floats, Ints
from dehyst.models.diagnosis.effects import Effect, Theta, in_cascade_order
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.physics.candidate import Candidate, Context, Probe


class SamplePieces(NamedTuple):
    """n parts of the counted samples. pattern: (pieces, n), 1 where a piece belongs to a part;
    pieces: rows of each, which no two share."""

    pattern: Floats
    pieces: tuple[slice | Ints, ...]


class Screen:
    """What all candidates of one round share: the fit's columns on the counted rows, and the
    derivatives of the prediction with respect to the accepted effects' own parameters."""

    def __init__(self, problem: Problem, current: JointFit) -> None:
        self.problem, self.current = problem, current
        self.rows = problem.row_index
        self.output = problem.output_of(current)
        self.known: dict[Any, Floats] = {}
        self._unmoved = problem.simulate(current, current.effects, self.output, self.known)
        self._as_fitted = self.known, self._unmoved
        if (heads := problem.data.path.uncounted_heads()).size:
            self.known = self._with_heads_as_read(heads)
            self._unmoved = problem.simulate(current, current.effects, self.output, self.known)
        self.drive = problem.data.sampled(problem.drive_at_hysteresis(current.effects))
        self._design = current.design
        gram = self._design.T @ self._design
        self._scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
        normed = gram / np.outer(self._scale, self._scale)
        ridge = np.diag(problem.penalty(normed.shape[0]))
        self._factor = cho_factor(normed + ridge, lower=True)
        self._tangent = np.zeros((self.rows.size, 0))
        if any(e.theta for e in current.effects):
            _, jac = problem.jacobian(current, self.output)
            projected = self.projected(jac)
            norms = np.sqrt(np.sum(projected**2, axis=0))
            good = norms > 1e-9 * max(float(norms.max()), 1e-30)
            self._tangent, _ = np.linalg.qr(projected[:, good])
        self._kept: dict[tuple[str, Theta], Floats] | None = None
        self._set_residual(problem.data.y - current.prediction)

    def _with_heads_as_read(self, heads: Ints) -> dict[Any, Floats]:
        """Return `known` with the reading in place of the fitted displacement in the heads, where
        the drive's past is unknown. What was fitted to other rows may be anything there, and lags
        and modes would carry it on. Lasting effects are screened without this: the readings contain
        them already, and they would be counted twice."""
        data, current = self.problem.data, self.current
        heads = heads[np.isfinite(data.y[heads])]
        way = tuple(e for e in current.effects if e.candidate.mode == "drive")
        base = self.known[way, "base"].copy()
        base[heads] = (data.y - current.offsets[data.rec])[heads]
        return self.known | {(way, "base"): base}

    def _set_residual(self, residual: Floats) -> None:
        self.residual = residual
        self.r = self.projected(residual[:, None])[:, 0]
        self._r_twice = self.projected_rows(self.r[:, None])  # what is ridged is not all gone

    def with_residual(self, residual: Floats) -> "Screen":
        """Return the same screen for a slightly different residual (N,), from another reading of
        the same drive; the contributions of the starts are computed once for both."""
        self._kept = {} if self._kept is None else self._kept
        out = copy.copy(self)
        out._set_residual(residual)
        return out

    def projected(self, x: Floats) -> Floats:
        """Return x (N, k) on the counted rows, projected off the fit's columns and parameter
        derivatives."""
        return self.projected_rows(x[self.rows])

    def projected_rows(self, x: Floats) -> Floats:
        """Return the same for an x that is given on the counted rows."""
        moment = (self._design.T @ x) / self._scale[:, None]
        x = x - self._design @ (cho_solve(self._factor, moment) / self._scale[:, None])
        return x - self._tangent @ (self._tangent.T @ x)

    def split_samples(self, inside: Bools) -> SamplePieces:
        """Return n parts of the samples, inside (N, n), as the pieces that they have in common."""
        packed = np.packbits(inside[self.rows], axis=1)
        _, first, label = np.unique(packed, axis=0, return_index=True, return_inverse=True)
        pieces: list[slice | Ints] = []
        for k in range(first.size):
            at = np.flatnonzero(label.ravel() == k)
            one_run = at[-1] - at[0] + 1 == at.size  # needs no copy
            pieces.append(slice(int(at[0]), int(at[-1]) + 1) if one_run else at)
        return SamplePieces(inside[self.rows[first]].astype(float), tuple(pieces))

    def gains_in(self, x: Floats, parts: SamplePieces) -> tuple[Floats, Floats]:
        """Return the estimated falls (n,) of the sum of squares by columns x (N, k) in each of n
        parts of the samples, and the factor (n,) of the first column."""
        x = x[self.rows]

        def sums(left: Floats) -> Floats:
            """Return left.T @ x (n, m, k), summed over the rows of each part."""
            each = np.stack([left[at].T @ x[at] for at in parts.pieces])
            return np.einsum("pn,pmk->nmk", parts.pattern, each)

        moments = sums(self._design) / self._scale[:, None]
        n, m, k = moments.shape
        solved = cho_solve(self._factor, moments.transpose(1, 0, 2).reshape(m, n * k))
        tangent, whole = sums(self._tangent), sums(x)
        left = whole - moments.transpose(0, 2, 1) @ solved.reshape(m, n, k).transpose(1, 0, 2)
        left -= tangent.transpose(0, 2, 1) @ tangent
        along = sums(self._r_twice)[:, 0]
        values, vectors = np.linalg.eigh(left)
        least = 1e-9 * np.trace(whole, axis1=1, axis2=2)  # below, only rounding is left
        along = np.einsum("nik,ni->nk", vectors, along)
        factors = np.where(values > least[:, None], along / np.maximum(values, 1e-300), 0.0)
        return np.sum(factors * along, axis=1), np.einsum("nk,nk->n", vectors[:, 0], factors)

    def contribution(self, effect: Effect) -> Floats:
        """Return (N, k) columns of an additive effect, or the (N, 1) first-order change by another
        kind."""
        c, data = effect.candidate, self.problem.data
        if c.mode == "columns":
            return effect.columns(data, Context(self.drive, self.output))
        effects = in_cascade_order([*self.current.effects, effect])
        parts = {
            e.candidate.key: a
            for e, a in zip(self.current.effects, self.current.amplitudes, strict=True)
        }
        amplitudes = tuple(parts.get(e.candidate.key, np.zeros(0)) for e in effects)
        with_it = replace(self.current, amplitudes=amplitudes)
        known, unmoved = self._as_fitted if c.lasting else (self.known, self._unmoved)
        there = self.problem.simulate(with_it, effects, self.output, dict(known))
        return (there - unmoved)[:, None]

    def starts(self, candidate: Candidate) -> list[tuple[float, Theta]]:
        """Return (estimated fall of the sum of squares, start) for every start, best first.

        Only the right sign counts: a delay that would have to be negative gains nothing.
        """
        starts = [tuple(s) for s in candidate.starts(self.problem.data, self.residual)]
        return self.rank(candidate, starts)

    def rank(self, candidate: Candidate, starts: Sequence[Theta]) -> list[tuple[float, Theta]]:
        """Return the same for given starts."""
        if not starts:
            return []
        scores = []
        for theta, x in zip(starts, self._projected_of(candidate, starts), strict=True):
            a, g = x.T @ x, x.T @ self.r
            amplitudes = np.zeros(0)
            if candidate.mode == "columns":
                amplitudes = np.linalg.pinv(a, rcond=1e-10, hermitian=True) @ g
                gain = float(g @ amplitudes)
            else:
                gain = float(g[0] ** 2 / a[0, 0]) if a[0, 0] > 0 and g[0] > 0 else 0.0
                if gain > 0:
                    theta = candidate.scaled(theta, float(g[0] / a[0, 0]))
            likely = candidate.plausibility_weight(theta, amplitudes)
            scores.append((likely * gain, gain if likely else 0.0, theta))
        return [score[1:] for score in sorted(scores, key=lambda s: -s[0])]

    def _projected_of(self, candidate: Candidate, starts: Sequence[Theta]) -> list[Floats]:
        """Return the projected contribution (counted rows, k) of each start."""
        kept = {} if self._kept is None else self._kept
        new = [theta for theta in starts if (candidate.key, theta) not in kept]
        if new:
            parts = [self.contribution(Effect(candidate, theta)) for theta in new]
            ends = np.cumsum([part.shape[1] for part in parts])[:-1]
            projected = np.split(self.projected(np.concatenate(parts, axis=1)), ends, axis=1)
            for theta, x in zip(new, projected, strict=True):
                kept[candidate.key, theta] = x
        return [kept[candidate.key, theta] for theta in starts]


def contribution_of(screen: Screen, c: Candidate, probe: Probe) -> Floats:
    """Return (N,) what the candidate adds to the reading at a given strength."""
    x = screen.contribution(Effect(c, probe.theta))
    return x @ np.array(probe.amplitudes) if c.mode == "columns" else x[:, 0]
