"""A kind of block: its parameters, the places where it may act, its kernels, its inverse.

Every kind has one forward kernel for one sample with explicit state (see
`dehyst.models.physics.address`) and one type of inverse. Inputs are interpolated linearly between
samples (first-order hold), so that the sampled form of a linear block is exact for such inputs at
any sampling period. The input of a lag or a mode may instead be held (zero-order hold): where a
control loop writes a command and keeps it until the next, as `HELD` says. A block starts settled at
its first input.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dehyst.models.errors import BadModel
from dehyst.models.model import Block, Floats
from dehyst.models.physics.address import Kernel, call_kernel, fields
from dehyst.models.signals.joined import Data
from dehyst.models.units import UNIT_NAMES

SAME = 1e-9  # relative difference below which two sampling intervals count as equal
STATES = 3  # equal parts of the state of a kind with Led.solve: forward, inverse, inverse one later
NOTHING = fields()  # the state of a block without memory

Values = dict[str, Floats]


@dataclass(frozen=True)
class Param:
    """One parameter. key: as in the model file, with {u} for the drive unit and {y} for the
    displacement unit; name: the same without units; low, high: allowed range, ends included;
    many: a list is allowed; default: None if the key is required; whole: whole numbers only."""

    key: str
    name: str
    unit: str
    low: float
    high: float
    meaning: str
    many: bool = False
    default: tuple[float, ...] | None = None
    whole: bool = False

    def matches(self, key: str, drive_unit: str = "", displacement_unit: str = "") -> bool:
        """Return whether `key` is this parameter in the given units ("": any unit)."""
        every = "(" + "|".join(UNIT_NAMES) + ")"
        pattern = re.escape(self.key)
        pattern = pattern.replace(r"\{u\}", drive_unit or every)
        pattern = pattern.replace(r"\{y\}", displacement_unit or every)
        return re.fullmatch(pattern, key) is not None

    def key_in(self, drive_unit: str, displacement_unit: str) -> str:
        """Return the key for a model in these units."""
        return self.key.replace("{u}", drive_unit).replace("{y}", displacement_unit)


@dataclass(frozen=True)
class Solved:
    """Inverted sample by sample. solve: kernel that computes the input from the output and advances
    the state; memory: the inverse depends on the state, so that it starts at the present sample;
    without memory, past targets are converted as well."""

    solve: Kernel
    memory: bool


@dataclass(frozen=True)
class Led:
    """Inverted by a lead on the targets. lead(p): factors of the first derivative [s] and of the
    second [s^2]. For a block before the hysteresis the command leads, by the first derivative only.
    solve: kernel that inverts the block exactly, sample by sample; it is used where
    is_solved(p, dt) says that this is stable at a period of dt [s]. It has its own state, the
    second of the STATES parts, driven by the targets. Driven by the applied command, it would react
    to each limit of the drive with ever more drive."""

    lead: Callable[[Floats], tuple[float, float]]
    solve: Kernel | None = None
    is_solved: Callable[[Floats, float], bool] = lambda p, dt: False


@dataclass(frozen=True)
class Shifted:
    """Inverted by a shift: the window of known targets moves ahead by seconds(p) [s]."""

    seconds: Callable[[Floats], float]


@dataclass(frozen=True)
class Limited:
    """Needs no inverse within its limits: limits(p) returns the lowest drive, the highest drive and
    the highest rate."""

    limits: Callable[[Floats], tuple[float, float, float]]


@dataclass(frozen=True)
class Subtracted:
    """The block acts parallel to the hysteresis: it reads the drive and adds to the displacement.
    Its contribution along the planned drive is subtracted from the targets."""


@dataclass(frozen=True)
class Never:
    """Not compensated; why: the reason, in words; of_one_recording: whether the block describes one
    recording only, such as its phase or its past, so that a controller must not run it."""

    why: str
    of_one_recording: bool = False


HELD = Param(
    "held",
    "held",
    "",
    0.0,
    1.0,
    "1: the input has had its value since the sample before; 0: it moves in straight lines",
    default=(0.0,),
    whole=True,
)


def held_key(data: Data) -> dict[str, float]:
    """Return the entry of a block for recordings whose lags and modes are fed by steps; {} where
    they are fed by straight lines."""
    return {"held": 1.0} if data.stepped else {}


Inverse = Solved | Led | Shifted | Limited | Subtracted | Never


def as_it_is(values: Values, x: Floats, t_s: Floats) -> tuple[Values, Floats]:
    """Return parameters and input unchanged."""
    return values, x


def forgotten(p: Floats, s: Floats, x: float) -> None:
    """Set every number of the state to 0."""
    s[:] = 0.0


def head_record(numbers: Floats, dtype: np.dtype[Any]) -> Any:
    """Return the head of a flat array as a record, with fields read and written by name."""
    return numbers[: len(dtype.names or ())].view(dtype)[0]


@dataclass(frozen=True)
class Kind:
    """One kind of block.

    packed: names of the packed parameters, in order; pack(values, dt) -> p, where packing is more
    than listing these; state: names of the state's numbers; size(p, dt): length of the state, where
    further numbers follow the named ones; start(p, s, x): settle at x; foresee(values, x, t_s):
    the input (N,) with what is known of later samples, and the parameters of what the kernel still
    has to do; check(values): a sentence if parameters contradict each other, else "";
    reach_assumes: the condition under which the stage's reach equals that of a slow triangle, "" if
    it always does.
    """

    name: str
    says: str  # a noun: "a first-order lag", "creep"
    places: tuple[str, ...]
    params: tuple[Param, ...]
    step: Kernel
    inverse: Inverse
    packed: np.dtype[Any] = NOTHING
    state: np.dtype[Any] = NOTHING
    pack: Callable[[Values, float], Floats] | None = None
    size: Callable[[Floats, float], int] | None = None
    start: Callable[[Floats, Floats, float], None] = forgotten
    foresee: Callable[[Values, Floats, Floats], tuple[Values, Floats]] = as_it_is
    channel: bool = False
    check: Callable[[Values], str] = lambda values: ""
    reach_assumes: str = ""

    def __post_init__(self) -> None:
        if "drive" in self.places and isinstance(self.inverse, Solved):
            raise ValueError(
                f"{self.name}: before the hysteresis only Led, Shifted and Limited are undone"
            )

    @property
    def is_parallel(self) -> bool:
        """Whether the block acts parallel to the hysteresis."""
        return isinstance(self.inverse, Subtracted)

    @property
    def dynamic(self) -> bool:
        """Whether the inverse needs future targets."""
        return isinstance(self.inverse, Led | Shifted)

    def compile(self) -> list[int]:
        """Compile the kernels, or load them from the cache, and return their addresses."""
        solve = self.inverse.solve if isinstance(self.inverse, Solved | Led) else None
        return [kernel.address for kernel in (self.step, solve) if kernel is not None]

    def numbers(self, values: Values, dt: float) -> tuple[Floats, int]:
        """Return the packed parameters p and the length of the state."""
        if self.pack is None:
            p = np.array([values[name][0] for name in self.packed.names or ()])
        else:
            p = np.ascontiguousarray(self.pack(values, dt), np.float64)
        return p, len(self.state.names or ()) if self.size is None else self.size(p, dt)

    def values(self, block: Block, drive_unit: str = "", displacement_unit: str = "") -> Values:
        """Return the parameters by name, each as an array. Raises BadModel, naming the key."""
        out: Values = {}
        known = [p.key_in(drive_unit or "v", displacement_unit or "um") for p in self.params]
        for key, value in block.params.items():
            param = next(
                (p for p in self.params if p.matches(key, drive_unit, displacement_unit)), None
            )
            if param is None:
                raise BadModel(
                    f"{key}: unknown key for kind {self.name!r}; known here: {', '.join(known)}"
                )
            out[param.name] = _checked(param, key, value)
        for param, key in zip(self.params, known, strict=True):
            if param.name not in out:
                if param.default is None:
                    raise BadModel(f"{key}: this key is missing (kind {self.name!r})")
                out[param.name] = np.array(param.default)
        problem = self.check(out)
        if problem:
            raise BadModel(f"{problem} (kind {self.name!r})")
        return out

    def run(self, values: Values, x: Floats, t_s: Floats, channel: Floats | None = None) -> Floats:
        """Return the output (N,) for an input x (N,) at times t_s (N,), settled at x[0] before."""
        x = np.ascontiguousarray(x, np.float64)
        t_s = np.ascontiguousarray(t_s, np.float64)
        y = np.empty(x.size)
        if x.size == 0:
            return y
        dt = float(np.min(np.diff(t_s))) if x.size > 1 else 1.0
        values, x = self.foresee(values, x, t_s)
        p, size = self.numbers(values, dt)
        s = np.zeros(size)
        self.start(p, s, float(x[0]))
        ch = np.zeros(0) if channel is None else np.ascontiguousarray(channel, np.float64)
        call_kernel(self.step.address, p, s, x, t_s, ch, y)
        return y


def _checked(param: Param, key: str, value: Any) -> Floats:
    entries = list(value) if isinstance(value, tuple | list) else [value]
    if not entries or (len(entries) > 1 and not param.many):
        raise BadModel(f"{key}: one number is needed, not {len(entries)}")
    for entry in entries:
        if isinstance(entry, bool) or not isinstance(entry, int | float) or entry != entry:
            raise BadModel(f"{key}: a finite number is needed, not {entry!r}")
        if not param.low <= entry <= param.high:
            raise BadModel(
                f"{key}: must be from {param.low:g} to {param.high:g} {param.unit}, not {entry:g}"
            )
        if param.whole and entry != int(entry):
            raise BadModel(f"{key}: a whole number is needed, not {entry:g}")
    return np.array(entries, np.float64)
