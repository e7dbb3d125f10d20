"""The demo's second act over many seeds, without processes and faster than in real time.

    python -m tests.benchmarks.daemon.second_act_offline [--seeds 30] [--first 1 | --only SEED ...]
                                                         [--model MODEL.toml] [--keep DIR]

The simulated stage, the controller's step, the mismatch watch, the doctor's examination and the
trial are the product's own (tests/rigs/story.py); time is a count of samples, so that a busy
machine changes nothing. No driver, no serial line, no late sample: second_act.py plays it with all
of them. The stage has no RC corner, no mode of 780 Hz and no filter of the bridge, which end within
a sample and would cost most of the time; and the diagnosis omits exclusion limits, on which no
figure here depends. --model: one that a first act has identified, which leaves a larger residual of
the stage than the simulated stage's own. The bars are those of second_act.py.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.benchmarks.bars import Bars
from tests.benchmarks.daemon.second_act import judge, row, table_head
from tests.rigs.story import OfflineStory

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.demo.chance import Chance
from dehyst.daemon.demo.second_act import BEFORE_S, FLAG_S, LAST_S, LEARN_S, TRIAL_S, Story
from dehyst.daemon.files.models import load_model
from dehyst.models.diagnosis import steps
from dehyst.models.model import Model

DOCTOR_S = 20.0  # duration of the doctor's work, in the stage's time


def tell_story(folder: Path, model: Model, seed: int) -> dict[str, Any]:
    """Play one seed; return the facts as second_act.describe_facts does."""
    chance = Chance(seed, "")
    facts: dict[str, Any] = {
        "seed": seed, "drawn": "", "flagged_after_s": None, "named": [], "ambiguous_with": [],
        "named_right": False, "state": "", "rms_um": {}, "missed": 0, "samples": 1, "why": "",
    }  # fmt: skip
    with OfflineStory(folder, model, seed) as story:
        if not story.until(story.learned, 3.0 * LEARN_S + 60.0):
            return facts | {"why": "the watch did not learn the stage in time"}
        story.wait(chance.wait_s)
        drawn = chance.drawn()
        facts |= {"drawn": drawn.name, "drawn_says": drawn.says}
        appeared_s, early = story.now_s, story.watch.mismatch
        facts["rms_um"]["before"] = story.rms(appeared_s - BEFORE_S, appeared_s)
        story.rig.stage.change(**drawn.stage)
        if not story.until(lambda: story.watch.mismatch, FLAG_S):
            facts["rms_um"]["during"] = story.rms(appeared_s + 1.0, story.now_s)
            return facts | {"why": f"the watch flagged nothing within {FLAG_S:g} s"}
        facts["flagged_after_s"] = -1.0 if early else story.now_s - appeared_s
        facts["figure"] = story.watch.figure
        _examine(story, facts, appeared_s)
    return facts


def _examine(story: OfflineStory, facts: dict[str, Any], appeared_s: float) -> None:
    """Examine from the flag to the end."""
    if not story.until(lambda: story.open_case() is not None, 120.0):
        facts["why"] = "no case was kept"
        return
    folder = story.open_case()
    assert folder is not None
    began = time.monotonic()
    found = story.examine(folder)
    facts["examined_s"] = time.monotonic() - began
    reported = Story(drawn=facts["drawn"])
    facts["says"], facts["verdict"] = found.says, found.verdict
    facts["named"] = [e.name for e in found.effects]
    facts["shares"] = [e.share for e in found.effects]
    facts["named_right"] = reported.says_right(found.effects)
    story.wait(DOCTOR_S)
    facts["rms_um"]["during"] = story.rms(appeared_s + 1.0, story.now_s)
    if found.tested is None:
        facts["why"] = "no model is offered"
        return
    facts["blocks"] = list(found.tested.blocks)
    accepted_s = story.now_s
    facts["state"], facts["why"] = story.accept(folder, TRIAL_S)
    if facts["state"] == "accepted":
        story.wait(max(0.0, accepted_s + 4.0 + LAST_S - story.now_s))
        facts["why"] = ""
        facts["rms_um"]["after"] = story.rms(story.now_s - LAST_S, story.now_s)


def count_clean(folder: Path, model: Model, seed: int, seconds: float) -> int:
    """Count the flags of a stage that does not change."""
    with OfflineStory(folder, model, seed) as story:
        story.until(story.learned, 3.0 * LEARN_S + 60.0)
        story.wait(seconds)
        return sum(one.code == "mismatch" for one in story.events)


def main() -> int:
    """Play, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="+", metavar="SEED", help="these")
    parser.add_argument("--model", type=Path, help="the model in use")
    parser.add_argument("--keep", type=Path, help="the cases of all seeds, for a closer look")
    parser.add_argument("--json", type=Path, help="the facts of each seed")
    parser.add_argument("--clean", type=float, default=0.0, metavar="S", help="nothing changes")
    args = parser.parse_args()
    steps.limits = lambda *_: ()  # see the module docstring
    model = load_model(args.model) if args.model else simulated_model()
    bars, stories = Bars(), []
    if args.clean:
        with tempfile.TemporaryDirectory(prefix="dehyst-act-") as scratch:
            seeds = range(args.first, args.first + args.seeds)
            flags = [count_clean(Path(scratch) / str(k), model, k, args.clean) for k in seeds]
        bars.none(f"flags in {args.seeds} times {args.clean:g} s in order", sum(flags))
        return bars.end()
    print(table_head(), flush=True)
    with tempfile.TemporaryDirectory(prefix="dehyst-act-") as scratch:
        for seed in args.only or range(args.first, args.first + args.seeds):
            facts = tell_story((args.keep or Path(scratch)) / str(seed), model, seed)
            stories.append(facts)
            print(row(facts), flush=True)
            if args.json:
                args.json.write_text(json.dumps(stories, indent=1))
    judge(stories, bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
