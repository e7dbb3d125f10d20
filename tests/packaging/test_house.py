"""Rules of the code that import-linter cannot check: private names, the clock, empty `__init__`s,
and folders of limited size. Files are read, nothing is imported."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("daemon", "drivers", "models")
FILES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
MOST_FILES = 22
LARGE_BY_NATURE = {"models/physics", "daemon/commands"}
CLOCK = {
    "daemon/clock.py",
    "daemon/loop/systemcalls.py",  # the same clock for compiled code
}
# public in spite of their names: of named tuples, of ctypes structures, of numba's code builder,
# and of argparse, whose parsers can only be read through it (as shtab does)
FOREIGN = {"_exit", "_replace", "_asdict", "_make", "_fields", "_fields_", "_getvalue", "_actions"}
CLOCKS = {
    f"time.{name}"
    for name in ("monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "clock_gettime")
}
MAY_READ_IT = re.compile(r"monotonic|perf_counter|clock_gettime|from time\b")


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def module_of(path: Path) -> tuple[str, ...]:
    """Return ("dehyst", "daemon", "loop", "step") of daemon/loop/step.py; without __init__."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ("dehyst", *(parts[:-1] if parts[-1] == "__init__" else parts))


MODULES = {module_of(path) for path in FILES}


def package_of(module: tuple[str, ...]) -> tuple[str, ...]:
    """Return the package that contains a module; a package contains itself."""
    is_package = any(other[:-1] == module for other in MODULES)
    return module if is_package else module[:-1]


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def imported(tree: ast.Module) -> dict[str, tuple[str, ...]]:
    """Return what each name imported from dehyst is: a module, or a module and a name in it."""
    found: dict[str, tuple[str, ...]] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "dehyst":
            for alias in node.names:
                found[alias.asname or alias.name] = (*str(node.module).split("."), alias.name)
    return found


def own_names(tree: ast.Module) -> set[str]:
    """Return private names that a file itself defines: attributes, methods, fields or functions."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            found.add(node.attr)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    return {name for name in found if private(name)}


def breaches(path: Path) -> list[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    here, known, own = package_of(module_of(path)), imported(tree), own_names(tree)
    found = []
    for name, full in known.items():
        if private(full[-1]) and package_of(full[:-1]) != here:
            found.append(f"{name_of(path)}: imports {'.'.join(full)} as {name}")
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Attribute) and private(node.attr)) or node.attr in FOREIGN:
            continue
        where = f"{name_of(path)}:{node.lineno}: {ast.unparse(node)}"
        base = node.value
        if isinstance(base, ast.Name) and base.id in known:
            full = known[base.id]
            owner = full if full in MODULES else full[:-1]
            if package_of(owner) != here:
                found.append(where)
        elif not (isinstance(base, ast.Name) and base.id in ("self", "cls")) and (
            node.attr not in own and node.attr not in package_names(here)
        ):  # an object whose class is not from this package
            found.append(where)
    return found


def package_names(package: tuple[str, ...]) -> set[str]:
    """Return private names that the files of one folder define."""
    found: set[str] = set()
    for path in FILES:
        if package_of(module_of(path)) == package:
            found |= own_names(ast.parse(path.read_text(encoding="utf-8")))
    return found


def test_no_private_name_is_read_across_packages() -> None:
    found = [text for path in FILES for text in breaches(path)]
    assert not found, "\n".join(found)


def test_the_monotonic_clock_is_read_in_one_place() -> None:
    """Drivers are given a clock; that parameter's default may be time.monotonic, not called."""
    found = []
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        if name_of(path) in CLOCK or not MAY_READ_IT.search(text):  # parsing all takes seconds
            continue
        tree = ast.parse(text)
        called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
        for node in ast.walk(tree):
            plain_name = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            read = plain_name and ast.unparse(node) in CLOCKS
            allowed = name_of(path).startswith("drivers/") and id(node) not in called
            by_name = isinstance(node, ast.ImportFrom) and node.module == "time"
            compiled = isinstance(node, ast.Constant) and node.value == "clock_gettime"
            if (read and not allowed) or by_name or compiled:
                found.append(f"{name_of(path)}:{node.lineno}: {ast.unparse(node)}")
    assert not found, "\n".join(found)


def plain(statement: ast.stmt) -> bool:
    """Return whether it is a docstring, an import, or `__all__`."""
    if isinstance(statement, ast.Expr):
        return isinstance(statement.value, ast.Constant)
    if isinstance(statement, ast.Assign):
        return [ast.unparse(target) for target in statement.targets] == ["__all__"]
    return isinstance(statement, ast.Import | ast.ImportFrom)


@pytest.mark.parametrize(
    "path", [path for path in FILES if path.name == "__init__.py"], ids=name_of
)
def test_package_hands_out_its_face_and_holds_no_logic(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree), "no docstring"
    assert [ast.unparse(s) for s in tree.body if not plain(s)] == []


def test_folders_can_be_looked_through() -> None:
    folders: dict[str, int] = {}
    for path in FILES:
        if path.name != "__init__.py":
            folders[name_of(path.parent)] = folders.get(name_of(path.parent), 0) + 1
    crowded = {f: n for f, n in folders.items() if n > MOST_FILES and f not in LARGE_BY_NATURE}
    assert not crowded


# files of one kind, and the names that each of them must define
FACES = {
    "daemon/commands/*.py": {"configure", "run"},
    "models/physics/*.py": {"solve", "step"},
    "drivers/*/direct_calls.py": {"actuator", "sensor", "read", "write"},
    "drivers/*/channel.py": {"Channel", "fault_of", "vendor"},
    "daemon/api/*.py": {"diagnose", "identify", "load_model", "simulate", "validate"},
}


def test_each_public_name_has_one_meaning() -> None:
    """A public class or function that two files define misleads readers; faces are exempt."""
    homes: dict[str, set[str]] = {}
    for path in FILES:
        faces = {"main", "Tuning"}.union(*(names for at, names in FACES.items() if path.match(at)))
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            named = isinstance(node, ast.FunctionDef | ast.ClassDef) and not private(node.name)
            if named and node.name not in faces:
                homes.setdefault(node.name, set()).add(name_of(path))
    assert {name: files for name, files in homes.items() if len(files) > 1} == {}
