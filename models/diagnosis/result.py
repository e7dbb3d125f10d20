"""What a diagnosis gives back: findings, verdict, models, and arrays for pictures. Frozen."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dehyst.models.model import Model
from dehyst.models.signals.joined import Bools, Floats

FORMAT = 1
VERDICTS = ("clean", "explained", "partly", "unknown")


@dataclass(frozen=True)
class Value:
    """A parameter with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "value": _plain(self.value),
            "low": _plain(self.low),
            "high": _plain(self.high),
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Finding:
    """One piece of physics that was left out, or `unknown` structure."""

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

    def to_dict(self) -> dict[str, Any]:
        """The contract's entry of `effects`."""
        return {
            "name": self.name,
            "place": self.place,
            "share": _plain(self.share),
            "evidence": {k: _plain(v) for k, v in self.evidence.items()},
            "parameters": {k: v.to_dict() for k, v in self.parameters.items()},
            "ambiguous_with": list(self.ambiguous_with),
            "where": _plain(self.where),
            "says": self.says,
        }


@dataclass(frozen=True)
class Limit:
    """What would have been seen: an effect above (or below) this value. value None: the drive of
    these recordings cannot show it at all; `why` says so."""

    name: str
    value: float | None
    unit: str
    side: str = "above"
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The contract's entry of `would_have_seen`."""
        out: dict[str, Any] = {"name": self.name, self.side: _plain(self.value), "unit": self.unit}
        if self.why:
            out["why"] = self.why
        return out


@dataclass(frozen=True)
class View:
    """One recording for pictures; arrays (M,). Predictions of held_out samples come from fits
    that did not see them."""

    name: str
    t_s: Floats
    drive: Floats
    displacement: Floats
    base: Floats
    shape: Floats  # rich rate-independent base, without the effects
    augmented: Floats
    held_out: Bools


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on one stage. `to_dict()` is diagnosis.json."""

    verdict: str
    noise: float
    unit: str
    drive_unit: str
    findings: tuple[Finding, ...]
    would_have_seen: tuple[Limit, ...]
    rms: Mapping[str, Any]
    next_experiment: str
    model: Model
    base_model: Model
    views: tuple[View, ...] = field(repr=False)
    locate: Mapping[str, Any] = field(repr=False)
    tried: tuple[Mapping[str, Any], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def found_something(self) -> bool:
        """True when physics was left out."""
        return self.verdict != "clean"

    def to_dict(self) -> dict[str, Any]:
        """Plain data by the contract of diagnosis.json."""
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "noise": {"rms": _plain(self.noise), "unit": self.unit},
            "effects": [f.to_dict() for f in self.findings],
            "would_have_seen": [limit.to_dict() for limit in self.would_have_seen],
            "rms": _plain(self.rms),
            "next_experiment": self.next_experiment,
            "notes": list(self.notes),
        }


def _plain(value: Any) -> Any:
    """JSON-ready: numbers to six digits, no NaN or infinity."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if value is None or isinstance(value, str | bool):
        return value
    number = float(value)
    if not math.isfinite(number):
        return None
    return float(f"{number:.6g}")
