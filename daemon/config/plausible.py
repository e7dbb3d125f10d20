"""The largest drives and displacements that any stage has: a number beyond these is a slip."""

from collections.abc import Sequence

from dehyst.models.errors import BadInput
from dehyst.models.units import spell_unit

MOST = {"v": 10e3, "um": 1e6, "nm": 1e9, "mrad": 7e3, "urad": 7e6, "counts": 2.0**32}
"""Largest magnitude by unit: amplifiers for piezo stages end at a few kV, stages at a few mm (a
metre leaves room), an angle at one turn, and a converter's counts at 32 bits."""


def check_plausible(option: str, values: Sequence[float], unit: str) -> None:
    """Raise BadInput, which names the option, if a value is beyond any stage's and amplifier's.
    unit: a key of MOST."""
    most = MOST[unit]
    if any(abs(value) > most for value in values):
        given = " ".join(f"{value:g}" for value in values)
        raise BadInput(
            f"{option} {given}: no stage or amplifier goes beyond {most:g} {spell_unit(unit)}; "
            "give the limits of yours"
        )
