"""The result of a diagnosis: findings, verdict, models, and arrays for pictures. Frozen."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from dehyst.models.model import Model
from dehyst.models.signals.joined import Bools, Floats

FORMAT = 2
DIGITS = 6  # significant digits of the numbers in diagnosis.json

Progress = Callable[[str, float], None]
"""Called with what is done next, in words, and the fraction of the work that is done."""


@dataclass(frozen=True)
class Value:
    """A parameter with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, with enough digits that the interval keeps its width."""
        width, size = self.high - self.low, max(abs(self.low), abs(self.high))
        digits = DIGITS
        if 0.0 < width < size < math.inf:
            digits = max(DIGITS, math.ceil(math.log10(size / width)) + 2)
        return {
            "value": _plain(self.value, digits),
            "low": _plain(self.low, digits),
            "high": _plain(self.high, digits),
            "unit": self.unit,
        }


@dataclass(frozen=True)
class DataQuality:
    """Quality of the recordings: rows on their grids, missing readings, stalls of the recorder, and
    warnings that come before any finding."""

    rows: int
    missing: int
    stalls: int
    says: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the `data` entry of diagnosis.json."""
        return {
            "rows": self.rows,
            "missing": self.missing,
            "stalls": self.stalls,
            "says": " ".join(f"{s[0].upper()}{s[1:]}." for s in self.says),
        }


@dataclass(frozen=True)
class Finding:
    """One piece of physics that was left out, or `unknown` structure.

    place: what it acts on; share: share of the explainable misfit that it removes; where: places in
    the recordings that hold much of it.
    """

    name: str
    key: str
    place: str
    title: str
    equation: str
    source: str
    share: float
    evidence: Mapping[str, float]
    parameters: Mapping[str, Value]
    ambiguous_with: tuple[str, ...]
    where: Mapping[str, Any]
    says: str

    @property
    def percent(self) -> str:
        """The share in words: "84 %", or "less than 1 %"."""
        share = 100.0 * min(max(self.share, 0.0), 1.0)
        return f"{share:.0f} %" if share >= 1.0 else "less than 1 %"

    def to_dict(self) -> dict[str, Any]:
        """Return one entry of `effects` in diagnosis.json."""
        return {
            "name": self.name,
            "acts_on": self.place or "stage",
            "share": math.floor(self.share * 1e6) / 1e6,  # rounded up, the sum could exceed 1
            "evidence": {k: _plain(v) for k, v in self.evidence.items()},
            "parameters": {k: v.to_dict() for k, v in self.parameters.items()},
            "ambiguous_with": list(self.ambiguous_with),
            "where": _plain(self.where),
            "says": self.says,
        }


@dataclass(frozen=True)
class Limit:
    """What would have been seen: an effect above (or below) this value. value None: the drive of
    these recordings cannot show it at all; `why` gives the reason."""

    name: str
    value: float | None
    unit: str
    side: str = "above"
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return one entry of `would_have_seen` in diagnosis.json, or of `cannot_be_seen` without a
        value."""
        out: dict[str, Any] = {"name": self.name}
        if self.value is not None:
            out |= {self.side: _plain(self.value), "unit": self.unit}
        if self.why:
            out["why"] = self.why
        return out


@dataclass(frozen=True)
class FitView:
    """One recording for pictures; arrays (M,). base: the model in use; augmented: the augmented
    model; each as simulated, less its mean error; counted: samples that count; now: those of them
    at which the stage was as the augmented model describes it, after any effect that began within
    the recordings."""

    name: str
    t_s: Floats
    drive: Floats
    displacement: Floats
    base: Floats
    augmented: Floats
    counted: Bools
    now: Bools


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on one stage. `to_dict()` is diagnosis.json. base_model: the model in use."""

    verdict: str
    data: DataQuality
    noise: float
    unit: str
    drive_unit: str
    findings: tuple[Finding, ...]
    would_have_seen: tuple[Limit, ...]
    rms: Mapping[str, Any]
    next_experiment: str
    model: Model
    base_model: Model
    views: tuple[FitView, ...] = field(repr=False)
    locate: Mapping[str, Any] = field(repr=False)
    tried: tuple[Mapping[str, Any], ...] = ()

    @property
    def found_something(self) -> bool:
        """True when physics was left out."""
        return self.verdict != "clean"

    @property
    def before_after(self) -> tuple[float, float]:
        """Rms error of the model in use and of the augmented model, over all samples that count and
        at which the stage was as it is now."""
        total = sum(int(v.now.sum()) for v in self.views)
        return tuple(  # type: ignore[return-value]
            math.sqrt(
                sum(float((((v.displacement - y(v))[v.now]) ** 2).sum()) for v in self.views)
                / max(total, 1)
            )
            for y in (lambda v: v.base, lambda v: v.augmented)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data in the format of diagnosis.json."""
        seen = [x.to_dict() for x in self.would_have_seen if x.value is not None]
        blind = [x.to_dict() for x in self.would_have_seen if x.value is None]
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "noise": {"rms": _plain(self.noise), "unit": self.unit},
            "data": self.data.to_dict(),
            "effects": [f.to_dict() for f in self.findings],
            "would_have_seen": seen,
            "cannot_be_seen": blind,
            "rms": _plain(self.rms),
            "next_experiment": self.next_experiment,
        }


def _plain(value: Any, digits: int = DIGITS) -> Any:
    """Return JSON-ready data: numbers rounded to `digits` significant digits, None for NaN and
    infinity."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if value is None or isinstance(value, str | bool):
        return value
    number = float(value)
    if not math.isfinite(number):
        return None
    return float(f"{number:.{digits}g}")
