"""The options and the result of an identification."""

from dataclasses import dataclass, field

from dehyst.models.errors import BadInput
from dehyst.models.identify.coupling import Coupled
from dehyst.models.identify.equations import Params, Shape
from dehyst.models.identify.structure import TriedStructure
from dehyst.models.model import Model
from dehyst.models.recording import Bools, Floats


@dataclass(frozen=True)
class Options:
    """Options that the user fixed; None: chosen by hold-out (order: TUNING.fine, 45).

    order: number of play operators (1 to 200); rate: rate-dependent or static; saturation: degree
    of the polynomial (1 to 9); bias: even powers allowed (True: required); monotone: False gives
    the plain least-squares fit, which in general cannot be inverted (for comparison only).
    """

    order: int | None = None
    rate: bool | None = None
    saturation: int | None = None
    bias: bool | None = None
    monotone: bool = True

    def __post_init__(self) -> None:
        if self.order is not None and not 1 <= self.order <= 200:
            raise BadInput(f"order: 1 to 200 play operators, not {self.order}")
        if self.saturation is not None and not 1 <= self.saturation <= 9:
            raise BadInput(f"saturation: a degree from 1 to 9, not {self.saturation}")


@dataclass(frozen=True)
class RecordingResidual:
    """The residual of the model in one recording: its rms, and the rms of its noise."""

    name: str
    rms: float
    noise: float


@dataclass(frozen=True)
class Identification:
    """The identified model, its residuals and its uncertainty.

    residuals: one (N,) array per recording, y - model, NaN where unknown; used: (N,) rows that were
    fitted; shape: the structure; params, errors: packed parameters and their standard
    errors (0: on the bound); rates: (n,) rates at which the slopes are given and up to which they
    are positive; tried: candidates that hold-out compared; chosen: the one that was fitted to all
    rows; orders: rms misfit of the fitted rows with each number of operators; static_because: why
    rate-dependence was tried and not chosen, or empty; couplings: from other axes, which the model
    contains as blocks; notes: remarks for the user.
    """

    model: Model
    residuals: tuple[Floats, ...]
    used: tuple[Bools, ...]
    shape: Shape
    params: Params
    errors: Params
    rates: Floats
    at_bound: Bools
    tried: tuple[TriedStructure, ...]
    orders: tuple[tuple[int, float], ...]
    noise_rms: float
    recordings: tuple[RecordingResidual, ...]
    chosen: TriedStructure
    static_because: str = ""
    couplings: tuple[Coupled, ...] = ()
    notes: tuple[str, ...] = field(default_factory=tuple)
