"""The units of models and recordings, and sizes, units and counts in readable form."""

UNIT_NAMES = ("v", "um", "nm", "counts", "mrad", "urad")
"""The units of drive and displacement, as in the names of columns and keys."""


def pick_unit(unit: str, size: float) -> tuple[float, str]:
    """Return (factor, unit) for showing errors of this size: nanometres below a micrometre."""
    return (1e3, "nm") if unit == "um" and size < 1.0 else (1.0, unit)


def spell_unit(unit: str) -> str:
    """Return a unit as it is written in text: the columns' v becomes V, um stays."""
    return "V" + unit[1:] if unit == "v" or unit.startswith("v/") else unit.replace("/v", "/V")


def spell_size(value: float, unit: str) -> str:
    """Format a value to three digits in a suitable unit: 1.81 ms, 13.3 nm, 1910 V/s."""
    if unit == "s" and abs(value) < 1.0:
        value, unit = (1e3 * value, "ms") if abs(value) >= 1e-3 else (1e6 * value, "us")
    elif unit == "um" and abs(value) < 1.0:
        value, unit = 1e3 * value, "nm"
    text = f"{value:.3g}"
    if "e+" in text and abs(value) < 1e6:
        text = f"{float(text):.0f}"
    return text if unit == "1" else f"{text} {spell_unit(unit)}"


def how_many(count: int, one: str, many: str = "") -> str:
    """Return a count with its noun: how_many(2, "row") is "2 rows". many: the plural, where it is
    not formed with an s."""
    return f"{count} {one}" if count == 1 else f"{count} {many or one + 's'}"
