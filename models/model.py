"""The model of a stage: hysteresis, further blocks, validity, fit errors, provenance.

The hysteresis is the modified Prandtl-Ishlinskii model (Qin et al., Eq. 6):

    z(t) = sum_i (b_i + k_i du/dt) H_ri(u - u_offset)(t)
    y(t) = c_0 + c_1 z + c_2 z^2 + ...            (ascending powers here; the paper prints
                                                   [c5, 0, c3, 0, c1], descending and odd)

with du/dt the backward difference (u[t] - u[t-1]) / T and 0 at the first sample. The paper's own
model has u_offset = 0 and odd powers only; even powers and c_0 represent the internal bias of real
unipolar stacks. The scale of z is arbitrary (a gauge): scaling z by s and c_j by s^-j gives the
same y.

All classes are frozen and their arrays are read-only. u is in `drive_unit`, y in
`displacement_unit`; both are the recording's units.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dehyst.models.arrays import Floats
from dehyst.models.errors import BadModel


def _frozen(values: ArrayLike, name: str) -> Floats:
    out = np.array(values, dtype=np.float64)
    if out.ndim != 1 or not np.all(np.isfinite(out)):
        raise BadModel(f"{name}: a list of finite numbers is needed")
    out.flags.writeable = False
    return out


@dataclass(frozen=True)
class Hysteresis:
    """Parameters of the modified Prandtl-Ishlinskii model (Eq. 6).

    r: (n,) thresholds, ascending, >= 0 [drive unit]; b: (n,) weights [1];
    k: (n,) slopes, weight per input rate [s / drive unit], all zero for a static model;
    c: (m + 1,) saturation polynomial, ascending powers [displacement unit / z^j];
    u_offset: subtracted from the input before the operators [drive unit].
    Raises BadModel on wrong shapes, non-finite numbers or negative thresholds.
    """

    r: Floats
    b: Floats
    c: Floats
    k: Floats = field(default_factory=lambda: np.zeros(0))  # empty: static, (n,) zeros
    u_offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("r", "b", "c"):
            object.__setattr__(self, name, _frozen(getattr(self, name), name))
        k = self.k if np.size(self.k) else np.zeros(self.r.size)
        object.__setattr__(self, "k", _frozen(k, "k"))
        if self.r.size == 0 or not (self.r.size == self.b.size == self.k.size):
            raise BadModel(
                f"thresholds, weights and slopes must have the same length of one or more, "
                f"not {self.r.size}, {self.b.size}, {self.k.size}"
            )
        if self.c.size < 2:
            raise BadModel("the saturation polynomial needs at least the powers 0 and 1")
        if np.any(self.r < 0) or np.any(np.diff(self.r) < 0):
            raise BadModel("thresholds must be ascending and not negative")
        if not np.isfinite(self.u_offset):
            raise BadModel("the drive offset must be a finite number")

    @property
    def n(self) -> int:
        """Number of play operators."""
        return int(self.r.size)

    @property
    def static(self) -> bool:
        """True when no weight depends on the input rate."""
        return not np.any(self.k)


@dataclass(frozen=True)
class Validity:
    """The range in which the model was identified: drive range [drive unit], highest rate
    [drive unit / s], highest acceleration [drive unit / s^2], band (highest frequency, Hz),
    sampling period [s], and slowest_s, the longest time [s] that the drive took to cross a
    twentieth of its range. None: not known, no bound."""

    drive_min: float
    drive_max: float
    rate_max: float | None = None
    acceleration_max: float | None = None
    band_hz: float | None = None
    period_s: float | None = None
    slowest_s: float | None = None


MOSTLY_NOISE = 0.875  # of the power: 73 of 79 intervals then held, with 0.75 90 of 105


@dataclass(frozen=True)
class Fit:
    """Errors of the fit, rms in displacement units; band: half the width of the interval that
    contains 95 % of the displacements predicted for other drives in the range, None: the recordings
    do not determine it; steady_rms: the larger of the first two without the drift of the recording,
    None: it does not drift. None: not measured."""

    rms: float | None = None
    holdout_rms: float | None = None
    noise_rms: float | None = None
    band: float | None = None
    steady_rms: float | None = None

    @property
    def claim(self) -> float | None:
        """Largest rms error that the model claims for another recording, apart from a drift."""
        if self.steady_rms is not None:
            return self.steady_rms
        return max((x for x in (self.holdout_rms, self.rms) if x is not None), default=None)

    @property
    def leaves_mostly_noise(self) -> bool:
        """Whether the claimed error is mostly noise. What a model leaves out causes half to three
        times as much error with another waveform, which no recording of one waveform shows."""
        claim, noise = self.claim, self.noise_rms
        return claim is not None and noise is not None and MOSTLY_NOISE * claim**2 <= noise**2


@dataclass(frozen=True)
class Provenance:
    """Origin of the model's numbers. recordings: (file name, sha256) pairs."""

    created: str = ""
    version: str = ""
    source: str = ""
    recordings: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Block:
    """One further physical effect in the cascade.

    kind: a name in dehyst.models.physics.KINDS; place: "drive" (between command and
    hysteresis), "stage" (moves the stage) or "sensor" (acts on the reading alone, and is never
    compensated); params: numbers, each key with its unit (`delay_s`, `gain_per_decade`);
    channel: the additional recording channel that it reads, or "".
    """

    kind: str
    place: str
    params: dict[str, float | tuple[float, ...]] = field(default_factory=dict)
    channel: str = ""


@dataclass(frozen=True)
class Model:
    """A stage's model: hysteresis, blocks in physical order, range of validity and fit errors."""

    hysteresis: Hysteresis
    validity: Validity
    drive_unit: str = "v"
    displacement_unit: str = "um"
    blocks: tuple[Block, ...] = ()
    fit: Fit = Fit()
    provenance: Provenance = Provenance()
