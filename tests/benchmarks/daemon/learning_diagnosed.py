"""Does the diagnosis find in a recording made with trim, or while learning, what it finds in one
without?

    python -m tests.benchmarks.daemon.learning_diagnosed [--seeds N] [--first SEED]
        [--effects creep ...]

Creep, a resonance and a lag of the sensor on the simulated stage. The model is the hysteresis
alone, identified from an open-loop drive of the same stage: with the lag, which identification
finds, there would be nothing to tell. The diagnosis gets that recording and one of 24 s of
tracking, made three ways. Judged is whether the effect is named first. What would have been seen is
not asked: it names nothing, and takes half of the time.
"""

import argparse
import sys
import time
from dataclasses import replace

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.daemon.loop_closed import (
    TRIALS,
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
    """As `dehyst record` writes it: the drive in force at each reading."""
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
    """Three seconds of sines that fit into them."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(3000)
    waves = [np.sin(2 * np.pi * (n * t / 3.0 + rng.random())) / n**0.5 for n in (1, 3, 8, 19, 34)]
    wave = np.sum(waves, axis=0)
    return 8.0 + 4.5 * wave / np.abs(wave).max()


def tracked(model: Model, settings: StageSettings, way: str, seed: int) -> Recording:
    """24 s of tracking, one way."""
    if way == "learning":
        rig = scan(model, passes(seed), 8, settings).rig
        assert rig is not None
    else:
        rig = TrimmedStage(model, settings, trim=way == "trim")
        rig.play(trajectory(seed + 100))
    return recording_of(rig, f"{way}.csv")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="seed of the first case")
    parser.add_argument("--effects", nargs="+", default=[one.name for one in CHOSEN])
    args = parser.parse_args()
    bars = Bars()
    table = [f"{'named first':24s}" + "".join(f"{way:>16s}" for way in WAYS)]
    for trial in (one for one in CHOSEN if one.name in args.effects):
        named = dict.fromkeys(WAYS, 0)
        for seed in range(args.first, args.first + args.seeds):
            drive = exploring(seed)
            around = surroundings(drive.size, seed)
            plain = run(stage_with(trial, seed), drive, around, None)
            first = Recording(plain.t_s, plain.volts, plain.reading_um, name="identify.csv")
            model = replace(identify([first], Options(rate=False)).model, blocks=())
            settings = stage_with(trial, seed).settings
            for way in WAYS:
                begun = time.process_time()
                found = diagnose_without_limits([first, tracked(model, settings, way, seed)], model)
                names = [one.name for one in found.findings]
                named[way] += bool(names) and names[0] in trial.expected
                took = time.process_time() - begun
                text = f"{found.verdict} {names} ({took:.0f} s)"
                print(f"{trial.name} {seed} {way}: {text}", flush=True)
        counts = "".join(f"{f'{named[way]} of {args.seeds}':>16s}" for way in WAYS)
        table.append(f"{trial.name:24s}{counts}")
        for way in WAYS[1:]:
            bars.least(f"{trial.name}, {way}", named[way], named[WAYS[0]], f"of {args.seeds}")
    print("\n" + "\n".join(table))
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
