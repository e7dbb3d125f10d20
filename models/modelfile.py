"""Convert a Model to TOML text and back (format 1). Reading and writing files is the daemon's task.

Every key ends in its unit. The file begins with the drive unit and the displacement unit; the keys
that depend on them end in these (`thresholds_v`, `saturation_um`, `drive_max_v`). Unknown keys,
missing keys, values outside their range and damaged text raise BadModel, which names the key.
"""

import math
from collections.abc import Callable
from importlib import resources
from typing import Any

import tomli_w

from dehyst.models.errors import BadInput, BadModel
from dehyst.models.model import Block, Fit, Hysteresis, Model, Provenance, Validity
from dehyst.models.toml_text import parse_toml
from dehyst.models.units import UNIT_NAMES

FORMAT = 1
MOST_NUMBERS, MOST_BLOCKS = 1000, 64
"""Limits per list and per model: more than any identification finds, few enough for a loop."""
SHIPPED = ("paper-eq11", "paper-eq12")
LEFT_OUT = ("", "0.1.0", "0.2.0")
"""Versions, "" if none is stated, whose models lack `slopes_s_per_v` if all slopes are 0, and
`drive_offset_v` if it is 0. Such a model is read and written as it is, so that its digest stays."""


class _Table:
    """A TOML table that records which of its keys were read."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise BadModel(f"{where}: a table is needed")
        self.data, self.where, self.read = data, where, set[str]()

    def _name(self, key: str) -> str:
        return f"{self.where}.{key}" if self.where else key

    def get(self, key: str, check: Callable[[Any, str], Any], default: Any = ...) -> Any:
        self.read.add(key)
        if key not in self.data:
            if default is ...:
                raise BadModel(f"{self._name(key)}: this key is missing")
            return default
        return check(self.data[key], self._name(key))

    def done(self) -> None:
        unknown = sorted(set(self.data) - self.read)
        if unknown:
            raise BadModel(
                f"{self._name(unknown[0])}: unknown key; known here: {', '.join(sorted(self.read))}"
            )


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise BadModel(f"{name}: a finite number is needed, not {value!r}")
    return float(value)


def _positive(value: Any, name: str) -> float:
    number = _number(value, name)
    if number <= 0:
        raise BadModel(f"{name}: must be greater than 0, not {number:g}")
    return number


def _not_negative(value: Any, name: str) -> float:
    number = _number(value, name)
    if number < 0:
        raise BadModel(f"{name}: must not be negative, not {number:g}")
    return number


def _numbers(value: Any, name: str) -> list[float]:
    if not isinstance(value, list) or not value:
        raise BadModel(f"{name}: a list of numbers is needed")
    if len(value) > MOST_NUMBERS:
        raise BadModel(f"{name}: {len(value)} entries; at most {MOST_NUMBERS} are read")
    return [_number(v, f"{name}[{i}]") for i, v in enumerate(value)]


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str):
        raise BadModel(f"{name}: text is needed, not {value!r}")
    return value


def _one_of(*allowed: str) -> Callable[[Any, str], str]:
    def check(value: Any, name: str) -> str:
        if value not in allowed:
            raise BadModel(f"{name}: one of {', '.join(allowed)} is needed, not {value!r}")
        return str(value)

    return check


def _param(value: Any, name: str) -> float | tuple[float, ...]:
    return tuple(_numbers(value, name)) if isinstance(value, list) else _number(value, name)


def _any(value: Any, name: str) -> Any:
    return value


def loads(text: str) -> Model:
    """Return the model of a TOML text. Raises BadModel, which names the wrong key."""
    try:
        data = parse_toml(text)
    except BadInput as error:
        raise BadModel(str(error)) from None
    top = _Table(data, "")
    version = top.get("format", _number)
    if version != FORMAT:
        raise BadModel(f"format: this dehyst reads format {FORMAT}, the file says {version:g}")
    drive = top.get("drive_unit", _one_of(*UNIT_NAMES))
    disp = top.get("displacement_unit", _one_of(*UNIT_NAMES))
    provenance = _provenance(_Table(top.get("provenance", _any, {}), "provenance"))
    whole = provenance.version not in LEFT_OUT
    model = Model(
        hysteresis=_hysteresis(
            _Table(top.get("hysteresis", _any), "hysteresis"), drive, disp, whole
        ),
        validity=_validity(_Table(top.get("validity", _any), "validity"), drive),
        drive_unit=drive,
        displacement_unit=disp,
        blocks=_blocks(top.get("blocks", _any, []), drive, disp),
        fit=_fit(_Table(top.get("fit", _any, {}), "fit"), disp),
        provenance=provenance,
    )
    top.done()
    return model


def _hysteresis(table: _Table, drive: str, disp: str, whole: bool) -> Hysteresis:
    r = table.get(f"thresholds_{drive}", _numbers)
    b = table.get("weights", _numbers)
    k = table.get(f"slopes_s_per_{drive}", _numbers, ... if whole else [])
    c = table.get(f"saturation_{disp}", _numbers)
    offset = table.get(f"drive_offset_{drive}", _number, ... if whole else 0.0)
    table.done()
    try:
        return Hysteresis(r=r, b=b, k=k, c=c, u_offset=offset)
    except BadModel as error:
        raise BadModel(f"hysteresis: {error}") from None


def _validity(table: _Table, drive: str) -> Validity:
    out = Validity(
        drive_min=table.get(f"drive_min_{drive}", _number),
        drive_max=table.get(f"drive_max_{drive}", _number),
        rate_max=table.get(f"rate_max_{drive}_per_s", _positive, None),
        acceleration_max=table.get(f"acceleration_max_{drive}_per_s2", _positive, None),
        band_hz=table.get("band_hz", _positive, None),
        slowest_s=table.get("slowest_s", _positive, None),
        period_s=table.get("period_s", _positive, None),
    )
    table.done()
    if out.drive_max <= out.drive_min:
        raise BadModel(f"validity.drive_max_{drive}: must be greater than drive_min_{drive}")
    return out


def _fit(table: _Table, disp: str) -> Fit:
    out = Fit(
        rms=table.get(f"rms_{disp}", _not_negative, None),
        holdout_rms=table.get(f"holdout_rms_{disp}", _not_negative, None),
        noise_rms=table.get(f"noise_rms_{disp}", _not_negative, None),
        steady_rms=table.get(f"steady_rms_{disp}", _not_negative, None),
        band=table.get(f"band_{disp}", _not_negative, None),
    )
    table.done()
    return out


def _provenance(table: _Table) -> Provenance:
    raw = table.get("recordings", _any, [])
    if not isinstance(raw, list):
        raise BadModel("provenance.recordings: a list of tables is needed")
    recordings = []
    for i, entry in enumerate(raw):
        one = _Table(entry, f"provenance.recordings[{i}]")
        recordings.append((one.get("name", _text), one.get("sha256", _text)))
        one.done()
    out = Provenance(
        created=table.get("created", _text, ""),
        version=table.get("version", _text, ""),
        source=table.get("source", _text, ""),
        recordings=tuple(recordings),
    )
    table.done()
    return out


def _blocks(raw: Any, drive: str, disp: str) -> tuple[Block, ...]:
    from dehyst.models.physics import check_block  # the registry imports Block from models.model

    if not isinstance(raw, list):
        raise BadModel("blocks: a list of tables ([[blocks]]) is needed")
    if len(raw) > MOST_BLOCKS:
        raise BadModel(f"blocks: {len(raw)} of them; a model has at most {MOST_BLOCKS}")
    out = []
    for i, entry in enumerate(raw):
        table = _Table(entry, f"blocks[{i}]")
        kind = table.get("kind", _text)
        place = table.get("place", _one_of("drive", "stage", "sensor"))
        channel = table.get("channel", _text, "")
        params = {
            key: table.get(key, _param) for key in entry if key not in ("kind", "place", "channel")
        }
        block = Block(kind=kind, place=place, params=params, channel=channel)
        try:
            check_block(block, drive, disp)
        except BadModel as error:
            raise BadModel(f"blocks[{i}]: {error}") from None
        out.append(block)
    return tuple(out)


def dumps(model: Model) -> str:
    """Return the TOML text of a model; loads(dumps(m)) returns m exactly, to the last bit."""
    drive, disp = model.drive_unit, model.displacement_unit
    h, v, f, p = model.hysteresis, model.validity, model.fit, model.provenance
    hysteresis: dict[str, Any] = {
        f"thresholds_{drive}": h.r.tolist(),
        "weights": h.b.tolist(),
        f"saturation_{disp}": h.c.tolist(),
    }
    whole = p.version not in LEFT_OUT
    if whole or not h.static:
        hysteresis[f"slopes_s_per_{drive}"] = h.k.tolist()
    if whole or h.u_offset:
        hysteresis[f"drive_offset_{drive}"] = h.u_offset
    validity = {
        f"drive_min_{drive}": v.drive_min,
        f"drive_max_{drive}": v.drive_max,
        f"rate_max_{drive}_per_s": v.rate_max,
        f"acceleration_max_{drive}_per_s2": v.acceleration_max,
        "band_hz": v.band_hz,
        "slowest_s": v.slowest_s,
        "period_s": v.period_s,
    }
    fit = {
        f"rms_{disp}": f.rms,
        f"holdout_rms_{disp}": f.holdout_rms,
        f"noise_rms_{disp}": f.noise_rms,
        f"steady_rms_{disp}": f.steady_rms,
        f"band_{disp}": f.band,
    }
    provenance: dict[str, Any] = {
        key: text
        for key, text in (("created", p.created), ("version", p.version), ("source", p.source))
        if text
    }
    if p.recordings:
        provenance["recordings"] = [{"name": n, "sha256": s} for n, s in p.recordings]
    data: dict[str, Any] = {
        "format": FORMAT,
        "drive_unit": drive,
        "displacement_unit": disp,
        "hysteresis": hysteresis,
        "validity": {k: v for k, v in validity.items() if v is not None},
        "fit": {k: v for k, v in fit.items() if v is not None},
        "provenance": provenance,
    }
    if model.blocks:
        data["blocks"] = [
            {
                "kind": block.kind,
                "place": block.place,
                **({"channel": block.channel} if block.channel else {}),
                **{k: list(v) if isinstance(v, tuple) else v for k, v in block.params.items()},
            }
            for block in model.blocks
        ]
    return tomli_w.dumps(data)


def shipped(name: str) -> Model:
    """Return one of the paper's models: "paper-eq11" (rate-independent) or "paper-eq12"."""
    if name not in SHIPPED:
        raise BadModel(f"{name}: no such shipped model; there are {', '.join(SHIPPED)}")
    return loads(resources.files("dehyst.models").joinpath(f"{name}.toml").read_text("utf-8"))
