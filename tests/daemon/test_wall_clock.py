"""The wall clock labels records and file names; no decision depends on it."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WALL = {"time", "time_ns", "now", "utcnow", "today", "fromtimestamp", "wall_ns", "ctime"}
# files that make records and lines for people; each reading in them is checked below
LABELLING = {"status.py", "process.py", "core.py", "event_log.py"}
OWNERS = {"time", "datetime", "clock", "date"}


def readings(path: Path) -> list[int]:
    """Return the lines on which a wall clock is read."""
    lines = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        owner = node.func.value
        name = owner.id if isinstance(owner, ast.Name) else getattr(owner, "attr", "")
        if node.func.attr in WALL and name in OWNERS:
            lines.append(node.lineno)
    return lines


def test_the_loop_and_its_rules_never_read_the_wall_clock() -> None:
    deciding = [
        *(
            path
            for room in ("loop", "rings", "service")
            for path in (ROOT / "daemon" / room).rglob("*.py")
            if path.name not in LABELLING
        ),
        *(
            ROOT / "daemon" / f"{name}.py"
            for name in (
                "gateway/admission",
                "gateway/lease",
                "gateway/command_intake",
                "gateway/core_rings",
                "files/recorder",
                "client/player",
            )
        ),
    ]
    for path in deciding:
        assert readings(path) == [], path
    for folder in ("drivers", "models"):
        for path in (ROOT / folder).rglob("*.py"):
            assert readings(path) == [], path


def test_where_the_wall_clock_is_read_it_is_a_label() -> None:
    """In the daemon, every line that reads the wall clock makes a label."""
    labels = ("wall", "now", "started", "created", "stamp", "datetime", "strftime")
    for path in (ROOT / "daemon").rglob("*.py"):
        lines = path.read_text().splitlines()
        for number in readings(path):
            if path.name == "clock.py":
                continue
            assert any(word in lines[number - 1] for word in labels), (path, lines[number - 1])
