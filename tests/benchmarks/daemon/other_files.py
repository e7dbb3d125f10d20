"""Files of other programs and laboratories: how each is read, and what `dehyst identify` says.

    python -m tests.benchmarks.daemon.other_files

It reads every file of $DEHYST_DATA/public-cases, and one of each kind that the program or library
itself writes. It prints a table and its bars; for the exit status see tests/benchmarks/bars.py.
"""

import io
import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.benchmarks.bars import Bars
from tests.benchmarks.models.identify_faults import data_folder
from tests.rigs.other_programs import KINDS, TEXTS

from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.loading import SUFFIXES
from dehyst.daemon.main import main as dehyst

ROOT = Path(__file__).resolve().parents[3]
REFUSED = ("02_butterfly.csv", "03_one_way_ramp.csv", "04_square_friction_loop.csv")
DAMAGED = ("bad-token.npz", "bad-type.npz")
ASKS: Mapping[str, tuple[str, ...]] = {
    "09_labview_lvm_renamed.csv": ("--columns", "u=Voltage_0,y=Voltage_1", "--unit", "um"),
}
"""The options that each file requires before it can be read, as the message names them."""


@dataclass(frozen=True)
class Said:
    """Exit status and output of a command."""

    code: int
    out: str
    err: str

    @property
    def last(self) -> str:
        """Return the last line of a refusal, else the first line of the result."""
        lines = (self.err if self.code else self.out).strip().splitlines()
        return (lines[-1] if self.code else lines[0]) if lines else ""


def run(*words: str) -> Said:
    """Run one command in this process; a library's warning counts as output."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("always")
        try:
            code = dehyst(list(words))
        except SystemExit as end:
            code = int(end.code or 0)
    return Said(code, out.getvalue(), err.getvalue())


def options_of(reading: ReadOptions) -> list[str]:
    """Return the corresponding command-line options."""
    words = []
    if reading.columns:
        words += ["--columns", ",".join(f"{k}={v}" for k, v in reading.columns.items())]
    for option, value in (("--rate", reading.rate_hz), ("--unit", reading.unit)):
        words += [option, str(value)] if value else []
    return words


def made(folder: Path) -> Iterator[tuple[Path, ReadOptions]]:
    """Yield a file of each kind, and the options that it requires."""
    for name, (data, reading) in TEXTS.items():
        (folder / name).write_bytes(data)
        yield folder / name, reading
    for name, (make, reading) in KINDS.items():
        try:
            make(folder / name)
        except pytest.skip.Exception as error:
            print(f"| {name} | not made: {error} |")
            continue
        yield folder / name, reading


def show(path: Path, bars: Bars, folder: Path, options: list[str]) -> None:
    """Print a row of the table, and check that the result is as expected."""
    words = ["identify", str(path), "-o", str(folder / "model.toml"), "--force"]
    if options:
        asked = run(*words)
        bars.add(f"{path.name}: asks", asked.last[:60], "names an option",
                 asked.code == 2 and "--" in asked.last)  # fmt: skip
        print(f"| {path.name} | asks | {asked.last} |", flush=True)
    said = run(*words, *options)
    read = next((line for line in said.err.splitlines() if " rows: " in line), "as it is")
    print(f"| {path.name} {' '.join(options)} | {read} | {said.code}: {said.last} |", flush=True)
    wanted = 2 if path.name in (*REFUSED, *DAMAGED) else 0
    bars.add(f"{path.name}: exit status", str(said.code), str(wanted), said.code == wanted)
    loud = [line for line in said.err.splitlines() if "Warning" in line or "Traceback" in line]
    if loud:
        bars.none(f"{path.name}: warnings of a library", len(loud))


def main() -> int:
    """Print the table."""
    bars, data = Bars(), data_folder(ROOT)
    print("| file | read | said by `dehyst identify` |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if data is None or not (data / "public-cases").is_dir():
            bars.cannot("public cases", "no recordings; set DEHYST_DATA")
        else:
            for path in sorted((data / "public-cases").iterdir()):
                if path.name.endswith(SUFFIXES):
                    show(path, bars, folder, list(ASKS.get(path.name, ())))
        for path, reading in made(folder):
            show(path, bars, folder, options_of(reading))
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
