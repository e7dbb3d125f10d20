"""Trim and learning on the simulated stage with its default settings, by the true displacement.

    python -m tests.benchmarks.daemon.learning [--rows sines trim models faults cost] [--passes N]

Everything runs in this process at 1 kHz, through the same step as in the daemon: sines, a raster
and a staircase learned from pass to pass; trim alone on random motion and on a staircase of dwells;
three models; faults of gauge, stage and loop; the computing time of learning from a pass.
learning_diagnosed.py checks the diagnosis of such recordings, and learning_through_serial.py plays
from another process.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from tests.benchmarks.bars import Bars
from tests.rigs.scans import PERIOD_S, Scan, raster, scan, sine, staircase
from tests.rigs.trimmed_stage import SLEW, Tamper, TrimmedStage

from dehyst.daemon.bench.simulated import exploring_drive, simulated_model
from dehyst.daemon.loop.step_kernel import follow_output, take_step
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.identify import identify
from dehyst.models.learning.passes import Learner, Pass
from dehyst.models.model import Block, Floats, Model
from dehyst.models.recording import Recording

SINES = (
    (1.0, 8.0, 8.0, 5.0),
    (5.0, 6.0, 10.0, 6.0),
    (10.0, 4.0, 11.0, 7.0),
    (20.0, 3.0, 16.0, 10.0),
)
"""Hertz, um peak to peak, nm from the fourth pass and from the sixteenth on."""
MEAN_NM = 15.0
GAUGE_LAGS_S = 75e-6, 150e-6
"""Lags in the model. The gauge's filter has 150 us; when the loop reads it, 1 ms after a step of
the output, the reading is 75 us late."""
FAULT_AT = 10  # pass


def line(name: str, one: Scan) -> str:
    """Format the passes of a scan: first, fourth, eighth ..."""
    shown = [i for i in (0, 1, 2, 3, 7, 11, 15, 19) if i < len(one.std_nm)]
    std = " ".join(f"{one.std_nm[i]:6.1f}" for i in shown)
    return f"{name:34s} {std}   mean {one.mean_nm[0]:+.0f} to {one.mean_nm[-1]:+.1f}"


def sines(model: Model, passes: int, bars: Bars) -> None:
    """Measure row 1."""
    print("std of the true error, nm; pass      1      2      3      4      8     12     16     20")
    for hertz, um, fourth, sixteenth in SINES:
        one = scan(model, sine(hertz, um), passes)
        name = f"{um:g} um at {hertz:g} Hz"
        print(line(name, one))
        bars.most(f"{name}, from pass 4", max(one.std_nm[3:]), fourth, "nm")
        bars.most(f"{name}, from pass 16", max(one.std_nm[15:]), sixteenth, "nm")
        bars.most(f"{name}, mean from pass 4", max(map(abs, one.mean_nm[3:])), MEAN_NM, "nm")
    for lag_s in GAUGE_LAGS_S:
        lag = Block("lag", "sensor", {"tau_s": lag_s})
        one = scan(replace(model, blocks=(lag,)), sine(20.0, 3.0), passes)
        print(line(f"3 um at 20 Hz, gauge's lag {1e6 * lag_s:.0f} us", one))
    for name, target in (("raster, 5 lines a second", raster()), ("staircase", staircase())):
        one = scan(model, target, passes)
        print(line(name, one))
        bars.most(f"{name}, from pass 16, of pass 1", max(one.std_nm[15:]) / one.std_nm[0], 0.2)


def random_motion(seconds: float, seed: int) -> Floats:
    """Return a motion below 5 Hz, 6 um about 8 um."""
    n = round(seconds / PERIOD_S)
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(n))
    hertz = np.fft.rfftfreq(n, PERIOD_S)
    spectrum[(hertz > 5.0) | (hertz < 0.1)] = 0.0
    x = np.fft.irfft(spectrum, n)
    return 8.0 + 3.0 * x / np.abs(x).max()


def trim_alone(model: Model, bars: Bars) -> None:
    """Measure row 3."""
    for seed in (1, 2, 3):
        target = random_motion(30.0, seed)
        found = {}
        for trim in (False, True):
            rig = TrimmedStage(model, trim=trim)
            own = rig.play(target)
            late = 1e3 * (rig.true_um[own] - target)[10_000:]
            found[trim] = float(late.mean()), float(late.std())
        (off, shape), (left, trimmed) = found[False], found[True]
        text = f"mean {off:+.0f} to {left:+.1f} nm, std {shape:.1f} to {trimmed:.1f} nm"
        print(f"random motion {seed}: {text}")
        bars.most(f"random motion {seed}, mean after 10 s", abs(left), MEAN_NM, "nm")
        bars.most(f"random motion {seed}, shape over that without", trimmed / shape, 1.05)
    rig, smooth = TrimmedStage(model), np.ones(100) / 100
    for level in (4.0, 8.0, 12.0, 8.0, 4.0):
        first = len(rig.true)
        rig.go(level, 23.0)
        error = np.convolve(1e3 * (rig.true_um[first:] - level), smooth, "valid")[2950:]
        print(
            f"level {level:g} um: {error[0]:+.1f} nm after 3 s, {np.ptp(error):.1f} nm within 20 s"
        )
        bars.most(f"level {level:g} um after 3 s", abs(float(error[0])), 5.0, "nm")
        creep = abs(float(error[-1] - error[0]))
        bars.most(f"level {level:g} um, creep over 20 s", creep, 5.0, "nm")


def models(plain: Model, passes: int, bars: Bars) -> None:
    """Measure row 4."""
    creep = Block("creep", "stage", {"gain_per_decade": 0.012, "tau_min_s": 0.01, "tau_max_s": 1e4})
    other = StageSettings(stroke_um=17.4 * 1.1, hysteresis_width=0.132)
    t_s, volts = exploring_drive()
    _, reading = SimulatedStage(other).run(t_s, volts)
    held = np.concatenate([[0.0], volts[:-1]])
    recording = Recording(t_s=t_s, drive=held, displacement=reading)
    kinds = {
        "plain": plain,
        "augmented with creep": replace(plain, blocks=(creep,)),
        "of a stage 10 % larger": identify([recording]).model,
    }
    for hertz, um in ((1.0, 8.0), (5.0, 6.0)):
        ends = {}
        for name, model in kinds.items():
            one = scan(model, sine(hertz, um), passes)
            print(line(f"{um:g} um at {hertz:g} Hz, {name}"[:34], one))
            ends[name] = float(np.sqrt(np.mean(np.square(one.std_nm[-4:]))))
        spread = max(ends.values()) - min(ends.values())
        bars.most(f"{hertz:g} Hz, three models, spread at the end", spread, 1.5, "nm")


def tampers() -> dict[str, tuple[Callable[[int], Tamper | None], str]]:
    """Return by name: the disturbance in a pass, and a word that must be reported."""
    kept: dict[str, float] = {}

    def stuck(rig: TrimmedStage, reading: float) -> float:
        return kept.setdefault("stuck", reading)

    def knock(rig: TrimmedStage, reading: float) -> float:
        place = len(rig.records) % 1000
        rig.stage.set_inputs(other_v=100.0 if 300 <= place < 330 else 0.0)
        return reading

    def glitches(rig: TrimmedStage, reading: float) -> float:
        return float("nan") if 100 <= len(rig.records) % 1000 < 400 else reading

    def during(tamper: Tamper) -> Callable[[int], Tamper | None]:
        return lambda number: tamper if number == FAULT_AT else None

    return {
        "stuck": (during(stuck), "has not changed"),
        "NaN for 0.3 s": (during(glitches), "no valid reading"),
        "out of range": (during(lambda rig, reading: 69.6 + 0.01 * reading), "implausible"),
        "unplugged for a pass": (during(lambda rig, reading: float("nan")), "no valid reading"),
        "a jump of 1 um, for a pass": (during(lambda rig, reading: reading + 1.0), "jumped"),
        "a drift of 5 nm a second": (
            lambda number: lambda rig, reading: reading + 5e-6 * max(0, len(rig.records) - 10_000),
            "",
        ),
        "a knock of 1 um": (during(knock), "a knock"),
    }


def faults(model: Model, learn: bool, bars: Bars) -> None:
    """Measure row 5: while trimming, and while learning too. A drift is followed, so its mean is
    not judged."""
    coupled = StageSettings(coupling_um_per_v=0.01)
    target, passes = sine(5.0, 6.0), FAULT_AT + 8
    every = np.random.default_rng(5)
    cases: dict[str, tuple[Scan, str]] = {
        name: (scan(model, target, passes, coupled, tamper=tamper, learn=learn), word)
        for name, (tamper, word) in tampers().items()
    }
    lost = frozenset(every.choice(np.arange(5, 1000), 10, False).tolist())
    cases["1 % of samples missed"] = (
        scan(
            model,
            target,
            passes,
            missed=lambda number: lost if number == FAULT_AT else frozenset(),
            learn=learn,
        ),
        "missing",
    )
    what = "learning" if learn else "trim alone"
    for fault, (one, word) in cases.items():
        name = f"{what}, {fault}"
        before, after = max(one.std_nm[FAULT_AT - 3 : FAULT_AT]), one.std_nm[FAULT_AT + 3 :]
        reported = [
            t for t in (*one.events, *one.said[FAULT_AT : FAULT_AT + 3]) if word and word in t
        ]
        worst = max(one.std_nm[FAULT_AT:])
        text = f"before {before:.1f}, worst {worst:.1f}, then {max(after):.1f} nm"
        print(f"{name:40s} {text}: {reported[:1]}")
        bars.most(f"{name}: level after three passes", max(after), 1.2 * before + 0.5, "nm")
        bars.most(f"{name}: largest step", max(one.step_v), SLEW * PERIOD_S * (1 + 1e-9), "V")
        bars.most(f"{name}: correction", max(one.correction_um), 1.75, "um")
        if word:
            bars.least(f"{name}: reported", len(reported), 1)
        if "drift" not in name:
            bars.most(f"{name}: mean then", max(map(abs, one.mean_nm[-3:])), MEAN_NM, "nm")


def cost(model: Model, bars: Bars) -> None:
    """Measure row 7. For the whole loop with and without trim:
    tests.benchmarks.daemon.deadlines."""
    target = np.tile(sine(1.0, 8.0), 100)
    learner = Learner(target, PERIOD_S, 0.02, 1.7)
    noise = np.random.default_rng(1).normal(0.0, 0.02, (6, target.size))
    error, took = 0.03 * np.sin(np.arange(target.size) / 50.0), []
    for row in noise:
        begun = time.process_time()
        learner.take(Pass(error + learner.correction + row, learner.correction))
        took.append(time.process_time() - begun)
    bars.most("a pass of 100 000 samples, CPU time", max(took[1:]), 0.2, "s")
    rigs = {trim: TrimmedStage(model, trim=trim) for trim in (False, True)}
    for rig in rigs.values():
        rig.play(sine(5.0, 6.0))
    us = dict.fromkeys(rigs, float("inf"))
    for _ in range(60):  # alternately, so that the machine is equally busy for both
        for trim, rig in rigs.items():
            words, stepper = rig.stepper.table.words, rig.stepper
            begun = time.perf_counter()
            for i in range(200):
                take_step(words, rig.now_ns + i * rig.period_ns, 5.0 + 1e-4 * i, 0)
                follow_output(words, stepper.volts)
            us[trim] = min(us[trim], 1e6 * (time.perf_counter() - begun) / 200)
            rig.now_ns += 200 * rig.period_ns
    print(f"a step and its model: {us[False]:.2f} us without trim, {us[True]:.2f} us with")
    bars.most("trim in a step", us[True] - us[False], 0.5, "us")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    rows = ("sines", "trim", "models", "faults", "cost")
    parser.add_argument("--rows", nargs="+", choices=rows, default=rows)
    parser.add_argument("--passes", type=int, default=20)
    args = parser.parse_args()
    bars, model = Bars(), simulated_model()
    if "sines" in args.rows:
        sines(model, args.passes, bars)
    if "trim" in args.rows:
        trim_alone(model, bars)
    if "models" in args.rows:
        models(model, args.passes, bars)
    if "faults" in args.rows:
        faults(model, True, bars)
        faults(model, False, bars)
    if "cost" in args.rows:
        cost(model, bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
