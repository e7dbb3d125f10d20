"""What identification reports for recordings outside its class, ordinary ones, and one or two
rates.

    python -m tests.benchmarks.models.outside [--only PART ...] [--number 40]

It prints a table and its bars; the exit status is 0 or 1, see tests/benchmarks/bars.py.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator

from tests.benchmarks.bars import Bars
from tests.benchmarks.models.proof.families import FAMILIES, plans
from tests.benchmarks.models.proof.stages import make_case
from tests.rigs.outside import beside_drift, lagged, linear, ordinary, outside

from dehyst.models.errors import BadRecording
from dehyst.models.identify import Identification, identify
from dehyst.models.recording import Recording

ORDINARY = 60
LEAST_LAGS = 0.95
LEAST_BESIDE = 0.9  # one period shows a lag only where it is more than what the drift hides
SEED = 4400  # of the proof's stages


def found_in(recordings: list[Recording], what: str) -> Identification | None:
    """Return what is identified; None if it is refused, with a row that gives the reason."""
    try:
        return identify(recordings)
    except BadRecording as error:
        print(f"| {what} | refused: {str(error)[:140]} |", flush=True)
        return None


def without(bars: Bars, number: int) -> None:
    """Kinds outside the class: none is accepted; one without hysteresis is, and is named."""
    kinds = outside()
    accepted = [kind for kind, one in kinds.items() if found_in([one], kind) is not None]
    bars.none(f"accepted of {len(kinds)} kinds outside of the class", len(accepted))
    found = found_in([linear()], "linear")
    named = found is not None and any("no hysteresis" in note for note in found.notes)
    bars.add("a stage without hysteresis", "taken and named" if named else "not so", "so", named)


def _count_refused(recordings: Iterable[Recording]) -> int:
    return sum(found_in([one], one.name) is None for one in recordings)


def inside(bars: Bars, number: int) -> None:
    """Ordinary recordings of stages with 8 to 25 % hysteresis."""
    refused = _count_refused(ordinary(seed) for seed in range(ORDINARY))
    bars.none(f"refused of {ORDINARY} ordinary recordings", refused)


def proof(bars: Bars, number: int) -> None:
    """The first recording of stages of the proof, except those outside its class."""
    families = [family for family in FAMILIES if family != "outside"]

    def made() -> Iterator[Recording]:
        for plan in plans(SEED, ORDINARY, families):
            case = make_case(plan)
            yield case.recording(next(iter(case.tables)))

    bars.none(f"refused of {ORDINARY} recordings of the proof", _count_refused(made()))


def slow(bars: Bars, number: int) -> None:
    """Static stages recorded by one slow loop; every other one is read through a lag, which a
    single rate cannot reveal."""
    given = 0
    for seed in range(number):
        found = found_in(lagged(seed, (1.0,), 0.02 * (seed % 4 > 1)), f"one loop {seed}")
        given += found is None or found.shape.rate or bool(found.model.blocks)
    bars.none(f"given dynamics or refused of {number} recorded by one slow loop", given)


def lags(bars: Bars, number: int) -> None:
    """Stages with a lag of 10 to 30 ms recorded at two rates."""
    named = 0
    for seed in range(number):
        found = found_in(lagged(seed, (0.5, 4.0), 0.01 + 0.02 * (seed % 3) / 2), f"lag {seed}")
        named += found is not None and any(b.kind in ("lag", "delay") for b in found.model.blocks)
    bars.least(f"of {number} with a lag at two rates, given one", named, LEAST_LAGS * number)


def drifting(bars: Bars, number: int) -> None:
    """Drives of one period and several sizes, with drift, creep and steps."""
    given = named = 0
    for seed in range(number):
        still = found_in([beside_drift(seed, 0.0)], f"drift {seed}")
        given += still is None or still.shape.rate or bool(still.model.blocks)
        late = found_in([beside_drift(seed, 0.02)], f"lag and drift {seed}")
        named += late is not None and (late.shape.rate or bool(late.model.blocks))
    bars.none(f"given dynamics or refused of {number} of one period with a drift", given)
    bars.least(f"of {number} with a lag and a drift, given dynamics", named, LEAST_BESIDE * number)


PARTS = {
    "outside": without,
    "ordinary": inside,
    "proof": proof,
    "slow": slow,
    "lags": lags,
    "drifting": drifting,
}


def main() -> int:
    """Run the parts named on the command line, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=[*PARTS], default=[*PARTS], help="these parts")
    parser.add_argument("--number", type=int, default=40)
    args = parser.parse_args()
    bars = Bars()
    print("| recording | said |\n|---|---|")
    for name in args.only:
        PARTS[name](bars, args.number)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
