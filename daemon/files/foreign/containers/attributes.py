"""Read what libraries keep as attributes or properties of a dataset, a group or a channel."""

import math
from typing import Any

import numpy as np

from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.found import text_of
from dehyst.daemon.files.foreign.units import TIME, UNITS, find_unit_key

UNIT_ATTRIBUTES = (
    "unit", "units", "Unit", "Units", "unit_string", "UNIT", "NI_UnitDescription",
)  # fmt: skip
OF_LIBRARIES = ("MATLAB_", "DIMENSION_", "NI_", "wf_", "_")
"""Prefixes of the attributes that libraries write for their own use."""
LONGEST_TEXT = 4000


def remarks(name: str, attributes: Any) -> dict[str, str]:
    """Return the single texts and numbers in attributes, except those of the library and of MATLAB;
    a unit in them may be that of a column."""
    found = {}
    for given, value in attributes.items():
        one, key = _single(value), text_of(given)
        if key in UNIT_ATTRIBUTES or key.isupper() or key.startswith(OF_LIBRARIES):
            continue
        if isinstance(one, str | bytes | int | float | np.number):
            said = text_of(one) if isinstance(one, str | bytes) else str(one)
            found[name + key] = said[:200]
    return found


def _single(value: Any) -> Any:
    """Return the only value of a list of one, as some libraries write an attribute."""
    one = isinstance(value, np.ndarray) and value.size == 1
    return value.reshape(-1)[0] if one else value


def text_in(attributes: Any, *names: str) -> str:
    """Return the first of these attributes that is a text, "" if none is. "N." is how pandas writes
    None."""
    for name in names:
        value = _single(attributes.get(name))
        if isinstance(value, str | bytes) and (text := text_of(value)) != "N.":
            return text[:LONGEST_TEXT]
    return ""


def unit_in(attributes: Any) -> str:
    return text_in(attributes, *UNIT_ATTRIBUTES)[:40]


def _number_in(attributes: Any, *names: str) -> float | None:
    """Return the first of these attributes that is a single number, None if none is."""
    for name in names:
        value = np.asarray(attributes.get(name, ""))
        if value.size == 1 and value.dtype.kind in "iuf":
            return float(value.reshape(-1)[0])
        number = number_of(text_in(attributes, name))  # written as a text
        if number is not None and math.isfinite(number):
            return number
    return None


def as_scaled(attributes: Any, values: Any) -> tuple[str, Any]:
    """Return (unit, values) of a dataset as the CF conventions unpack it: `_FillValue` is missing,
    and the rest times `scale_factor` plus `add_offset`; `_Unsigned` numbers were written with a
    sign, because the format had no others."""
    unit = unit_in(attributes)
    if values.dtype.kind not in "iuf":
        return unit, values
    missing = [_number_in(attributes, name) for name in ("_FillValue", "missing_value")]
    if values.dtype.kind == "i" and text_in(attributes, "_Unsigned").lower() == "true":
        values = values.view(values.dtype.str.replace("i", "u"))
        missing = [m if m is None else m % 2.0 ** (8 * values.dtype.itemsize) for m in missing]
    factor, offset = (_number_in(attributes, name) for name in ("scale_factor", "add_offset"))
    known = [value for value in missing if value is not None and np.any(values == value)]
    if known or factor is not None or offset is not None:
        lost = np.isin(values, known)
        values = values * (1.0 if factor is None else factor) + (offset or 0.0)
        values[lost] = np.nan
    return unit, values


def wave_in(properties: Any, first: Any) -> tuple[float, float] | None:
    """Return (beginning, period) [s] of a waveform, None for any other channel. first: the earliest
    moment at which one begins, from which the others are counted."""
    step = properties.get("wf_increment", 0.0)
    along = str(properties.get("wf_xunit_string", "") or "s")
    kind, _, factor = UNITS.get(find_unit_key(along), ("", "", 0.0))
    if kind != TIME or not isinstance(step, float | int) or not 0 < step < 1e6:
        return None
    moment = moment_in(properties)
    later = 0.0 if moment is None else float((moment - first) / np.timedelta64(1, "ns")) / 1e9
    return factor * float(properties.get("wf_start_offset", 0.0)) + later, factor * float(step)


def moment_in(properties: Any) -> Any:
    """Return the moment at which a waveform begins, None if it states none."""
    moment = properties.get("wf_start_time")
    return moment if isinstance(moment, np.datetime64) and not np.isnat(moment) else None
