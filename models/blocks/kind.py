"""What a kind of block is: its parameters, where it may stand, its kernels.

Every kind has one forward kernel for one sample with explicit state,

    step(p, s, x, t, dt, ch) -> y

p: packed parameters; s: state, advanced in place; x: input; t: time [s]; dt: since the sample
before [s]; ch: value of the block's channel. The array form `run(p, s, x, t, ch, y)` loops over
the same kernel; every file has its own, because numba then puts the step into the loop (one loop
for all kinds that chooses the step by code took 2 to 30 times as long). Between samples the input
is taken as a straight line (first-order hold), which makes the sampled forms of linear blocks exact
for recordings of smooth motion at any sampling. A block starts settled at its first input.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dehyst.models.errors import BadModel
from dehyst.models.model import Block, Floats

UNITS = ("v", "um", "nm", "counts", "mrad", "urad")

Values = dict[str, Floats]

SAME = 1e-9  # sampling intervals that differ by less than this part count as equal


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
class Kind:
    """One kind of block.

    causal: the inverse needs no look-ahead; invertible: there is an inverse at all (a limit such
    as slew or clip counts as invertible inside its limit). pack(values, dt) -> p; size(p, dt) ->
    length of the state; start(p, s, x): settle at x; check(values): a sentence where parameters
    contradict each other, or "".
    """

    name: str
    says: str
    places: tuple[str, ...]
    params: tuple[Param, ...]
    code: int
    step: Callable[..., float]
    run: Callable[..., None]
    pack: Callable[[Values, float], Floats]
    size: Callable[[Floats, float], int]
    start: Callable[[Floats, Floats, float], None]
    causal: bool
    invertible: bool = True
    channel: bool = False
    check: Callable[[Values], str] = lambda values: ""

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

        For fitting: no checks, no copies beyond the output. Missing values take their default.
        """
        given = {name: np.atleast_1d(np.asarray(v, np.float64)) for name, v in values.items()}
        for param in self.params:
            if param.name not in given and param.default is not None:
                given[param.name] = np.array(param.default)
        return run_block(self, given, x, t_s, channel)


def run_block(
    kind: Kind, values: Values, x: Floats, t_s: Floats, channel: Floats | None = None
) -> Floats:
    """Output (N,) of one block for an input x (N,) at times t_s (N,), from settled at x[0]."""
    x = np.ascontiguousarray(x, np.float64)
    t_s = np.ascontiguousarray(t_s, np.float64)
    y = np.empty(x.size)
    if x.size == 0:
        return y
    dt = float(np.min(np.diff(t_s))) if x.size > 1 else 1.0
    p = kind.pack(values, dt)
    s = np.zeros(kind.size(p, dt))
    kind.start(p, s, float(x[0]))
    ch = np.zeros(0) if channel is None else np.ascontiguousarray(channel, np.float64)
    kind.run(p, s, x, t_s, ch, y)
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


def settled_nothing(p: Floats, s: Floats, x: float) -> None:
    """Start of a block without memory."""


def no_state(p: Floats, dt: float) -> int:
    """State length of a block without memory."""
    return 0


def pack_in_order(*names: str) -> Callable[[Mapping[str, Floats], float], Floats]:
    """A pack function that lays scalar parameters side by side."""

    def pack(values: Mapping[str, Floats], dt: float) -> Floats:
        return np.array([values[name][0] for name in names])

    return pack
