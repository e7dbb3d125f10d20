"""Does the model that a diagnosis writes predict a drive that it has not seen?

    python -m tests.benchmarks.models.written_model --seed 7 --count 20
    python -m tests.benchmarks.models.written_model --round ../shared/concealed/round-2 --count 8

Stages of the proof have a held-out drive whose displacement is known without noise. Of a round's
stages with three recordings or more, one is kept back in turn with the case's number. Errors are in
rms of the noise, behind the history that fits, about their mean. Ends as tests/benchmarks/bars.py
says: better in 92 % of the stages with a named effect of the drive or the stage; worse by more than
the noise in none; never `explained` with more than 1.5 noises left.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.models.proof.families import COUNTS, plans
from tests.benchmarks.models.proof.score import figures
from tests.benchmarks.models.proof.stages import make_case

from dehyst.daemon.files.recordings import read_recording
from dehyst.models.cascade.history import replay_recording
from dehyst.models.diagnosis import Diagnosis, diagnose
from dehyst.models.recording import Recording

BETTER, NEAR = 0.92, 1.5


@dataclass(frozen=True)
class Row:
    """One stage; in_use, written: what both models leave of the held-out drive [noises], without
    the noise itself."""

    case: str
    verdict: str
    names: tuple[str, ...]
    acts: bool
    in_use: float
    written: float

    def __str__(self) -> str:
        names = ", ".join(self.names) or "-"
        return (
            f"{self.case:12s} {self.verdict:9s} {self.in_use:7.2f} -> {self.written:7.2f}  {names}"
        )


def of_diagnosis(case: str, found: Diagnosis, in_use: float, written: float) -> Row:
    """The row of a case."""
    names = tuple(f.name for f in found.findings)
    acts = any(
        f.place in ("drive", "stage") and f.name not in ("shape", "unknown") for f in found.findings
    )
    return Row(case, found.verdict, names, acts, in_use, written)


def of_proof(seed: int, count: int) -> Iterator[Row]:
    """Stages of the proof."""
    for plan in plans(seed, count, list(COUNTS)):
        case = make_case(plan)
        found = diagnose(case.given(), with_limits=False)
        said = figures(case, found)
        yield of_diagnosis(plan.case, found, said["held_model"], said["held_augmented"])


def of_round(folder: Path, count: int) -> Iterator[Row]:
    """Stages of a round, one recording kept back."""
    for number, path in enumerate(sorted(folder.glob("case-*"))[:count]):
        files = [f for f in sorted(path.glob("*.csv*")) if not f.name.startswith("holdout")]
        given = [read_recording(f, need_displacement=True) for f in files]
        if len(given) < 3:
            continue
        held = given.pop(number % len(given))
        found = diagnose(given, with_limits=False)
        errors = (_error(found, held, model) for model in (found.base_model, found.model))
        yield of_diagnosis(path.name, found, *errors)


def _error(found: Diagnosis, held: Recording, model: object) -> float:
    left = held.displacement - replay_recording(model, held).predicted  # type: ignore[operator, arg-type]
    return float(np.sqrt(max(np.nanvar(left) - found.noise**2, 0.0)) / found.noise)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--round", type=Path, help="folder of case-NN, in place of the proof")
    args = parser.parse_args()
    rows = []
    for row in of_round(args.round, args.count) if args.round else of_proof(args.seed, args.count):
        rows.append(row)
        print(row, flush=True)
    acts = [r for r in rows if r.acts]
    bars = Bars()
    if acts:
        share = sum(r.written < r.in_use for r in acts) / len(acts)
        bars.least(f"better, of {len(acts)} with a named effect", share, BETTER)
    else:
        bars.cannot("better with a named effect", "none was named")
    bars.none(f"worse by more than the noise, of {len(rows)}",
              sum(r.written > r.in_use + 1.0 for r in rows))  # fmt: skip
    bars.none("explained with more than 1.5 noises left",
              sum(r.verdict == "explained" and r.written > NEAR for r in rows))  # fmt: skip
    print(bars.table())
    return bars.code


if __name__ == "__main__":
    sys.exit(main())
