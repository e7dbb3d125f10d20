"""Read the lines above the numbers in which each channel has a label and a value, as TwinCAT's
Scope writes them: "Name,fDrive,Name,fGauge" over a column of times for each channel."""

import re
from collections.abc import Sequence

HEAD = 60
_STEP = re.compile(r"SampleTime\s*\[(\w+)\]")


def name_pairs(lines: list[str]) -> None:
    """Put one line of names, with their units, in place of such lines; leave others as they are."""
    for mark in (",", ";", "\t"):
        labelled = {
            i: cells for i, line in enumerate(lines[:HEAD]) if (cells := _paired(line, mark))
        }
        of = {cells[0]: cells[1::2] for cells in labelled.values()}
        step = next(filter(None, map(_STEP.fullmatch, of)), None)
        names, units = of.get("Name", []), of.get("Unit", [])
        if step is None or not names or {len(values) for values in of.values()} != {len(names)}:
            continue
        kept = [cells for cells in labelled.values() if _scales(cells)]
        notes = [mark.join([f"Scale factor ({cells[0]})", *cells[1::2]]) for cells in kept]
        for i in labelled:
            lines[i] = notes.pop() if notes else ""
        whole = [f"{n} [{u}]" for n, u in zip(names, units or [""] * len(names), strict=True)]
        lines[max(labelled)] = mark.join(
            f"Time [{step[1]}]{mark}{name.removesuffix(' []')}" for name in whole
        )


def _scales(cells: Sequence[str]) -> bool:
    """Return whether a line states a factor, or an offset other than 0."""
    label = cells[0].lower()
    return "scale" in label or ("offset" in label and any(v.strip("+-0.") for v in cells[1::2]))


def _paired(line: str, mark: str) -> Sequence[str]:
    """Return the fields of a line that repeats one label before each value, () of any other."""
    cells = [cell.strip() for cell in line.split(mark)]
    alike = len(cells) > 3 and len(cells) % 2 == 0 and len(set(cells[::2])) == 1
    return cells if alike and cells[0][:1].isalpha() else ()
