"""The full cycle: track, diagnose from that recording, load the augmented model, track again.

    python -m tests.benchmarks.daemon.loop_closed [--effects creep,lag] [--json FILE]

It runs on the simulated stage (Maxwell-slip hysteresis, its own equations for every effect). The
model is identified with hysteresis alone from an open-loop recording of the same disturbed stage;
both recordings go into the diagnosis. The errors are the true displacement minus the target on a
trajectory that was not diagnosed; the same compensator class runs both models, with the same
look-ahead. A lag of the sensor must not be compensated: the true displacement stays correct.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tests.benchmarks.bars import Bars

from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.diagnosis import diagnose
from dehyst.models.identify import Options, identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Floats, Model
from dehyst.models.recording import Recording

PERIOD_S = 1e-3
LOW_V, HIGH_V, SLEW = 0.0, 150.0, 40_000.0
PREVIEW_S = 0.05
START_S = 1.0  # the approach from rest to the trajectory is not judged


@dataclass(frozen=True)
class Trial:
    """One effect to test. name: the effect; expected: the diagnosis; settings: of the stage."""

    name: str
    expected: tuple[str, ...]
    settings: dict[str, float]
    sensor: bool = False


TRIALS = (
    Trial("creep", ("creep",), {"creep_gain_per_decade": 0.03}),
    Trial("resonance", ("resonance",), {"mode_hz": 110.0, "mode_damping": 0.03, "mode_share": 1.0}),
    Trial("lag of the drive", ("lag",), {"amplifier_tau_s": 3e-3}),
    Trial("drift", ("drift",), {"gain_per_k": 0.015, "expansion_um_per_k": 0.15}),
    Trial("coupling", ("coupling",), {"coupling_um_per_v": 0.01}),
    Trial("lag of the sensor", ("lag",), {"sensor_tau_s": 3e-3}, sensor=True),
)


@dataclass(frozen=True)
class Run:
    """One run of the stage, (N,) each: command, true displacement, reading, channels."""

    t_s: Floats
    volts: Floats
    true_um: Floats
    reading_um: Floats
    channels: dict[str, Floats]

    def recording(self, name: str) -> Recording:
        """Return a recording as the daemon writes it."""
        return Recording(
            self.t_s, self.volts, self.reading_um, channels=self.channels, name=name
        )  # fmt: skip


def stage_with(trial: Trial, seed: int) -> SimulatedStage:
    """Return a stage with hysteresis, noise, and the one effect."""
    quiet = StageSettings(seed=seed).quiet(
        hysteresis_width=0.12, asymmetry=0.15, sensor_noise_um=0.01, **trial.settings
    )
    return SimulatedStage(quiet)


def surroundings(samples: int, seed: int) -> dict[str, Floats]:
    """Return the temperature of a room that warms by 2 K, and an axis that moves now and then."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * PERIOD_S
    room = 22.0 + 2.0 * t / t[-1] + 0.5 * np.sin(2 * np.pi * t / 13.0 + rng.random())
    moving = np.mod(t, 7.0) < 4.0
    axis = 75.0 + 50.0 * moving * np.sin(2 * np.pi * rng.uniform(0.4, 1.5) * t)
    return {"temp_c": room - room[0] + 22.0, "u2_v": axis}


