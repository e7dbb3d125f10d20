"""Does the model that a diagnosis writes predict a drive that it has not seen?

    python -m tests.benchmarks.models.written_model --seed 7 --count 20
    python -m tests.benchmarks.models.written_model --rigs --seed 7 --count 24
    python -m tests.benchmarks.models.written_model --round ../shared/concealed/round-2
    python -m tests.benchmarks.models.written_model --rigs --seed 7 --first 12 --keep rigs.jsonl

Stages of the proof and of the rigs (servos, recorders as hardware has them) have a held-out drive
whose displacement is known without noise. Of a round's stages one recording is kept back, in turn
with the case's number. Errors are in rms of the noise, as `dehyst simulate` has them, about their
mean. With --keep each case is a line of that file, and the bars are of all its lines. Ends as
tests/benchmarks/bars.py says: better in 92 % of the stages with a named effect of the drive or the
stage; worse by more than the noise in none; never `explained` with more than 1.5 noises left; the
rms that is stated within 1 % of that of the written model.
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
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.models.proof.families import COUNTS, plans
from tests.benchmarks.models.proof.score import figures, truth_of
from tests.benchmarks.models.proof.stages import make_case
from tests.rigs.hardware_stages import make_rig

from dehyst.daemon.api.prediction import predict
from dehyst.daemon.files.recordings import read_recording
from dehyst.models.diagnosis import Diagnosis, diagnose
from dehyst.models.modelfile import dumps, loads
from dehyst.models.recording import Recording

BETTER, NEAR, SAME = 0.92, 1.5, 0.01


@dataclass(frozen=True)
class Row:
    """One stage; hidden: what acts there; acts: whether a finding acts on the drive or the stage;
    in_use, written: what both models leave of the held-out drive [noises], without the noise;
    stated: largest factor between an rms that is stated and that of the model simulated."""

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
        """By more than the noise."""
        return self.written > self.in_use + 1.0

    def __str__(self) -> str:
        names, hidden = (", ".join(some) or "-" for some in (self.names, self.hidden))
        return (
            f"{self.case:14s} {self.verdict:9s} {self.in_use:7.2f} -> {self.written:7.2f} "
            f"{'WORSE' if self.worse else '     '} stated {self.stated:5.3f}  "
            f"{hidden} | {names}  {self.seconds:.0f} s"
        )


def of_diagnosis(
    case: str,
    hidden: tuple[str, ...],
    given: list[Recording],
    errors: Any,
) -> Row:
    """The row of a case. errors(found): what both models leave of the held-out drive [noises]."""
    begun = time.perf_counter()
    found = diagnose(given, with_limits=False)
    seconds = time.perf_counter() - begun
    acts = any(
        f.place in ("drive", "stage") and f.name not in ("shape", "unknown") for f in found.findings
    )
    names = tuple(f.name for f in found.findings)
    in_use, written = errors(found)
    stated = _disagreement(found, given)
    return Row(case, hidden, found.verdict, names, acts, in_use, written, stated, seconds)


def of_proof(seed: int, first: int, count: int) -> Iterator[Row]:
    """Stages of the proof."""
    for plan in plans(seed, first + count, list(COUNTS))[first:]:
        case = make_case(plan)

        def errors(found: Diagnosis) -> tuple[float, float]:
            said = figures(case, found)  # noqa: B023
            return said["held_model"], said["held_augmented"]

        hidden = tuple(h.name for h in truth_of(case).hidden)
        yield of_diagnosis(plan.case, hidden, case.given(), errors)


def of_rigs(seed: int, first: int, count: int) -> Iterator[Row]:
    """Stages under servos and behind recorders as hardware has them."""
    for number in range(first, first + count):
        case = make_rig(seed, number)
        yield of_diagnosis(
            case.name,
            case.hidden,
            case.given,
            lambda f: _errors(f, case.held, case.noise, 0.0),  # noqa: B023
        )


def of_round(folder: Path, first: int, count: int) -> Iterator[Row]:
    """Stages of a round, one recording kept back that the others reach as far as."""
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
        yield of_diagnosis(
            path.name,
            tuple(true["effects"]),
            given,
            lambda f: _errors(f, held, noise, noise),  # noqa: B023
        )


def _within(one: Recording, others: list[Recording]) -> bool:
    """Whether others go where its drive does."""
    low, high = (f([f(r.drive) for r in others]) for f in (np.nanmin, np.nanmax))
    room = 0.05 * (high - low)
    return bool(np.nanmin(one.drive) >= low - room and np.nanmax(one.drive) <= high + room)


def _errors(found: Diagnosis, held: Recording, noise: float, in_it: float) -> tuple[float, float]:
    """in_it: noise in the recording that is held out."""
    left = [held.displacement - predict(m, held).displacement  # type: ignore[operator]
            for m in (found.base_model, found.model)]  # fmt: skip
    one, other = (float(np.sqrt(max(np.nanvar(x) - in_it**2, 0.0)) / noise) for x in left)
    return one, other


def _disagreement(found: Diagnosis, given: list[Recording]) -> float:
    worst = 1.0
    for kind, model in (("model", found.base_model), ("augmented", found.model)):
        written = loads(dumps(model))
        for view, one in zip(found.views, given, strict=True):
            left = one.displacement - predict(written, one).displacement  # type: ignore[operator]
            ratio = float(np.nanstd(left[view.held_out])) / max(found.rms[kind][view.name], 1e-12)
            worst = max(worst, ratio, 1.0 / max(ratio, 1e-12))
    return worst


def bars_of(rows: list[Row]) -> Bars:
    """The bars."""
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
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--rigs", action="store_true", help="servos and recorders, not the proof")
    parser.add_argument("--round", type=Path, help="folder of case-NN, in place of the proof")
    parser.add_argument("--keep", type=Path, help="file to which a line is added for each case")
    args = parser.parse_args()
    if args.round:
        found = of_round(args.round, args.first, args.count)
    else:
        found = (of_rigs if args.rigs else of_proof)(args.seed, args.first, args.count)
    rows = []
    for row in found:
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
