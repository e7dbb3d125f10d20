"""Physics is declared: no attribute of a candidate exists for one physics alone, and nothing
outside of `models/physics` decides by a physics' name."""

import ast
from collections.abc import Iterator
from pathlib import Path

from dehyst.models.physics import KINDS, PHYSICS
from dehyst.models.physics.registry import FRAME

ROOT = Path(__file__).parents[2]
ROOM = ROOT / "models/physics"
# names with a second meaning: a place, a column, the base's own finding, a field
OTHERWISE = {"sensor", "rate", "shape", "memory"}
NAMES = {one.name for one in PHYSICS.values()} | set(KINDS) | set(PHYSICS)
NAMES -= OTHERWISE


def declared(tree: ast.AST) -> Iterator[str]:
    """Yield the attributes that the classes of a file set, in their body or on self."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            for one in node.body:
                if isinstance(one, ast.Assign | ast.AnnAssign):
                    targets = one.targets if isinstance(one, ast.Assign) else [one.target]
                    yield from (t.id for t in targets if isinstance(t, ast.Name))
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield from [node.attr] * (ast.unparse(node.value) == "self")


def test_no_attribute_of_a_candidate_is_set_by_one_physics_alone() -> None:
    frame = ast.parse((ROOM / "candidate.py").read_text(encoding="utf-8"))
    base = next(n for n in frame.body if isinstance(n, ast.ClassDef) and n.name == "Candidate")
    files: dict[str, set[str]] = {name: set() for name in declared(base)}
    assert {"driven", "late", "slow"} <= files.keys()
    for path in ROOM.glob("*.py"):
        if path.stem not in FRAME:
            for name in declared(ast.parse(path.read_text(encoding="utf-8"))):
                files.get(name, set()).add(path.stem)
    assert {name: by for name, by in files.items() if len(by) < 2} == {}


def test_nothing_else_knows_a_physics_by_name() -> None:
    found = []
    for room in ("models", "daemon/doctor"):
        for path in sorted((ROOT / room).rglob("*.py")):
            if path.is_relative_to(ROOM):
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                text = node.value if isinstance(node, ast.Constant) else None
                if isinstance(text, str) and (text in NAMES or text.split("-")[0] in NAMES):
                    found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {text}")
    assert not found, "\n".join(found)
