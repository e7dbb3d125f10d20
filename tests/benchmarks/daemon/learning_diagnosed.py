"""Check that trim and learning do not change what the diagnosis finds in a recording.

    python -m tests.benchmarks.daemon.learning_diagnosed [--seeds N] [--first SEED]
        [--effects creep ...] [--kept FILE]

It simulates creep, a resonance and a lag of the sensor on the simulated stage. The model is the
hysteresis alone, identified from an open-loop drive of the same stage: with the lag, which
identification finds, there would be nothing to report. The diagnosis gets that recording and one of
24 s of tracking, made in three ways. The bar is that the effect is named first; if the recording
without trim and learning does not show it, the other two are not judged. Exclusion limits are
skipped: they name nothing, and take half of the time. A case takes minutes: finished cases are
stored in FILE, and another run with it continues from there. Exit status: see
tests/benchmarks/bars.py.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.daemon.loop_closed import (
    TRIALS,
    Trial,
    exploring,
    run,
    stage_with,
    surroundings,
    trajectory,
)
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.scans import PERIOD_S, scan
from tests.rigs.trimmed_stage import TrimmedStage

from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.identify import Options, identify
from dehyst.models.model import Floats, Model
from dehyst.models.recording import Recording

WAYS = ("feed-forward", "trim", "learning")
CHOSEN = [t for t in TRIALS if t.name in ("creep", "resonance", "lag of the sensor")]


def recording_of(rig: TrimmedStage, name: str) -> Recording:
    """Return a recording as `dehyst record` writes it: the drive in force at each reading."""
    records = rig.telemetry
    drive = np.concatenate([[0.0], records["volts"][:-1]])
    channels = {
        "target_um": records["target"],
        "trim_um": records["trim"],
        "learned_um": records["learned"],
    }
    return Recording(
        PERIOD_S * np.arange(records.size), drive, records["measured"], channels=channels, name=name
    )


def passes(seed: int) -> Floats:
    """Return three seconds of sines with whole periods."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(3000)
    waves = [np.sin(2 * np.pi * (n * t / 3.0 + rng.random())) / n**0.5 for n in (1, 3, 8, 19, 34)]
    wave = np.sum(waves, axis=0)
    return 8.0 + 4.5 * wave / np.abs(wave).max()


def tracked(model: Model, settings: StageSettings, way: str, seed: int) -> Recording:
    """Return 24 s of tracking, made in one of the ways."""
    if way == "learning":
        rig = scan(model, passes(seed), 8, settings).rig
        assert rig is not None
    else:
        rig = TrimmedStage(model, settings, trim=way == "trim")
        rig.play(trajectory(seed + 100))
    return recording_of(rig, f"{way}.csv")


def names_of(trial: Trial, seed: int) -> dict[str, list[str]]:
    """Return the names found, by way."""
    drive = exploring(seed)
    plain = run(stage_with(trial, seed), drive, surroundings(drive.size, seed), None)
    first = Recording(plain.t_s, plain.volts, plain.reading_um, name="identify.csv")
    model = replace(identify([first], Options(rate=False)).model, blocks=())
    settings, out = stage_with(trial, seed).settings, {}
    for way in WAYS:
        begun = time.process_time()
        found = diagnose_without_limits([first, tracked(model, settings, way, seed)], model)
        out[way] = [one.name for one in found.findings]
        text = f"{found.verdict} {out[way]} ({time.process_time() - begun:.0f} s)"
        print(f"{trial.name} {seed} {way}: {text}", flush=True)
    return out


def judge(trial: Trial, cases: Mapping[int, Mapping[str, list[str]]], bars: Bars) -> str:
    """Add the bars of one effect; return its row of the table. cases: names by seed and way."""
    named = {
        way: {seed for seed, of in cases.items() if of[way] and of[way][0] in trial.expected}
        for way in WAYS
    }
    shown, every = named[WAYS[0]], f"of {len(cases)}"
    for way in WAYS[1:]:
        name = f"{trial.name}, {way}"
        if shown:
            bars.least(name, len(named[way]), len(shown), every)
        else:
            bars.cannot(name, "the recording without trim and learning does not show it either")
    counts = "".join(f"{f'{len(named[way])} {every}':>16s}" for way in WAYS)
    hidden = sorted(cases.keys() - shown)
    return f"{trial.name:24s}{counts}" + (f"   not shown without: {hidden}" if hidden else "")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="seed of the first case")
    parser.add_argument("--effects", nargs="+", default=[one.name for one in CHOSEN])
    parser.add_argument("--kept", type=Path, help="cases that have run, by effect and seed (JSON)")
    args = parser.parse_args()
    bars = Bars()
    kept = json.loads(args.kept.read_text()) if args.kept and args.kept.exists() else {}
    table = [f"{'named first':24s}" + "".join(f"{way:>16s}" for way in WAYS)]
    for trial in (one for one in CHOSEN if one.name in args.effects):
        cases = {}
        for seed in range(args.first, args.first + args.seeds):
            key = f"{trial.name} {seed}"
            kept[key] = cases[seed] = kept.get(key) or names_of(trial, seed)
            if args.kept:
                args.kept.write_text(json.dumps(kept, indent=1))
        table.append(judge(trial, cases, bars))
    print("\n" + "\n".join(table))
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
