"""Define a named change of the code, and apply it to a copy of the tree."""

import ast
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Change:
    """One mistake that somebody could make.

    name: unique; file: path from the project's root; old: text that occurs in the file exactly
    once; new: its replacement; does: one sentence on the effect on the stage or the user; tests:
    arguments for pytest: files, or single tests; survives: why no test needs to notice it.
    """

    name: str
    file: str
    old: str
    new: str
    does: str
    tests: tuple[str, ...] = ()
    survives: str = ""

    def changed(self, text: str) -> str:
        """Return the file's text with the change. Raises ValueError if it cannot be applied."""
        count = text.count(self.old)
        if count != 1:
            times = "is no longer there" if count == 0 else f"is there {count} times"
            raise ValueError(f"{self.name}: in {self.file} the old text {times}: {self.old!r}")
        out = text.replace(self.old, self.new)
        try:
            if self.file.endswith(".py"):
                ast.parse(out)
        except SyntaxError as error:
            raise ValueError(f"{self.name}: {self.file} would not be Python: {error}") from None
        return out


def room(tests: tuple[str, ...], *changes: Change) -> list[Change]:
    """Return the changes, with these tests for those that name none."""
    return [one if one.tests else Change(**(vars(one) | {"tests": tests})) for one in changes]


def copy_project(to: Path) -> Path:
    """Copy the files that git tracks or would add, and the compiled kernels next to them."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True, text=True,
    ).stdout.split("\0")  # fmt: skip
    names = {name for name in listed if name and os.path.lexists(ROOT / name)}
    for folder in ("models", "drivers", "daemon"):
        kernels = (ROOT / folder).rglob("__pycache__/*.nb[ic]")
        names |= {str(path.relative_to(ROOT)) for path in kernels}
    for name in sorted(names):
        target = to / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target, follow_symlinks=False)
    return to


def link_tree(base: Path, to: Path) -> Path:
    """Copy the tree as hard links: files that Python, numba and `put` rewrite replace a link and
    leave the base unchanged, so no kernel of one change is ever run by another."""
    shutil.copytree(base, to, symlinks=True, copy_function=_link)
    return to


def _link(source: str, target: str) -> str:
    os.link(source, target, follow_symlinks=False)
    return target


def put(tree: Path, change: Change) -> None:
    """Apply the change. The new modification time of the file makes tests/conftest.py delete every
    kernel that was compiled from it, in whatever file that kernel is."""
    path = tree / change.file
    text = change.changed(path.read_text(encoding="utf-8"))
    fresh = path.with_suffix(".new")
    fresh.write_text(text, encoding="utf-8")
    fresh.replace(path)
