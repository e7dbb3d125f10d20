"""What a named change of the code is, and where it is applied: a copy of the tree of its own."""

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

    name: unique; file: in which, from the project's top; old: its text, found there exactly once;
    new: what takes its place; does: one sentence, what it would do to the stage or to the user;
    tests: what pytest is given: files, or single tests; survives: why no test need notice it.
    """

    name: str
    file: str
    old: str
    new: str
    does: str
    tests: tuple[str, ...] = ()
    survives: str = ""

    def changed(self, text: str) -> str:
        """The file's text with the change. Raises ValueError where it cannot be applied."""
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
    """Changes that these tests should notice where they name none of their own."""
    return [one if one.tests else Change(**(vars(one) | {"tests": tests})) for one in changes]


def copy_project(to: Path) -> Path:
    """The files that git knows or would add, and the compiled kernels beside them."""
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
    """The same files by hard links: what Python, numba and `put` write anew replaces a link and
    leaves the base alone. So no kernel of one change is ever run by another."""
    shutil.copytree(base, to, symlinks=True, copy_function=_link)
    return to


def _link(source: str, target: str) -> str:
    os.link(source, target, follow_symlinks=False)
    return target


def put(tree: Path, change: Change) -> None:
    """Apply it. The new time of the file makes tests/conftest.py drop every kernel that was
    compiled from it, in whatever file that kernel is."""
    path = tree / change.file
    text = change.changed(path.read_text(encoding="utf-8"))
    fresh = path.with_suffix(".new")
    fresh.write_text(text, encoding="utf-8")
    fresh.replace(path)
