"""Bars of a benchmark: what was measured, what it must keep, and how the run ends.

A benchmark ends with 0 where all its bars are held, with 1 where one is missed, and with 77 where
one could not be judged (a tool is missing, the machine was too busy) and none is missed. 77 is the
code that test runners take for "skipped": nothing is proven either way.
"""

import os
from dataclasses import dataclass, field

HELD, MISSED, NOT_JUDGED = 0, 1, 77
WORDS = {True: "held", False: "MISSED", None: "not judged"}


@dataclass(frozen=True)
class Bar:
    """One line of the table; held: None where it could not be judged, and `why` says it."""

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
        """The figure must not be above the bar (NaN is above)."""
        self.add(name, f"{figure:.4g} {unit}", f"at most {bar:.4g} {unit}", figure <= bar)

    def least(self, name: str, figure: float, bar: float, unit: str = "") -> None:
        """The figure must not be below the bar (NaN is below)."""
        self.add(name, f"{figure:.4g} {unit}", f"at least {bar:.4g} {unit}", figure >= bar)

    def none(self, name: str, count: int) -> None:
        """There must be none of these."""
        self.add(name, str(count), "none", count == 0)

    def add(self, name: str, figure: str, bar: str, held: bool) -> None:
        """Any other bar, already judged."""
        self.rows.append(Bar(name, figure.strip(), bar.strip(), bool(held)))

    def cannot(self, name: str, why: str) -> None:
        """This bar could not be judged."""
        self.rows.append(Bar(name, "-", "-", None, why))

    @property
    def code(self) -> int:
        """Exit status."""
        held = {row.held for row in self.rows}
        if False in held:
            return MISSED
        return NOT_JUDGED if None in held or not self.rows else HELD

    def table(self) -> str:
        """The rows and, last, how it ended, in words."""
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
        """Print the table; the exit status."""
        print(f"\n{self.table()}", flush=True)
        return self.code


def too_busy(most: float = 0.5) -> str:
    """Why times measured now would say nothing, "" where they would: the load of the last minute
    for each processor, before the benchmark itself runs."""
    load, count = os.getloadavg()[0], len(os.sched_getaffinity(0))
    if load <= most * count:
        return ""
    return f"the machine is busy: load average {load:.1f} on {count} processors"