def trajectory(seed: int, seconds: float = 24.0) -> Floats:
    """Return sines of 0.3 to 12 Hz, then quick moves (25 ms) with holds of 1 s, then triangles."""
    rng = np.random.default_rng(seed)
    n = round(seconds / PERIOD_S)
    t = np.arange(n) * PERIOD_S
    waves = sum(
        np.sin(2 * np.pi * (f * t + rng.random())) / f**0.5
        for f in np.geomspace(0.3, 12.0, 7) * rng.uniform(0.9, 1.1, 7)
    )
    waves = 8.0 + 4.5 * waves / np.max(np.abs(waves))
    levels = rng.uniform(2.0, 14.0, int(seconds) + 2)
    steps = levels[t.astype(int)]
    triangle = 8.0 + 10.0 * (np.abs(np.mod(2.1 * t, 1.0) - 0.5) - 0.25) * 2.0
    third = np.minimum((3 * np.arange(n)) // n, 2)
    target = np.choose(third, [waves, steps, triangle]) * np.clip(t / 0.5, 0, 1)
    k = np.hanning(27)[1:-1]
    return np.convolve(np.pad(target, 12, mode="edge"), k / k.sum(), "valid")


def exploring(seed: int, seconds: float = 20.0) -> Floats:
    """Return an open-loop drive for the identification: sines over the range, from rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / PERIOD_S)) * PERIOD_S
    u = sum(np.sin(2 * np.pi * (f * t + rng.random())) for f in (0.31, 0.73, 1.9, 4.1, 9.7))
    return (72.0 + 66.0 * u / np.max(np.abs(u))) * np.clip(t / 0.5, 0, 1)


def run(
    stage: SimulatedStage, volts: Floats | None, around: dict[str, Floats], track: "Track | None"
) -> Run:
    """Run sample by sample: command at the start of each period, reading at its end."""
    n = around["temp_c"].size
    out, true, shown = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        stage.set_inputs(
            temperature_k=float(around["temp_c"][k] - 22.0), other_v=float(around["u2_v"][k])
        )
        u = float(volts[k]) if volts is not None else track.drive(k) if track else 0.0
        stage.advance(PERIOD_S, u)
        out[k], true[k], shown[k] = u, stage.displacement_um, stage.reading_um()
    return Run(np.arange(n) * PERIOD_S, out, true, shown, around)


class Track:
    """A compensator that follows a trajectory."""

    def __init__(self, model: Model, target: Floats, around: dict[str, Floats]) -> None:
        self.compensator = Compensator(model, PERIOD_S, LOW_V, HIGH_V, SLEW, preview_s=PREVIEW_S)
        self.state = self.compensator.init(0.0)
        self.target = target
        names = self.compensator.channels
        self.channels = (
            np.column_stack([around[c] for c in names]) if names else np.zeros((target.size, 0))
        )

    def drive(self, k: int) -> float:
        """Return the next command."""
        window = self.target[k : k + self.compensator.window_samples]
        self.compensator.step(self.state, window, window.size, self.channels[k])
        u = self.state.drive
        self.compensator.applied(self.state, u)
        return u


def one(trial: Trial, seed: int = 1) -> dict[str, Any]:
    """Run the whole sequence for one effect."""
    started = time.perf_counter()
    drive = exploring(seed)
    around = surroundings(drive.size, seed)
    first = run(stage_with(trial, seed), drive, around, None).recording("identify.csv")
    model = identify([first], Options(rate=False)).model

    def tracked(which: Model, course: int) -> tuple[Floats, Run]:
        target = trajectory(course)
        near = surroundings(target.size, course)
        return target, run(stage_with(trial, course), None, near, Track(which, target, near))

    _, before_run = tracked(model, 11)
    diagnosis = diagnose([first, before_run.recording("tracking.csv")], model)
    rows = {}
    skip = round(START_S / PERIOD_S)
    for name, which in (("before", model), ("after", diagnosis.model)):
        target, result = tracked(which, 12)
        error = (result.true_um - target)[skip:]
        reading = (result.reading_um - target)[skip:]
        rows[name] = {
            "rms_nm": 1e3 * float(np.sqrt(np.mean(error**2))),
            "p95_nm": 1e3 * float(np.quantile(np.abs(error), 0.95)),
            "reading_rms_nm": 1e3 * float(np.sqrt(np.mean(reading**2))),
        }
    compensator = Track(diagnosis.model, trajectory(12), surroundings(24_000, 12)).compensator
    return {
        "effect": trial.name,
        "expected": list(trial.expected),
        "verdict": diagnosis.verdict,
        "named": [f"{f.name}@{f.place}" for f in diagnosis.findings],
        "mode": f"{compensator.mode}: {compensator.reason}",
        "sensor": trial.sensor,
        "seconds": time.perf_counter() - started,
        **rows,
    }


def perfect(seed: int = 1) -> float:
    """Return the rms error of the tracking on the undisturbed stage [nm]: the method's floor."""
    bare = Trial("none", (), {})
    drive = exploring(seed)
    recording = run(stage_with(bare, seed), drive, surroundings(drive.size, seed), None)
    model = identify([recording.recording("identify.csv")], Options(rate=False)).model
    target = trajectory(12)
    near = surroundings(target.size, 12)
    result = run(stage_with(bare, 12), None, near, Track(model, target, near))
    error = (result.true_um - target)[round(START_S / PERIOD_S) :]
    return 1e3 * float(np.sqrt(np.mean(error**2)))


def table(rows: Sequence[dict[str, Any]], floor_nm: float) -> str:
    """Return the rows as text."""
    lines = [
        "The loop closed: rms error of the true displacement on a trajectory not diagnosed",
        f"{'effect of the stage':20s}{'before':>10s}{'after':>10s}{'95 % before':>13s}"
        f"{'after':>10s}   named",
    ]
    for r in rows:
        b, a = r["before"], r["after"]
        lines.append(
            f"{r['effect']:20s}{b['rms_nm']:7.0f} nm{a['rms_nm']:7.0f} nm{b['p95_nm']:10.0f} nm"
            f"{a['p95_nm']:7.0f} nm   {r['verdict']}: {', '.join(r['named']) or '-'}"
        )
    lines.append(f"The same stage without any effect, hysteresis model alone: {floor_nm:.0f} nm")
    return "\n".join(lines)


def judge(rows: Sequence[dict[str, Any]], floor_nm: float) -> Bars:
    """Judge that each effect is named, and that the error on a trajectory not diagnosed falls to at
    most half (or to the floor of the method)."""
    bars = Bars()
    for r in rows:
        first = (r["named"] or ["nothing"])[0].partition("@")[0]
        bars.add(f"{r['effect']}: named first", first, " or ".join(r["expected"]),
                 first in r["expected"])  # fmt: skip
        most = max(0.5 * r["before"]["rms_nm"], 1.5 * floor_nm)
        bars.most(f"{r['effect']}: error after", r["after"]["rms_nm"], most, "nm")
    return bars


def collect(names: Sequence[str] = (), say: Any = None) -> tuple[list[dict[str, Any]], float]:
    """Return the rows of trials whose name contains one of `names` (none: all), and the floor."""
    rows = []
    for trial in TRIALS:
        if not names or any(n in trial.name for n in names):
            rows.append(one(trial))
            if say:
                say(f"{trial.name}: {rows[-1]}")
    return rows, perfect()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--effects", default="", help="creep,resonance,lag,drift,coupling,sensor")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rows, floor = collect(
        [n for n in args.effects.split(",") if n], lambda text: print(text, file=sys.stderr)
    )
    if args.json:
        args.json.write_text(json.dumps({"rows": rows, "floor_nm": floor}, indent=1))
    print(table(rows, floor))
    return judge(rows, floor).end()


if __name__ == "__main__":
    sys.exit(main())
