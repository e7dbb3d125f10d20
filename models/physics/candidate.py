"""How a physics is recognised: what one candidate tells the diagnosis, by a subclass of its own.

A candidate acts in one of three ways, and overrides the one that fits:
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

# readings, targets, what was added to them because of the readings, and flags are effects; the
# temperature has a file of its own
NOT_A_CAUSE = re.compile(r"(temp|target|trim|learned|flags|missed|t_|y\d*_)")


@dataclass(frozen=True)
class Parameter:
    """One nonlinear parameter: bounds in its unit; log: searched on a logarithmic scale; sure:
    relative half width of its interval by what sampling leaves open (the hysteresis bends between
    two samples of a step, and the model takes it as straight), beside what the noise makes; within:
    the same in its unit, a part of a sample; whole: the upper bound is all that there can be, and
    identified like any other value."""

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
    """What an additive candidate may look at: the drive behind its blocks, and the hysteresis'
    output (N,) of the last fit."""

    v: Floats
    output: Floats


@dataclass(frozen=True)
class Probe:
    """A strength at which the effect's visibility is tried, for the exclusion limits.

    value: in the limit's unit; theta: nonlinear parameters; amplitudes: of additive columns.
    """

    value: float
    theta: tuple[float, ...] = ()
    amplitudes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Sighting:
    """What a recording shows of a physics directly, without a fit of the displacement.

    theta: nonlinear parameters; intervals: key -> (value, low, high, unit); says: the sentence for
    people.
    """

    theta: tuple[float, ...]
    intervals: Mapping[str, tuple[float, float, float, str]]
    says: str


class Candidate:
    """Base of all candidates; class attributes describe the physics to people and reports.

    name: word of the diagnosis vocabulary; key: unique among the instances; order: position in
    the cascade; driven: caused by the drive (judged more strictly) or by something beside it;
    refines: key of the simpler candidate that this one takes further.
    """

    name: str = ""
    key: str = ""
    title: str = ""
    equation: str = ""
    source: str = ""
    typical: str = ""
    revealed_by: str = ""
    confused_with: tuple[str, ...] = ()
    order: int = 0
    place: str = "stage"
    driven: bool = True
    slow: bool = False  # takes a part of any change in time: reported where nothing else is left
    past: bool = False  # a slow one that began before the recording: reported beside a smaller rest
    static: bool = False  # resembles a hysteresis of another shape: judged more strictly still
    minima: int = 1  # starts that are refitted: its misfit may have so many minima
    lasting: bool = False  # shows from one period of the drive to the next, not within one
    late: bool = False  # the displacement comes late: reported also where the drive repeats itself
    # within few samples, and of all such causes one alone
    rival_if_implausible: bool = True  # named as a rival even where its values cannot be its own
    reports_bounds: bool = True  # a parameter on its bound is reported as not identified
    contains: tuple[str, ...] = ()  # names of simpler ones that it makes too; what promises as much
    # as another physics that it contains is refitted beside that, in the place of none
    widest_spread: float = 1.0  # of its amplitude over time, rms: with more it is not the same
    mode: str = "columns"  # or "drive", "output"
    parameters: tuple[Parameter, ...] = ()
    channel: str = ""
    refines: str = ""  # key of the simpler candidate that this one takes further
    size_index: int | None = None  # the parameter that the effect is about proportional to

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        """Values from which the search begins (one tuple for each trial)."""
        return [self.refined(())] if self.refines else [()]

    def doubles(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        """Likelier values that make nearly the same of the samples: they are refitted too."""
        return []

    def likely(self, theta: Sequence[float], amplitudes: Floats) -> float:
        """Weight of a gain: below 1 where a plainer one should go first, 0 where it is not its own.
        amplitudes: of additive columns."""
        return 1.0

    def may_be_small(self, theta: Sequence[float]) -> bool:
        """Whether a small effect counts that is the same everywhere: of static ones, but for those
        whose many shapes chance fits, and of others where no error of a base looks like them."""
        return self.static

    def ring(self, theta: Sequence[float]) -> tuple[float, float] | None:
        """Frequency [Hz] and decay [1/s] of its free oscillation, where it has one."""
        return None

    @property
    def last(self) -> bool:
        """Whether it is named only where it leaves nothing behind: what began before the recording,
        and brings nothing with it that would be seen, fits too much."""
        return self.past and not self.company()

    def company(self) -> str:
        """Key of another candidate that must be there too, were this one there; "" for none."""
        return ""

    def scaled(self, theta: Sequence[float], amount: float) -> tuple[float, ...]:
        """Start whose effect is about `amount` times as large, where one parameter says so."""
        if self.size_index is None:
            return tuple(theta)
        p = self.parameters[self.size_index]
        out = list(theta)
        value = out[self.size_index] * min(max(amount, 0.05), 20.0)
        out[self.size_index] = min(max(value, p.low * 1.01), p.high * 0.98)
        return tuple(out)

    def refined(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Start from the fitted theta of the candidate that this one refines."""
        return tuple(theta)

    def grown(self, theta: Sequence[float], data: Data, residual: Floats) -> tuple[float, ...]:
        """theta with one more part of its kind (a mode) that the residual asks for, or ()."""
        return ()

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        """Parameters that belong to a theta (lines and modes may have any number)."""
        return self.parameters

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        """Drive (N,) behind this piece of physics."""
        return v

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        """Columns (N, k) behind this piece of physics; linear in x."""
        return x

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        """Additive columns (N, k)."""
        return np.zeros((data.n, 0))

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        """Parameters to report: key -> (value, unit)."""
        return {
            p.key: (float(v), p.unit) for p, v in zip(self.params_at(theta), theta, strict=True)
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        """Blocks of the augmented model."""
        return ()

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        """One sentence that a technician understands."""
        return self.title

    limit_unit: str = ""
    limit_side: str = "above"

    def probes(self, data: Data) -> list[Probe]:
        """Strengths from weak to strong, from which the exclusion limit is found."""
        return []

    def limit_leaves_out(self, data: Data) -> str:
        """What its limit does not hold for, in these recordings; "" for nothing."""
        return ""

    def seen(self, data: Data, sigma: float) -> Sighting | None:
        """What the recordings show of it directly; None where they do not."""
        return None

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        """Why these values cannot be this physics; empty when they can."""
        return ""


def small(entry: tuple[float, str]) -> str:
    """A value of the displacement's size; micrometres below one become nanometres: "12 nm/K"."""
    value, unit = entry
    if (unit == "um" or unit.startswith("um/")) and abs(value) < 1.0:
        value, unit = 1e3 * value, f"nm{unit[2:]}"
    return f"{value:.3g} {spell_unit(unit)}"


def apart(data: Data, x: Floats) -> Floats:
    """(N, k) columns of x (N,), one for each of k recordings, 0 in the others."""
    return x[:, None] * (data.rec[:, None] == np.arange(len(data.names))[None, :])


def of_each(data: Data, p: Parameter) -> tuple[Parameter, ...]:
    """A parameter that each recording has for itself: what began before is another past in each."""
    return (p,) * len(data.names)


def move_from_zero(data: Data) -> float:
    """Displacement of a move from no drive to where the recordings are, at their mean slope: the
    last move before a small scan may have been so large."""
    farthest = max(abs(data.u_min), abs(data.u_min + data.span))
    return float(np.ptp(data.y)) * farthest / data.span


def common_amplitude(data: Data, columns: Floats, added: Floats) -> float:
    """The one amplitude with which columns (N, k), one for each recording, come nearest to what was
    added to the recordings (N,), each recording's mean apart."""
    power = along = 0.0
    for i in range(columns.shape[1]):
        here = (data.rec == i) & data.rows
        if here.any():
            x, y = columns[here, i], added[here]
            power += float(np.sum((x - x.mean()) ** 2))
            along += float((x - x.mean()) @ (y - y.mean()))
    return along / max(power, 1e-300)


def other_causes(data: Data) -> list[str]:
    """Further channels that may move the stage."""
    return [c for c in data.channels if not NOT_A_CAUSE.match(c) and c != data.drive_key]
