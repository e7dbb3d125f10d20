"""Record what a set-up has done: one JSON file in its folder, written after every step."""

import json
from datetime import datetime
from pathlib import Path
from typing import Any

from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import report_failures
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.models.errors import BadInput

NAME = "setup.json"
FORMAT = 1
LARGEST_BYTES = 1 << 20  # a journal has a few kB


class Journal:
    """The finished steps by name, in order, each with its time, options and result."""

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
        """Return True if the step is done."""
        return step in self._steps

    def when(self, step: str) -> str:
        """Return the date and time at which the step was done."""
        return str(self._steps[step]["done"])

    def options(self, step: str) -> dict[str, Any]:
        """Return the options with which the step was done."""
        return dict(self._steps[step]["options"])

    def result(self, step: str) -> dict[str, Any]:
        """Return the step's result."""
        return dict(self._steps[step]["result"])

    def keep(self, step: str, options: dict[str, Any], result: dict[str, Any]) -> None:
        """Record a step as done. Raises BadInput if the file cannot be written."""
        done = datetime.now().isoformat(sep=" ", timespec="seconds")
        self._steps[step] = {"done": done, "options": options, "result": result}
        self._write()

    def forget(self, steps: list[str]) -> None:
        """Remove these steps, so that they are done again."""
        if any(step in self._steps for step in steps):
            self._steps = {k: v for k, v in self._steps.items() if k not in steps}
            self._write()

    def _write(self) -> None:
        text = json.dumps({"format": FORMAT, "steps": self._steps}, indent=1, allow_nan=False)
        with report_failures(self._path):
            write_text(self._path, text + "\n")
