"""What a kind of block is: its parameters, where it may stand, its kernels, its inverse.

Every kind has one forward kernel for one sample with explicit state (see
`dehyst.models.physics.address`) and one of the ways to undo it. Between samples the input is taken
as a straight line (first-order hold), which makes the sampled forms of linear blocks exact for
recordings of smooth motion at any sampling. A block starts settled at its first input.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dehyst.models.errors import BadModel
from dehyst.models.model import Block, Floats
from dehyst.models.physics.address import Kernel, call_kernel, fields

UNITS = ("v", "um", "nm", "counts", "mrad", "urad")
SAME = 1e-9  # sampling intervals that differ by less than this part count as equal
STATES = 3  # alike, of a block that is led or solved: its own, what undoes it, that a sample later
NOTHING = fields()  # the state of a block without memory

Values = dict[str, Floats]


@dataclass(frozen=True)
class Param:
    """One parameter. key: as in the model file, with {u} for the drive unit and {y} for the
    displacement unit; name: the same without units; low, high: allowed range, ends included;
    many: a list is allowed; default: None where the key must be given."""

    key: str
    name: str
    unit: str
    low: float
    high: float
    meaning: str
    many: bool = False
    default: tuple[float, ...] | None = None

    def matches(self, key: str, drive_unit: str = "", displacement_unit: str = "") -> bool:
        """Whether `key` is this parameter in the given units ("": any unit)."""
        every = "(" + "|".join(UNITS) + ")"
        pattern = re.escape(self.key)
        pattern = pattern.replace(r"\{u\}", drive_unit or every)
        pattern = pattern.replace(r"\{y\}", displacement_unit or every)
        return re.fullmatch(pattern, key) is not None

    def key_in(self, drive_unit: str, displacement_unit: str) -> str:
        """The key for a model in these units."""
        return self.key.replace("{u}", drive_unit).replace("{y}", displacement_unit)


@dataclass(frozen=True)
class Solved:
    """Undone sample by sample. solve: kernel that turns the output into the input and advances
    the state; memory: its state at the present counts, so it begins there; without memory also
    the targets that have passed are turned."""

    solve: Kernel
    memory: bool


@dataclass(frozen=True)
class Led:
    """The targets lead. lead(p): seconds of the first derivative, seconds squared of the second.
    Before the hysteresis the command leads, by the first alone. solve: kernel that undoes it
    exactly, sample by sample, where is_solved(p, dt) says that this is stable at samples spaced by
    dt. Its state is its own, the second of STATES alike: it goes by the targets. By what was really
    applied it would answer each limit of the drive with more drive, without end."""

    lead: Callable[[Floats], tuple[float, float]]
    solve: Kernel | None = None
    is_solved: Callable[[Floats, float], bool] = lambda p, dt: False


@dataclass(frozen=True)
class Shifted:
    """The targets are taken later: the window of known targets moves by seconds(p)."""

    seconds: Callable[[Floats], float]


@dataclass(frozen=True)
class Limited:
    """Nothing to undo inside the limits that it sets: limits(p) is the lowest and the highest
    drive and the largest rate."""

    limits: Callable[[Floats], tuple[float, float, float]]


@dataclass(frozen=True)
class Subtracted:
    """The block stands beside the hysteresis: it reads the drive and adds to the displacement.
    What it adds along the planned drive is subtracted from the targets."""


@dataclass(frozen=True)
class Never:
    """Not compensated; why: in words."""

    why: str


Inverse = Solved | Led | Shifted | Limited | Subtracted | Never


def forgotten(p: Floats, s: Floats, x: float) -> None:
    """Start with every number of the state 0."""
    s[:] = 0.0


def head_record(numbers: Floats, dtype: np.dtype[Any]) -> Any:
    """The head of a flat array as a record, to read and write by name."""
    return numbers[: len(dtype.names or ())].view(dtype)[0]


@dataclass(frozen=True)
class Kind:
    """One kind of block.

    packed: the names of what `pack` lays side by side, in order; pack(values, dt) -> p, where it
    is not plainly these; state: the names of the state's numbers; size(p, dt): their number, where
    there are more behind them; start(p, s, x): settle at x; check(values): a sentence where
    parameters contradict each other, or ""; reach_assumes: under which condition the reach of a
    slow triangle is that of the stage, "" where it always is.
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
    channel: bool = False
    check: Callable[[Values], str] = lambda values: ""
    reach_assumes: str = ""

    def __post_init__(self) -> None:
        if "drive" in self.places and isinstance(self.inverse, Solved):
            raise ValueError(
                f"{self.name}: before the hysteresis only Led, Shifted and Limited are undone"
            )

    @property
    def beside(self) -> bool:
        """Whether it stands beside the hysteresis."""
        return isinstance(self.inverse, Subtracted)

    @property
    def dynamic(self) -> bool:
        """Whether its inverse wants targets that lie ahead."""
        return isinstance(self.inverse, Led | Shifted)

    def compile(self) -> list[int]:
        """Addresses of its kernels, which are compiled by this, or taken from the cache."""
        solve = self.inverse.solve if isinstance(self.inverse, Solved | Led) else None
        return [kernel.address for kernel in (self.step, solve) if kernel is not None]

    def numbers(self, values: Values, dt: float) -> tuple[Floats, int]:
        """Packed parameters p, and the length of the state."""
        if self.pack is None:
            p = np.array([values[name][0] for name in self.packed.names or ()])
        else:
            p = np.ascontiguousarray(self.pack(values, dt), np.float64)
        return p, len(self.state.names or ()) if self.size is None else self.size(p, dt)

    def values(self, block: Block, drive_unit: str = "", displacement_unit: str = "") -> Values:
        """Parameters by name, each as an array. Raises BadModel naming the key."""
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

    def forward(
        self,
        x: Floats,
        t_s: Floats,
        channel: Floats | None = None,
        **values: float | Floats | tuple[float, ...],
    ) -> Floats:
        """Output (N,) for an input x (N,) at times t_s (N,); values by parameter name.

        No checks of the values; missing ones take their default.
        """
        given = {name: np.atleast_1d(np.asarray(v, np.float64)) for name, v in values.items()}
        for param in self.params:
            if param.name not in given and param.default is not None:
                given[param.name] = np.array(param.default)
        return self.run(given, x, t_s, channel)

    def run(self, values: Values, x: Floats, t_s: Floats, channel: Floats | None = None) -> Floats:
        """Output (N,) for an input x (N,) at times t_s (N,), from settled at x[0]."""
        x = np.ascontiguousarray(x, np.float64)
        t_s = np.ascontiguousarray(t_s, np.float64)
        y = np.empty(x.size)
        if x.size == 0:
            return y
        dt = float(np.min(np.diff(t_s))) if x.size > 1 else 1.0
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
    return np.array(entries, np.float64)
