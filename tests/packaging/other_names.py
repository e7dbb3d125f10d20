"""Which modules and names of the standard library another operating system lacks.

They are taken from typeshed, which comes with mypy: its stubs say by `if sys.platform == ...` which
system has what.
"""

import ast
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mypy

STUBS = Path(mypy.__file__).parent / "typeshed" / "stdlib"
OF_UNIX = ("fcntl", "resource", "termios", "tty", "pty", "pwd", "grp", "syslog")
"""Modules that Windows does not have at all."""
LOOKED_AT = ("os", "signal", "socket", "select", "time", "mmap", *OF_UNIX)


@cache
def names(module: str, platform: str) -> frozenset[str]:
    """Return the names that a module has on "linux", "darwin" or "win32"."""
    path = STUBS / f"{module}.pyi"
    path = path if path.exists() else STUBS / module / "__init__.pyi"
    system = SimpleNamespace(platform=platform, version_info=sys.version_info)
    found: set[str] = set()

    def walk(statements: list[Any]) -> None:
        for one in statements:
            if isinstance(one, ast.If):
                known = {"sys": system, "TYPE_CHECKING": True}
                condition = eval(compile(ast.Expression(one.test), module, "eval"), known)
                walk(one.body if condition else one.orelse)
            elif isinstance(one, ast.FunctionDef | ast.ClassDef):
                found.add(one.name)
            elif isinstance(one, ast.AnnAssign):
                found.add(ast.unparse(one.target))
            elif isinstance(one, ast.Assign):
                found.update(ast.unparse(target) for target in one.targets)
            elif isinstance(one, ast.ImportFrom):
                found.update(alias.asname or alias.name for alias in one.names)

    walk(ast.parse(path.read_text(encoding="utf-8")).body)
    return frozenset(found)


def missing(platform: str) -> dict[str, list[str]]:
    """Return the names by module that Linux has and this system does not."""
    return {m: sorted(names(m, "linux") - names(m, platform)) for m in LOOKED_AT}
