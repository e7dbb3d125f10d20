"""The interface between a physical effect and the diagnosis: each candidate is a subclass.

A candidate acts in one of three modes and overrides the method of that mode:
    drive     transforms the drive before the hysteresis (delay, slew, clip, lag of an amplifier)
    output    a linear operator on the hysteresis' output (creep, modes, lag of a sensor)
    columns   additive columns whose amplitudes are fitted linearly (lines, channels)
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.models.model import Block
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.units import spell_unit

# readings, targets, corrections made from readings, and flags are effects, not causes; temperature
# is handled in drift.py
NOT_A_CAUSE = re.compile(r"(temp|target|trim|learned|flags|missed|t_|y\d*_)")


@dataclass(frozen=True)
class Parameter:
    """One nonlinear parameter: bounds in its unit; log: searched on a logarithmic scale; sure:
    relative half width of its interval, in addition to that due to noise, for what one set of
    recordings does not show (between two samples of a step the hysteresis is curved, and the model
    assumes a straight line; the recorder's clock);
    within: the same in the parameter's unit, a fraction of a sample; whole: the upper bound is a
    physical maximum, and a value there counts as identified."""

    key: str
    unit: str
    low: float
    high: float
    log: bool = True
    sure: float = 0.0
    within: float = 0.0
    whole: bool = False


@dataclass(frozen=True)
class Context:
    """Inputs of an additive candidate: v (N,), the drive after the drive blocks, and the output
    (N,) of the hysteresis in the last fit."""

    v: Floats
    output: Floats


@dataclass(frozen=True)
class Probe:
    """A strength of the effect at which its visibility is tested, for the exclusion limits.

    value: in the limit's unit; theta: nonlinear parameters; amplitudes: of additive columns.
    """

    value: float
    theta: tuple[float, ...] = ()
    amplitudes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Sighting:
    """Direct evidence of an effect in a recording, without a fit of the displacement.

    theta: nonlinear parameters; intervals: key -> (value, low, high, unit); says: the sentence for
    the user.
    """

    theta: tuple[float, ...]
    intervals: Mapping[str, tuple[float, float, float, str]]
    says: str


class Candidate:
    """Base of all candidates; the class attributes describe the physics in reports.

    name: word of the diagnosis vocabulary; key: unique among the instances; order: position in
    the cascade; driven: caused by the drive (judged more strictly) or by something else.
    """

    name: str = ""
    key: str = ""
    title: str = ""
    equation: str = ""
    source: str = ""
    confused_with: tuple[str, ...] = ()
    order: int = 0
    place: str = "stage"
    driven: bool = True
    slow: bool = False  # fits a part of any change in time: reported only if nothing else is left
    past: bool = False  # a slow one that began before the recording: reported with a small residual
    static: bool = False  # resembles a hysteresis of another shape: judged even more strictly
    minima: int = 1  # number of starts that are refitted, as its misfit may have as many minima
    lasting: bool = False  # seen from one period of the drive to the next, not within one
    late: bool = False  # delays the displacement: reported also if the drive repeats itself within
    # few samples, but then only one of these candidates
    rival_if_implausible: bool = True  # named as a rival even if its values are implausible
    reports_bounds: bool = True  # a parameter on its bound is reported as not identified
    contains: tuple[str, ...] = ()  # names of simpler effects that it can also represent; if it
    # promises as much as one of another name, it is refitted in addition, replacing none
    widest_spread: float = 1.0  # largest rms spread of its amplitude over time that is accepted
    mode: str = "columns"  # or "drive", "output"
    parameters: tuple[Parameter, ...] = ()
    channel: str = ""
    refines: tuple[str, ...] = ()  # keys of the simpler candidates that this one extends
    alone: bool = False  # one that refines another is tried even if the simpler one promises little
    beside_model: bool = False  # tried only where a given model stands without a base: a base would
    # absorb it, or leave what it imitates
    size_index: int | None = None  # parameter to which the effect is roughly proportional

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        """Return the start values of the search, one tuple for each trial."""
        return [self.refined_start(())] if self.refines else [()]

    def likelier_equivalents(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        """Return likelier values with nearly the same effect on the samples; all are refitted."""
        return []

    def plausibility_weight(self, theta: Sequence[float], amplitudes: Floats) -> float:
        """Return the weight of a gain: below 1 where a simpler explanation should be preferred, 0
        where the values are not those of this effect. amplitudes: of additive columns."""
        return 1.0

    def can_count_when_small(self, theta: Sequence[float]) -> bool:
        """Return whether a small effect that is the same everywhere counts: true for static ones,
        except those flexible enough to fit noise, and for others that no error of a base
        resembles."""
        return self.static

    def free_oscillation(self, theta: Sequence[float]) -> tuple[float, float] | None:
        """Return frequency [Hz] and decay rate [1/s] of the free oscillation; None without one."""
        return None

    @property
    def is_last_resort(self) -> bool:
        """Whether it is named only if nothing remains unexplained: an effect that began before the
        recording, and that implies no other visible effect, fits too much."""
        return self.past and not self.required_companion()

    def required_companion(self) -> str:
        """Return the key of another candidate that must be present if this one is; "": none."""
        return ""

    def implausible_with(self, amplitudes: Floats, companion: Sequence[float], data: Data) -> str:
        """Return why these amplitudes are not possible together with the fitted parameters of the
        required companion, or "". companion (): its fit is no better than none."""
        return ""

    def scaled(self, theta: Sequence[float], amount: float) -> tuple[float, ...]:
        """Return a start whose effect is about `amount` times as large, where size_index names the
        parameter to scale."""
        if self.size_index is None:
            return tuple(theta)
        p = self.parameters[self.size_index]
        out = list(theta)
        value = out[self.size_index] * min(max(amount, 0.05), 20.0)
        out[self.size_index] = min(max(value, p.low * 1.01), p.high * 0.98)
        return tuple(out)

    def refined_start(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Return a start, given the fitted theta of the candidate that this one refines."""
        return tuple(theta)

    def after(self, ahead_s: float, theta: Sequence[float]) -> tuple[float, ...]:
        """Return the values at which this effect compensates for other effects that act `ahead_s`
        earlier [s]."""
        return tuple(theta)

    def add_mode(self, theta: Sequence[float], data: Data, residual: Floats) -> tuple[float, ...]:
        """Return theta extended by one more mode that the residual suggests, or ()."""
        return ()

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        """Return the parameters of a theta; lines and modes may have any number."""
        return self.parameters

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        """Return the drive (N,) after this effect."""
        return v

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        """Return the columns (N, k) after this effect; linear in x."""
        return x

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        """Return the additive columns (N, k)."""
        return np.zeros((data.n, 0))

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        """Return the parameters to report: key -> (value, unit)."""
        return {
            p.key: (float(v), p.unit) for p, v in zip(self.params_at(theta), theta, strict=True)
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        """Return the blocks to add to the model."""
        return ()

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        """Return one sentence that a technician understands."""
        return self.title

    limit_unit: str = ""
    limit_side: str = "above"

    def probes(self, data: Data) -> list[Probe]:
        """Return the strengths, from weak to strong, at which the exclusion limit is searched."""
        return []

    def limit_caveat(self, data: Data) -> str:
        """Return what the exclusion limit does not hold for in these recordings; "": nothing."""
        return ""

    def find_sighting(self, data: Data, sigma: float) -> Sighting | None:
        """Return direct evidence in the recordings, or None."""
        return None

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        """Return why these values cannot be this effect; "" if they can."""
        return ""


def format_length(entry: tuple[float, str]) -> str:
    """Format a displacement-like value; below one micrometre in nanometres: "12 nm/K"."""
    value, unit = entry
    if (unit == "um" or unit.startswith("um/")) and abs(value) < 1.0:
        value, unit = 1e3 * value, f"nm{unit[2:]}"
    return f"{value:.3g} {spell_unit(unit)}"


def split_by_recording(data: Data, x: Floats) -> Floats:
    """Return x (N,) as (N, k) columns, one for each of k recordings, 0 in the others."""
    return x[:, None] * (data.rec[:, None] == np.arange(len(data.names))[None, :])


def may_be_confused(one: Candidate, other: Candidate) -> bool:
    """Return whether two effects look alike: confusion is mutual, whichever of them declares it."""
    return other.name in one.confused_with or one.name in other.confused_with


def one_per_recording(data: Data, p: Parameter) -> tuple[Parameter, ...]:
    """Return one parameter per recording: each recording has a different past."""
    return (p,) * len(data.names)


def move_from_zero(data: Data) -> float:
    """Return the displacement of a move from drive 0 to the far end of the recordings' range, at
    their mean slope: the last move before a small scan may have been as large."""
    farthest = max(abs(data.u_min), abs(data.u_min + data.span))
    return float(np.ptp(data.y)) * farthest / data.span


def common_amplitude(data: Data, columns: Floats, added: Floats) -> float:
    """Return the common amplitude of columns (N, k), one for each recording, that best fits (least
    squares) what was added to the recordings (N,), with each recording's mean removed."""
    power = along = 0.0
    for i in range(columns.shape[1]):
        here = (data.rec == i) & data.rows
        if here.any():
            x, y = columns[here, i], added[here]
            power += float(np.sum((x - x.mean()) ** 2))
            along += float((x - x.mean()) @ (y - y.mean()))
    return along / max(power, 1e-300)


def other_causes(data: Data) -> list[str]:
    """Return the names of further channels that may move the stage."""
    return [c for c in data.channels if not NOT_A_CAUSE.match(c) and c != data.drive_key]
