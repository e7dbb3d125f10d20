"""Units as people read them."""


def pick_unit(unit: str, size: float) -> tuple[float, str]:
    """(factor, unit) in which errors of this size are shown: nanometres below a micrometre."""
    return (1e3, "nm") if unit == "um" and size < 1.0 else (1.0, unit)


def spell_unit(unit: str) -> str:
    """A unit as it is written: the columns' v is V, um stays."""
    return "V" + unit[1:] if unit == "v" or unit.startswith("v/") else unit.replace("/v", "/V")
