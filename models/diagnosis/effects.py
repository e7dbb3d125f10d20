"""Effects: candidates with values of their nonlinear parameters, as the fits vary them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.model import Block
from dehyst.models.physics.candidate import Candidate, Context, Parameter
from dehyst.models.signals.joined import Bools, Data, Floats

Theta = tuple[float, ...]  # values of a candidate's nonlinear parameters


@dataclass(frozen=True)
class Span:
    """The part of a recording from a given time on, or up to it. recording: index; at_s: the time
    within it; begins: whether it is the part from then on. Other recordings are in it only with
    `others`."""

    recording: int
    at_s: float
    begins: bool
    others: bool

    @property
    def rest(self) -> "Span":
        """All that is not in it."""
        return replace(self, begins=not self.begins, others=not self.others)

    def rows(self, data: Data) -> Bools:
        """Return (N,) which samples are in it."""
        own = (data.t >= self.at_s) == self.begins
        return np.where(data.rec == self.recording, own, self.others)


@dataclass(frozen=True)
class LastingSpan(Span):
    """The part from a time of a recording on, with all recordings made after it, or until that
    time, with all made before it. Recordings are in the order in which they were made."""

    @property
    def rest(self) -> Span:
        """All that is not in it."""
        return replace(self, begins=not self.begins)

    def rows(self, data: Data) -> Bools:
        """Return (N,) which samples are in it."""
        own = data.rec == self.recording
        return np.where(own, super().rows(data), (data.rec > self.recording) == self.begins)


@dataclass(frozen=True)
class Effect:
    """A candidate with the values of its nonlinear parameters. span: when it is present; None:
    always."""

    candidate: Candidate
    theta: tuple[float, ...] = ()
    span: Span | None = None

    def drive(self, data: Data, v: Floats) -> Floats:
        """Return the drive (N,) after the effect."""
        out = self.candidate.drive(data, v, self.theta)
        return out if self.span is None else np.where(self.span.rows(data), out, v)

    def output(self, data: Data, x: Floats) -> Floats:
        """Return the columns (N, k) after the effect."""
        out = self.candidate.output(data, x, self.theta)
        return out if self.span is None else np.where(self.span.rows(data)[:, None], out, x)

    def columns(self, data: Data, context: Context) -> Floats:
        """Return its additive columns (N, k)."""
        out = self.candidate.columns(data, context, self.theta)
        return out if self.span is None else out * self.span.rows(data)[:, None]

    def blocks(self, amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        """Return its blocks for a model; none if it is present for only part of the time."""
        return self.candidate.blocks(self.theta, amplitudes, data) if self.span is None else ()

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
            v = e.drive(data, v)
    return v


def apply_output_effects(data: Data, effects: Sequence[Effect], x: Floats) -> Floats:
    """Return columns (N, k) filtered by the effects that act on the hysteresis' output."""
    for e in effects:
        if e.candidate.mode == "output":
            x = e.output(data, x)
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
