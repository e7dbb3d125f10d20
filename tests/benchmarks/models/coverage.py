"""Check that the 95 % interval holds on other rates and waveforms than those identified from.

    python -m tests.benchmarks.models.coverage [--only PART ...] [--stages 40] [--two]

It identifies a model from one recording of a stage and counts the rows of every other recording of
the same stage that are within its interval. With --two it also identifies from the last recording
(for the proof from the last but one, because the last is held back). Rows to which the interval
does not apply (outside the validity, or slower than any recorded drive) are counted separately.
Recordings and opened rounds are read from $DEHYST_DATA.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.models.identify_faults import data_folder
from tests.benchmarks.models.proof.families import plans
from tests.benchmarks.models.proof.stages import make_case

from dehyst.daemon.files.recordings import read_recording
from dehyst.models.cascade.figures import describe
from dehyst.models.errors import DehystError
from dehyst.models.identify import identify
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Recording

ROOT = Path(__file__).resolve().parents[3]
LEAST, MOST = 0.85, 0.99  # share of the rows within, and of the pairs that meet it:
SHARE = 0.9
SEED = 4300  # of the proof's stages; nothing was calibrated on these
Case = tuple[str, Recording, list[Recording]]


def part(one: Recording, begin: float, end: float) -> Recording:
    """Return the rows from one share of a recording to another."""
    assert one.displacement is not None
    rows = slice(round(begin * one.size), round(end * one.size))
    return replace(
        one, t_s=one.t_s[rows], drive=one.drive[rows], displacement=one.displacement[rows],
        channels={k: v[rows] for k, v in one.channels.items()}, sha256="",
        name=f"{one.name} from {begin:.0%}",
    )  # fmt: skip


def real(data: Path, stages: int) -> Iterator[Case]:
    """Yield the measured recordings; the two parts of stack-am are without and with an inverse."""
    names = ("stack-1hz", "stack-am", "afm-triangle-a", "afm-triangle-b", "afm-hold", "lightsheet")
    by = {name: read_recording(data / "recordings" / f"{name}.csv") for name in names}
    without, inverse = part(by["stack-am"], 0.0, 0.45), part(by["stack-am"], 0.45, 1.0)
    slow, a, b, hold, sheet = (by[n] for n in names if n != "stack-am")
    yield "stack-1hz", slow, [without, inverse]
    yield "stack-am", without, [inverse, slow]
    yield "afm-triangle-a", a, [b, hold]
    yield "afm-triangle-b", b, [a, hold]
    yield "lightsheet", part(sheet, 0.0, 0.6), [part(sheet, 0.6, 1.0)]


def round_1(data: Path, stages: int) -> Iterator[Case]:
    """Yield the first opened round."""
    for folder in sorted((data / "concealed" / "round-1").glob("case-*")):
        one, *others = (read_recording(folder / f"{n}.csv") for n in ("identify", "check", "hold"))
        yield f"1/{folder.name}", one, others


def round_2(data: Path, stages: int) -> Iterator[Case]:
    """Yield the second opened round; half of a single recording is no other waveform."""
    for folder in sorted((data / "concealed" / "round-2").glob("case-*")):
        one, *others = (read_recording(p) for p in sorted(folder.glob("recording-*")))
        if others:
            yield f"2/{folder.name}", one, others


def proof(data: Path | None, stages: int) -> Iterator[Case]:
    """Yield stages of the proof, with their held-out recording."""
    for plan in plans(SEED, stages):
        case = make_case(plan)
        one, *others = (case.recording(name) for name in case.tables)
        yield plan.case, one, others


PARTS = {"real": real, "round-1": round_1, "round-2": round_2, "proof": proof}


def measure(cases: Iterator[Case], name: str, bars: Bars, two: bool) -> list[float]:
    """Print a row for each model, and the bars of this part; return shares of rows within."""
    shares: list[float] = []
    unstated, pairs, wide = [], 0, 0
    for case, one, others in cases:
        given = [one]
        if two:
            at = -2 if name == "proof" else -1
            if len(others) < 2:
                continue
            given.append(others.pop(at))
        try:
            model = identify(given).model
        except DehystError as error:
            print(f"| {case} | refused: {str(error)[:90]} | | |", flush=True)
            continue
        stroke, band = describe(model).stroke, model.fit.band
        wide += band is not None and band > stroke
        said = []
        for other in others:
            try:
                found = validate(model, other)
            except DehystError as error:
                said.append(str(error)[:60])
                continue
            pairs += 1
            unstated.append(found.unstated)
            if found.within is not None:
                shares.append(found.within)
            within = "nothing said" if found.within is None else f"{found.within:.1%}"
            said.append(f"{within} ({found.unstated:.0%} unstated)")
        width = "none" if band is None else f"{band / stroke:.2%}"
        print(f"| {case} | {width} | {'; '.join(said)} |", flush=True)
    good = sum(LEAST <= share <= MOST for share in shares)
    below, above = sum(s < LEAST for s in shares), sum(s > MOST for s in shares)
    print(f"{name}: {pairs} pairs, {len(shares)} judged, {good} between {LEAST:.0%} and "
          f"{MOST:.0%}, {below} below, {above} above; rows unstated "
          f"{np.mean(unstated) if unstated else 0:.0%}", flush=True)  # fmt: skip
    bars.none(f"{name}: intervals wider than the stroke", wide)
    return shares


def main() -> int:
    """Run the named parts, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=[*PARTS], default=[*PARTS], help="these parts")
    parser.add_argument("--stages", type=int, default=40)
    parser.add_argument("--two", action="store_true")
    args = parser.parse_args()
    bars, data, shares = Bars(), data_folder(ROOT), []
    print(
        "| stage | half-width, of the stroke | rows within, each other recording |\n|---|---|---|"
    )
    for name in args.only:
        if data is None and name != "proof":
            bars.cannot(name, "no recordings; set DEHYST_DATA")
            continue
        cases = PARTS[name](data, args.stages)  # type: ignore[operator]
        shares += measure(cases, name, bars, args.two)
    good = sum(LEAST <= share <= MOST for share in shares)
    bars.least(f"recordings of {len(shares)} judged with {LEAST:.0%} to {MOST:.0%} within, %",
               100.0 * good / max(1, len(shares)), 100.0 * SHARE)  # fmt: skip
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
