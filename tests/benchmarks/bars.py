"""Bars of a benchmark: what was measured, the required limit, and the exit status of the run.

A benchmark ends with 0 if all its bars are met, with 1 if one is missed, and with 77 if one could
not be judged (a tool is missing, the machine was too busy) and none is missed. Test runners
interpret 77 as "skipped": nothing is proven either way.
"""

import os
from dataclasses import dataclass, field

HELD, MISSED, NOT_JUDGED = 0, 1, 77
WORDS = {True: "held", False: "MISSED", None: "not judged"}


@dataclass(frozen=True)
class Bar:
    """One line of the table; held: None if it could not be judged, with the reason in `why`."""

    name: str
    figure: str
    bar: str
    held: bool | None
    why: str = ""


@dataclass
class Bars:
    """The bars of one run."""

    rows: list[Bar] = field(default_factory=list)

    def most(self, name: str, figure: float, bar: float, unit: str = "") -> None:
        """Require a figure not above the bar (NaN fails)."""
        self.add(name, f"{figure:.4g} {unit}", f"at most {bar:.4g} {unit}", figure <= bar)

    def least(self, name: str, figure: float, bar: float, unit: str = "") -> None:
        """Require a figure not below the bar (NaN fails)."""
        self.add(name, f"{figure:.4g} {unit}", f"at least {bar:.4g} {unit}", figure >= bar)

    def none(self, name: str, count: int) -> None:
        """Require that there are none of these."""
        self.add(name, str(count), "none", count == 0)

    def add(self, name: str, figure: str, bar: str, held: bool) -> None:
        """Add any other bar, already judged."""
        self.rows.append(Bar(name, figure.strip(), bar.strip(), bool(held)))

    def cannot(self, name: str, why: str) -> None:
        """Add a bar that could not be judged."""
        self.rows.append(Bar(name, "-", "-", None, why))

    @property
    def code(self) -> int:
        """Return the exit status."""
        held = {row.held for row in self.rows}
        if False in held:
            return MISSED
        return NOT_JUDGED if None in held or not self.rows else HELD

    def table(self) -> str:
        """Return the rows and, last, the result in words."""
        rows = [("bar", "measured", "must be", "")]
        rows += [(r.name, r.figure, r.bar, f"{WORDS[r.held]}  {r.why}".strip()) for r in self.rows]
        wide = [max(len(row[i]) for row in rows) for i in range(3)]
        lines = [
            f"{a:{wide[0]}}  {b:>{wide[1]}}  {c:{wide[2]}}  {d}".rstrip() for a, b, c, d in rows
        ]
        count = {held: sum(r.held is held for r in self.rows) for held in WORDS}
        if not self.rows:
            end = "not judged: no bar belongs to what was run"
        elif count[False]:
            end = f"{count[False]} of {len(self.rows)} bars missed"
        elif count[None]:
            rest = ", the others held" if count[True] else ""
            end = f"{count[None]} of {len(self.rows)} bars could not be judged{rest}"
        else:
            end = f"all {len(self.rows)} bars held"
        return "\n".join([*lines, end])

    def end(self) -> int:
        """Print the table; return the exit status."""
        print(f"\n{self.table()}", flush=True)
        return self.code


def too_busy(most: float = 0.5) -> str:
    """Return why times measured now would be meaningless, "" if they would not: judged by the load
    of the last minute per processor, before the benchmark itself runs."""
    load, count = os.getloadavg()[0], len(os.sched_getaffinity(0))
    if load <= most * count:
        return ""
    return f"the machine is busy: load average {load:.1f} on {count} processors"
