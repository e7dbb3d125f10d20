"""Effects: candidates with the values of their nonlinear parameters, as the fits move them."""

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


def in_order(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Effects in their place of the cascade."""
    return tuple(sorted(effects, key=lambda e: e.candidate.order))


def drive_behind(data: Data, effects: Sequence[Effect]) -> Floats:
    """Drive (N,) that reaches the hysteresis."""
    v = data.u
    for e in effects:
        if e.candidate.mode == "drive":
            v = e.candidate.drive(data, v, e.theta)
    return v


def behind_output(data: Data, effects: Sequence[Effect], x: Floats) -> Floats:
    """Columns (N, k) behind the effects that act on the hysteresis' output."""
    for e in effects:
        if e.candidate.mode == "output":
            x = e.candidate.output(data, x, e.theta)
    return x


def internal(effects: Sequence[Effect]) -> Floats:
    """Nonlinear parameters of all effects, logarithms where they are searched so, else scaled
    by their range so that a step of one is large."""
    out = []
    for e in effects:
        for p, v in zip(e.parameters, e.theta, strict=True):
            out.append(np.log(v) if p.log else (v - p.low) / (p.high - p.low))
    return np.array(out, dtype=float)


def moved(effects: Sequence[Effect], p: Floats, step: Floats) -> tuple[Effect, ...]:
    """Effects with their internal parameters p moved by step, held in their bounds."""
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


def on_bound(effect: Effect) -> list[str]:
    """Keys of parameters that stand on a bound: not identified."""
    out = []
    for p, v in zip(effect.parameters, effect.theta, strict=True):
        if p.log:
            at = np.log(v / p.low) / np.log(p.high / p.low)
        else:
            at = (v - p.low) / (p.high - p.low)
        if not TUNING.crumb < at < 1 - TUNING.crumb:
            out.append(p.key)
    return out
