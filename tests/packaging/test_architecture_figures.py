"""The figures of this version in docs/architecture.md are those of the code."""

import re
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path

import grimp
import pytest

from dehyst.models.diagnosis.tuning import TUNING as DIAGNOSIS
from dehyst.models.identify.tuning import TUNING as IDENTIFY

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
APART = 0.02
"""A figure may lag behind the code by this share; a commit need not count the lines again."""

pytestmark = pytest.mark.processes


def figures(row: str) -> list[int]:
    """Return the figures in the last column but the goal's of a row of the page's tables."""
    (cells,) = re.findall(rf"^\| {re.escape(row)} \|(.*)\|$", PAGE, re.M)
    columns = [re.sub(r"(?<=\d) (?=\d{3})", "", cell) for cell in cells.split("|")]
    return [int(number) for number in re.findall(r"\d+", columns[place_of(row)])]


def place_of(row: str) -> int:
    """Return the column that holds this version's figure; that of the goal follows it or not."""
    return 1 if PAGE.index(f"| {row} |") > PAGE.index("| | before | after | goal |") else -1


@cache
def product() -> tuple[Path, ...]:
    command = ["git", "ls-files", "daemon/*.py", "drivers/*.py", "models/*.py"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    if not names:
        pytest.skip("not a git clone: the files of the product are not known")
    return tuple(ROOT / name for name in names.split())


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n")


def close_to(counted: int, power: int = 1) -> object:
    return pytest.approx(counted, rel=power * APART)


def test_files_and_lines() -> None:
    assert figures("files of the product")[-1] == close_to(len(product()))
    assert figures("lines of the product")[-1] == close_to(sum(map(lines, product())))
    assert figures("largest file, lines")[-1] == close_to(max(map(lines, product())))
    folders = Counter(path.parent.relative_to(ROOT) for path in product())
    assert figures("most files in one folder")[0] == max(folders.values())


def test_packages_and_their_arrows() -> None:
    graph = grimp.build_graph("dehyst")
    packages = {name for name in graph.modules if graph.find_children(name)}
    home = {m: m if m in packages else m.rpartition(".")[0] for m in graph.modules}
    uses = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    arrows = {(home[a], home[b]) for a in uses for b in uses[a] if home[a] != home[b]}
    count = len(set(home.values()))
    assert figures("packages")[-1] == close_to(count)
    row = figures("arrows between packages, of those possible")
    assert row == [close_to(len(arrows)), close_to(count * (count - 1), power=2)]
    assert not any(a in uses[b] for a in uses for b in uses[a])


def test_the_diagnosis() -> None:
    own = [path for path in product() if path.is_relative_to(ROOT / "models" / "diagnosis")]
    assert figures("lines")[0] == close_to(sum(map(lines, own)))
    assert figures("constants in its `Tuning`")[0] == len(DIAGNOSIS)
    assert figures("constants of `models/identify`")[0] == len(IDENTIFY)
