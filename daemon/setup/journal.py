"""What a set-up has done so far: one JSON file in its folder, written after every step."""

import json
from datetime import datetime
from pathlib import Path
from typing import Any

from dehyst.daemon.files.models import write_text
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.models.errors import BadInput

NAME = "setup.json"
FORMAT = 1
LARGEST_BYTES = 1 << 20


class Journal:
    """Steps by name, in the order in which they were done: when, with which options, the result."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._steps: dict[str, dict[str, Any]] = {}
        if self._path.exists():
            self._steps = self._read()

    def _read(self) -> dict[str, dict[str, Any]]:
        try:
            table = json.loads(read_text(self._path, LARGEST_BYTES))
        except (NotReadable, ValueError) as error:
            raise BadInput(
                f"{self._path}: it cannot be read: {error}; delete it to start again"
            ) from None
        steps = table.get("steps") if isinstance(table, dict) else None
        whole = isinstance(steps, dict) and all(
            isinstance(one, dict) and {"done", "options", "result"} <= one.keys()
            for one in steps.values()
        )
        if not whole or table.get("format") != FORMAT:
            raise BadInput(f"{self._path}: it is not a set-up's record; delete it to start again")
        assert isinstance(steps, dict)
        return steps

    def done(self, step: str) -> bool:
        """Was it done?"""
        return step in self._steps

    def when(self, step: str) -> str:
        """Date and time at which it was."""
        return str(self._steps[step]["done"])

    def options(self, step: str) -> dict[str, Any]:
        """The options that it was done with."""
        return dict(self._steps[step]["options"])

    def result(self, step: str) -> dict[str, Any]:
        """What came of it."""
        return dict(self._steps[step]["result"])

    def keep(self, step: str, options: dict[str, Any], result: dict[str, Any]) -> None:
        """Write down that it is done. Raises BadInput where that cannot be written."""
        done = datetime.now().isoformat(sep=" ", timespec="seconds")
        self._steps[step] = {"done": done, "options": options, "result": result}
        self._write()

    def forget(self, steps: list[str]) -> None:
        """These are to be done again."""
        if any(step in self._steps for step in steps):
            self._steps = {k: v for k, v in self._steps.items() if k not in steps}
            self._write()

    def _write(self) -> None:
        text = json.dumps({"format": FORMAT, "steps": self._steps}, indent=1, allow_nan=False)
        try:
            write_text(self._path, text + "\n")
        except OSError as error:
            raise BadInput(f"{self._path}: cannot be written: {error.strerror or error}") from None
