"""Check that the model that a diagnosis writes predicts a held-out recording of a round.

    python -m tests.benchmarks.models.written_model ../shared/concealed/round-2

One recording of each stage is held out, chosen in turn by the number of the case; the proof has
separate recordings for that. Errors are in rms of the noise, as computed by `dehyst simulate`,
about their mean. With --keep, each case is a line of that file, and the bars cover all its lines.
For the exit status see tests/benchmarks/bars.py. Bars: better in 92 % of the stages with a named
effect of the drive or the stage; worse by more than the noise in none; never `explained` with more
than 1.5 noises left; the stated rms within 1 % of that of the written model.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import count as numbers
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.models.proof.hardware import figures

from dehyst.daemon.files.recordings import read_recording
from dehyst.models.diagnosis import diagnose
from dehyst.models.recording import Recording

BETTER, NEAR, SAME = 0.92, 1.5, 0.01


@dataclass(frozen=True)
class Row:
    """One stage. hidden: the effects in it; acts: whether a finding acts on the drive or the stage;
    in_use, written: residuals of both models on the held-out drive [noises], without the noise;
    stated: largest factor between a reported rms and that of the model simulated."""

    case: str
    hidden: tuple[str, ...]
    verdict: str
    names: tuple[str, ...]
    acts: bool
    in_use: float
    written: float
    stated: float
    seconds: float

    @property
    def worse(self) -> bool:
        """Whether the written model is worse by more than the noise."""
        return self.written > self.in_use + 1.0

    def __str__(self) -> str:
        names, hidden = (", ".join(some) or "-" for some in (self.names, self.hidden))
        return (
            f"{self.case:14s} {self.verdict:9s} {self.in_use:7.2f} -> {self.written:7.2f} "
            f"{'WORSE' if self.worse else '     '} stated {self.stated:5.3f}  "
            f"{hidden} | {names}  {self.seconds:.0f} s"
        )


def of_round(folder: Path, first: int, count: int) -> Iterator[Row]:
    """Yield stages of a round; the held-out recording is within the reach of the others."""
    truth = json.loads((folder / "truth.json").read_text())
    paths = sorted(folder.glob("case-*"))
    for number, path in list(zip(numbers(), paths, strict=False))[first : first + count]:
        files = [f for f in sorted(path.glob("*.csv*")) if not f.name.startswith("holdout")]
        given = [read_recording(f, need_displacement=True) for f in files]
        if len(given) < 2:
            continue
        inside = [k for k, one in enumerate(given) if _within(one, given[:k] + given[k + 1 :])]
        if not inside:
            continue
        held = given.pop(inside[number % len(inside)])
        true = truth[path.name]
        noise = true.get("noise") or true["noise_um"]
        begun = time.perf_counter()
        found = diagnose(given, with_limits=False)
        seconds = time.perf_counter() - begun
        acts = any(
            f.place in ("drive", "stage") and f.name not in ("shape", "unknown")
            for f in found.findings
        )
        said = figures(given, held, noise, noise, found)
        yield Row(
            path.name,
            tuple(true["effects"]),
            found.verdict,
            tuple(f.name for f in found.findings),
            acts,
            said["held_model"],
            said["held_augmented"],
            said["disagrees"],
            seconds,
        )


def _within(one: Recording, others: list[Recording]) -> bool:
    """Return whether the drives of the others cover its drive."""
    low, high = (f([f(r.drive) for r in others]) for f in (np.nanmin, np.nanmax))
    room = 0.05 * (high - low)
    return bool(np.nanmin(one.drive) >= low - room and np.nanmax(one.drive) <= high + room)


def bars_of(rows: list[Row]) -> Bars:
    """Return the bars."""
    acts = [r for r in rows if r.acts]
    bars = Bars()
    if acts:
        share = sum(r.written < r.in_use for r in acts) / len(acts)
        bars.least(f"better, of {len(acts)} with a named effect", share, BETTER)
    else:
        bars.cannot("better with a named effect", "none was named")
    bars.none(f"worse by more than the noise, of {len(rows)}", sum(r.worse for r in rows))
    bars.none(
        "explained with more than 1.5 noises left",
        sum(r.verdict == "explained" and r.written > NEAR for r in rows),
    )
    bars.none("explained where nothing was gained",
              sum(r.verdict == "explained" and r.written >= r.in_use for r in rows))  # fmt: skip
    bars.most("rms stated over rms simulated", max(r.stated for r in rows), 1.0 + SAME)
    return bars


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("round", type=Path, help="folder of case-NN with its truth.json")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--keep", type=Path, help="file to which a line is added for each case")
    args = parser.parse_args()
    rows = []
    for row in of_round(args.round, args.first, args.count):
        rows.append(row)
        print(row, flush=True)
        if args.keep:
            with args.keep.open("a") as file:
                file.write(json.dumps(asdict(row)) + "\n")
    if args.keep and args.keep.exists():
        rows = [Row(**json.loads(line)) for line in args.keep.read_text().splitlines()]
    print(bars_of(rows).table())
    return bars_of(rows).code


if __name__ == "__main__":
    sys.exit(main())
