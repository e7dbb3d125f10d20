"""Effects: candidates with values of their nonlinear parameters, as the fits vary them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Candidate, Parameter
from dehyst.models.signals.joined import Data, Floats

Theta = tuple[float, ...]  # values of a candidate's nonlinear parameters


@dataclass(frozen=True)
class Effect:
    """A candidate with the values of its nonlinear parameters."""

    candidate: Candidate
    theta: tuple[float, ...] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of theta."""
        return self.candidate.params_at(self.theta)


def in_cascade_order(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects in the order of the cascade."""
    return tuple(sorted(effects, key=lambda e: e.candidate.order))


def apply_drive_effects(data: Data, effects: Sequence[Effect]) -> Floats:
    """Return the drive (N,) that reaches the hysteresis."""
    v = data.u
    for e in effects:
        if e.candidate.mode == "drive":
            v = e.candidate.drive(data, v, e.theta)
    return v


def apply_output_effects(data: Data, effects: Sequence[Effect], x: Floats) -> Floats:
    """Return columns (N, k) filtered by the effects that act on the hysteresis' output."""
    for e in effects:
        if e.candidate.mode == "output":
            x = e.candidate.output(data, x, e.theta)
    return x


def internal_parameters(effects: Sequence[Effect]) -> Floats:
    """Return the nonlinear parameters of all effects: logarithms for those searched on a
    logarithmic scale, the others scaled by their range, so that a step of one is large."""
    out = []
    for e in effects:
        for p, v in zip(e.parameters, e.theta, strict=True):
            out.append(np.log(v) if p.log else (v - p.low) / (p.high - p.low))
    return np.array(out, dtype=float)


def move_parameters(effects: Sequence[Effect], p: Floats, step: Floats) -> tuple[Effect, ...]:
    """Return the effects with their internal parameters p moved by step, clipped to their
    bounds."""
    out, i = [], 0
    for e in effects:
        theta = []
        for par in e.parameters:
            value = p[i] + step[i]
            value = float(np.exp(value)) if par.log else par.low + value * (par.high - par.low)
            theta.append(min(max(value, par.low), par.high))
            i += 1
        out.append(replace(e, theta=tuple(theta)))
    return tuple(out)


def parameters_at_bound(effect: Effect) -> list[str]:
    """Return the keys of parameters at a bound, which are not identified."""
    out = []
    for p, v in zip(effect.parameters, effect.theta, strict=True):
        if p.log:
            at = np.log(v / p.low) / np.log(p.high / p.low)
        else:
            at = (v - p.low) / (p.high - p.low)
        if not TUNING.crumb < at < 1 - TUNING.crumb:
            out.append(p.key)
    return out
