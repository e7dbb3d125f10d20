"""The demo's second act over many seeds: flag, name and compensate an effect, keep no wrong model.

    python -m tests.benchmarks.daemon.second_act [--seeds 30] [--first 1] [--only SEED ...]
                                                 [--busy CORES] [--json FILE] [--keep DIR]

The first act (recording and model) is played once. Each seed has a bench, a daemon and a doctor of
its own, and takes about three minutes of real time; among thirty seeds each effect that can be
drawn has at least three. Bars: no seed ends with 1, and on an otherwise idle machine (no --busy)
none with 77; flagged within 10 s of motion in 28 of 30, named right first in 26, error after
acceptance at most 1.3 times that before the effect in 24, a wrong model kept in none (a model is
wrong if it was accepted and proven, but the error is not below that with the effect). --busy: keeps
this number of processors busy at the same time.
"""

import argparse
import itertools
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.benchmarks.bars import Bars, too_busy

from dehyst.daemon.demo.busy import IT_WAS_NOT, SO_IT_WAS, TOO_BUSY
from dehyst.daemon.demo.chance import EFFECTS, Chance
from dehyst.daemon.demo.demo import Demo
from dehyst.daemon.demo.second_act import Story, describe_facts
from dehyst.models.errors import DehystError

FLAGGED, NAMED, BETTER = 28 / 30, 26 / 30, 24 / 30
FLAG_S, TIMES = 10.0, 1.3
LEAST_OF_TEN = 1
"""Minimum number of seeds of each effect among ten."""


def quiet(_text: str) -> None:
    """The story is not printed."""


def choose_seeds(count: int, first: int) -> list[int]:
    """Return consecutive seeds from `first` on, skipping those that would leave no room for effects
    that have too few."""
    needed = dict.fromkeys(EFFECTS, LEAST_OF_TEN * count // 10)
    seeds: list[int] = []
    for seed in itertools.count(first):
        if len(seeds) == count:
            return seeds
        name = Chance(seed, "").drawn().name
        if needed[name] > 0:
            needed[name] -= 1
        elif count - len(seeds) <= sum(needed.values()):
            continue
        seeds.append(seed)
    return seeds


@contextmanager
def kept_busy(cores: int) -> Iterator[None]:
    """Run this many processes that compute endlessly."""
    spins = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(cores)]
    try:
        yield
    finally:
        for one in spins:
            one.kill()
            one.wait()


def first_act(output: Path) -> None:
    """Make recording.csv and model.toml."""
    with tempfile.TemporaryDirectory(prefix="dehyst-act-") as folder:
        demo = Demo(Path(folder), output, quiet)
        try:
            demo.excite_and_record(lambda _share: None)
            demo.identify()
        finally:
            demo.close()


def play(output: Path, seed: int, keep: Path | None) -> Story:
    """Play one seed. keep: folder for its cases."""
    with tempfile.TemporaryDirectory(prefix="dehyst-act-") as folder:
        kept = Path(folder) / "output"
        kept.mkdir()
        shutil.copy(output / "model.toml", kept)
        bench = Path(folder) / "bench"
        bench.mkdir()
        demo = Demo(bench, kept, quiet)
        try:
            return demo.second_act(seed)
        finally:
            demo.close()
            if keep is not None:
                for case in bench.glob("*/mismatch/*.case"):
                    shutil.copytree(case, keep / str(seed) / case.name, dirs_exist_ok=True)


def row(facts: dict[str, Any]) -> str:
    """Return a row of the table."""
    flagged, rms = facts["flagged_after_s"], facts["rms_um"]
    after = "-" if flagged is None else f"{flagged:.1f}"
    nm = [f"{1e3 * (rms.get(k) or 0.0):7.0f}" for k in ("before", "during", "after")]
    return (
        f"{facts['seed']:5d}  {facts['drawn']:10} {after:>5} "
        f"{', '.join(facts['named'][:2]) or '-':22} "
        f"{'yes' if facts['named_right'] else 'no':4}"
        f"{facts['state'] or '-':9}{''.join(nm)}  {facts['missed']:5d} "
        f"{facts.get('exit', '-')!s:>4}  {facts['why'][-80:]}"
    )


def table_head() -> str:
    """Return the head of the table."""
    return (
        f"{'seed':>5}  {'drawn':10} {'flag':>5} {'named':22} right{'state':9}"
        f"{'before':>7}{'with':>7}{'after':>7}  missed exit  (errors in nm rms)"
    )


def judge(stories: list[dict[str, Any]], bars: Bars) -> None:
    """Judge the bars on the facts of these seeds."""
    count = max(1, len(stories))
    flagged = [f for f in stories if (f["flagged_after_s"] or 1e9) <= FLAG_S]
    named = [f for f in stories if f["named_right"]]
    proven = [f for f in stories if f["state"] == "accepted"]
    better = [f for f in proven if f["rms_um"]["after"] <= TIMES * f["rms_um"]["before"]]
    wrong = [f for f in proven if f["rms_um"]["after"] >= f["rms_um"]["during"]]
    bars.least("flagged within 10 s of motion", 100 * len(flagged) / count, 100 * FLAGGED, "%")
    bars.least("named right first", 100 * len(named) / count, 100 * NAMED, "%")
    bars.least("after, at most 1.3 times before", 100 * len(better) / count, 100 * BETTER, "%")
    bars.none("wrong model kept", len(wrong))


def main() -> int:
    """Play, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="+", metavar="SEED", help="these")
    parser.add_argument("--busy", type=int, default=0, metavar="CORES", help="kept busy beside it")
    parser.add_argument("--json", type=Path, help="the facts of each seed")
    parser.add_argument("--keep", type=Path, help="the cases of all seeds, for a closer look")
    args = parser.parse_args()
    seeds = args.only or choose_seeds(args.seeds, args.first)
    busy, bars = too_busy(), Bars()
    stories: list[dict[str, Any]] = []
    print(table_head())
    with tempfile.TemporaryDirectory(prefix="dehyst-act-") as folder:
        first_act(Path(folder))
        for seed in seeds:
            try:
                with kept_busy(args.busy):
                    facts = describe_facts(play(Path(folder), seed, args.keep))
            except DehystError as error:
                print(f"{seed:5d}  not played: {error}", flush=True)
                continue
            stories.append(facts)
            print(row(facts), flush=True)
            if args.json:
                args.json.write_text(json.dumps(stories, indent=1))
    judged = [f for f in stories if f["exit"] != TOO_BUSY]
    for code, words in ((SO_IT_WAS, "so it was"), (IT_WAS_NOT, "it was not"), (TOO_BUSY, "busy")):
        print(f"exit {code} ({words}): {sum(f['exit'] == code for f in stories)} of {len(stories)}")
    if busy or len(judged) < len(stories):
        print(f"{len(stories) - len(judged)} of {len(stories)} not judged: too busy. {busy}")
    bars.none("ended with 1", sum(f["exit"] == IT_WAS_NOT for f in stories))
    if not args.busy:
        bars.none("not played, or ended with 77", len(seeds) - len(judged))
    judge(judged, bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
