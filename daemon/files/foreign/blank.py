"""Refuse a file whose column for the drive or the displacement holds no number."""

from collections.abc import Mapping, Sequence

from dehyst.daemon.files.foreign.fields import marks_in
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import NAMES, kind_of, role_of
from dehyst.daemon.files.foreign.units import ANGLE, LENGTH, VOLTAGE, find_unit_key
from dehyst.models.errors import BadRecording


def refuse_blank(
    name: str,
    found: Sheet,
    columns: Sequence[Column],
    chosen: Mapping[str, int],
    reading: ReadOptions,
) -> None:
    """Raise BadRecording if a column without a number says more plainly than the one that is chosen
    that it is the drive or the displacement."""
    for role in ("u", "y"):
        taken = [columns[i] for one, i in chosen.items() if one == role]
        least = max(
            (_plainness(c.heading, find_unit_key(c.unit)) for c in taken), default=(0, False)
        )
        blank = [h for h in found.blank if role_of(h, "")[0] == role and _plainness(h, "") > least]
        if blank and role not in reading.columns:
            text = found.blank[blank[0]][:20]
            why = (
                f"(the first field is '{text}'{marks_in(text)}): write each field as a number "
                "alone, all in one unit and with one decimal mark"
                if text
                else ": if its fields are formulas, open the file in the spreadsheet program and "
                "save it there with their values"
            )
            raise BadRecording(
                f"{name}: '{blank[0][:40]}' holds no number{' ' * bool(text)}{why}; if another "
                f"column is the {NAMES[role]}, add --columns {role}=..."
            )


def _plainness(heading: str, unit: str) -> tuple[int, bool]:
    """Return how plainly a column says its role: by its name, and by a unit of that role."""
    role, sure = role_of(heading, unit)
    return sure, kind_of(heading, unit) in ((VOLTAGE,) if role == "u" else (LENGTH, ANGLE))
