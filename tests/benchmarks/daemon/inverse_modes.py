"""The inverse's modes in the running daemon, from telemetry alone, compared with an offline run.

    python -m tests.benchmarks.daemon.inverse_modes [--for SECONDS] [--modes static,preview]

The core and the gateway run as processes on the in-process simulated stage at 200 Hz, with rate
dependence and a lag of the amplifier. The model is identified from the stage's own recording;
"linear" is a straight line through that recording. The stage has no creep here and its loops are
symmetric: creep would move its zero by half a micrometre within the run, equally in all modes, and
a residual that the model cannot represent would hide the differences between the modes. `dehyst
play` streams sines; the error is the reading minus the target in the same record, for which the
voltage was computed one period before. Offline, Compensator and SimulatedStage.run do the same
without a daemon. Exit status 1 unless preview is clearly better than linear and static in the
daemon, and every two modes that clearly differ offline differ in the same direction there.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.benchmarks.bars import Bars
from tests.rigs.gateway_bench import free_port

from dehyst.daemon.client.client import Client
from dehyst.daemon.config import load_config
from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring import Ring
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.arrays import Floats
from dehyst.models.identify import Options, identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Hysteresis, Model
from dehyst.models.recording import Recording

MODES = ("linear", "static", "causal", "preview")
SINES = ((5.0, 5.0), (10.0, 4.0), (20.0, 3.0))  # Hz, um peak to peak
RATE_HZ, TOP_V, SLEW, PREVIEW_S, CENTRE_UM = 200.0, 150.0, 40_000.0, 0.1, 8.0
PLANT = {
    "rate_per_decade": 0.05, "amplifier_tau_s": 6e-3, "sensor_noise_um": 0.005,
    "creep_gain_per_decade": 0.0, "asymmetry": 0.0,
}  # fmt: skip
START = 0.35  # initial part of each sine that is not judged
CLEARLY = 1.25  # two errors that differ by at least this factor can be ranked

CONFIG = """
name = "modes"
run_dir = "{folder}/run"
[model]
file = "{folder}/model.toml"
[loop]
rate_hz = {rate}
[actuator]
driver = "simulated"
settings = {settings}
[sensor]
driver = "simulated"
settings = {settings}
[limits]
min_v = 0.0
max_v = {top}
slew_v_per_s = {slew}
[trim]
enabled = false
[setpoint]
origin = "model"
[inverse]
mode = "{mode}"
preview_s = {preview}
[bus]
listen = ["{address}"]
"""


def excitation() -> Floats:
    """A slow loop over the range, then shrinking loops at 1 to 14 Hz, each from rest: motion of the
    kind that is played afterwards. (A recording with only fast motion gave a model that was off by
    0.7 um in a slow loop.)"""
    n, rest = round(1.5 * RATE_HZ), round(0.3 * RATE_HZ)
    t = np.arange(round(RATE_HZ)) / RATE_HZ
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(rest) / rest)
    parts = [0.46 * TOP_V * (1 - np.cos(2 * np.pi * np.arange(n) / n))]
    for f, size in ((1, 0.3), (5, 0.2), (10, 0.15), (3, 0.25), (7, 0.2), (14, 0.1)):
        wave = size * (1 - np.cos(2 * np.pi * f * t)) * np.linspace(1, 0.3, t.size)
        loop = TOP_V * (0.55 - size + wave)
        parts += [loop[0] * rise, loop, loop[-1] * (1 - rise)]
    return np.concatenate(parts)


def identified() -> tuple[Model, Model]:
    """Return the stage's model from its own recording, and a straight line through that
    recording."""
    u = excitation()
    reading = answers(u)
    t = np.arange(u.size) / RATE_HZ
    model = identify([Recording(t, u, reading, name="simulated stage")], Options()).model
    gain, zero = np.polyfit(u, reading, 1)
    line = Hysteresis(r=[0.0], b=[float(gain)], c=[float(zero), 1.0])
    return model, replace(model, hysteresis=line)


def answers(volts: Floats) -> Floats:
    """Return the reading one period after each voltage was commanded, of a fresh stage."""
    t = np.arange(volts.size + 1) / RATE_HZ
    _, reading = SimulatedStage(StageSettings(**PLANT)).run(t, np.append(volts, volts[-1]))  # type: ignore[arg-type]
    return np.asarray(reading[1:])


def trajectory(seconds: float) -> tuple[Floats, list[slice]]:
    """Return targets: a loop over the range, so that plant and model have the same history, then
    the sines with glides between; and the slices in which each sine is judged."""
    n = round(1.5 * RATE_HZ)
    parts = [9.0 - 6.0 * np.cos(2 * np.pi * np.arange(n) / n)]
    judged, at = [], n
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    glide = round(0.2 * RATE_HZ)
    for f, size in SINES:
        wave = CENTRE_UM - 0.5 * size * np.cos(2 * np.pi * f * t)
        bend = 0.5 - 0.5 * np.cos(np.pi * np.arange(glide) / glide)
        parts += [parts[-1][-1] + (wave[0] - parts[-1][-1]) * bend, wave]
        at += glide + t.size
        judged.append(slice(at - round((1 - START) * t.size), at - 1))
    return np.concatenate(parts), judged


def rms_nm(error: Floats, judged: list[slice]) -> list[float]:
    """Return the rms of each sine about its mean: the offset of a loop depends on the past that
    model and stage remember differently, equally in all modes."""
    return [1e3 * float(np.nanstd(error[part])) for part in judged]


def offline(model: Model, mode: str, seconds: float) -> list[float]:
    """Return the errors without a daemon; a slow approach comes first, as in the daemon."""
    target, judged = trajectory(seconds)
    approach = np.linspace(0.0, target[0], 100)
    whole = np.concatenate([approach, target])
    c = Compensator(model, 1 / RATE_HZ, 0.0, TOP_V, SLEW, mode, PREVIEW_S)
    state, volts, nothing = c.init(0.0), np.empty(whole.size), np.zeros(0)
    for i in range(whole.size):
        window = whole[i : i + c.window_samples]
        c.step(state, window, window.size, nothing)
        volts[i] = state.drive
        c.applied(state, volts[i])
    return rms_nm(answers(volts)[approach.size :] - target, judged)


def start(*arguments: str) -> "subprocess.Popen[bytes]":
    """Start one of dehyst's processes."""
    env = {**os.environ, "DEHYST_SUPERVISED": "1"}
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "dehyst.daemon.main", *arguments], env=env,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def in_daemon(folder: Path, model: Model, mode: str, seconds: float) -> list[float]:
    """Return the errors of `dehyst play`, from the telemetry of the samples that it commanded."""
    address = f"tcp/127.0.0.1:{free_port()}"
    settings = ", ".join(f"{k} = {v}" for k, v in {**PLANT}.items())
    path = folder / "config.toml"
    path.write_text(
        CONFIG.format(
            folder=folder, rate=RATE_HZ, top=TOP_V, slew=SLEW, mode=mode, preview=PREVIEW_S,
            address=address, settings=f'{{stage = "modes", {settings}}}',
        )
    )  # fmt: skip
    save_model(model, folder / "model.toml")
    load_config(path)
    processes = [start("core", "--config", str(path)), start("gateway", "--config", str(path))]
    try:
        ready(address, processes)
        return played(folder, address, seconds)
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.communicate(timeout=30)


def ready(address: str, processes: "list[subprocess.Popen[bytes]]") -> None:
    """Wait until the loop runs and a client can ask it; kernels may have to be compiled."""
    end = time.monotonic() + 240.0
    while time.monotonic() < end:
        for process in processes:
            if process.poll() is not None:
                raise SystemExit(process.communicate()[1].decode())
        try:
            client = Client(connect=address)
        except Exception:  # not there yet
            time.sleep(0.2)
            continue
        try:
            if client.status().core_alive:
                return
        finally:
            client.bus.close()
        time.sleep(0.2)
    raise SystemExit("the daemon did not start")


def played(folder: Path, address: str, seconds: float) -> list[float]:
    """Play the trajectory by `dehyst play`; return its errors from the telemetry ring."""
    target, judged = trajectory(seconds)
    t = np.arange(target.size) / RATE_HZ
    file = folder / "sine.csv"
    np.savetxt(file, np.column_stack([t, target]), "%.9f", ",", header="t_s,target_um", comments="")
    ring = Ring.attach(folder / "run" / "telemetry.ring", TELEMETRY)
    first = int(ring.read(0)[0]["seq"][-1])
    done = subprocess.run(
        [sys.executable, "-P", "-m", "dehyst.daemon.main", "play", str(file), "--connect", address,
         "--json"], capture_output=True, text=True, check=False,
    )  # fmt: skip
    samples = ring.read(0)[0]
    ring.close()
    if not done.stdout:
        raise SystemExit(f"dehyst play: {done.stderr}")
    if not json.loads(done.stdout)["completed"]:
        raise SystemExit(f"dehyst play: {json.loads(done.stdout)['reason']}")
    samples = samples[(samples["seq"] > first) & np.isfinite(samples["target"])]
    return rms_nm(errors(samples, target), judged)


def errors(samples: NDArray[Any], target: Floats) -> Floats:
    """Return reading minus target of each sample of the trajectory, NaN if the loop missed it.

    An approach precedes the trajectory and a hold follows it: the trajectory is located where the
    targets that were followed match its own.
    """
    at = np.rint((samples["scheduled_ns"] - samples["scheduled_ns"][0]) * 1e-9 * RATE_HZ).astype(
        int
    )
    followed, error = np.full((2, max(at[-1] + 1, target.size)), np.nan)
    followed[at], error[at] = samples["target"], samples["measured"] - samples["target"]
    room = range(followed.size - target.size + 1)
    off = [float(np.nanmax(np.abs(followed[i : i + target.size] - target))) for i in room]
    best = int(np.argmin(off))
    if off[best] > np.abs(np.diff(target)).max():  # the loop's samples lie between the file's
        raise SystemExit(f"the daemon followed other targets: {off[best]:.3g} um off at best")
    error = error[best : best + target.size]
    print(f"    {np.isnan(error).sum()} of {error.size} samples missed", file=sys.stderr)
    return error


def alike(within: dict[str, float], without: dict[str, float]) -> bool:
    """Return whether preview is clearly better than linear and static in the daemon, and every two
    modes that clearly differ offline rank the same way in the daemon."""
    others = [within[m] for m in within if m in ("linear", "static")]
    best = "preview" not in within or all(within["preview"] * CLEARLY < e for e in others)
    return best and all(
        within[a] > within[b] for a in within for b in within if without[a] > CLEARLY * without[b]
    )


def ranking(errors: dict[str, float]) -> str:
    """Return the modes by increasing error; = between two neighbours that do not clearly differ."""
    order = sorted(errors, key=lambda mode: errors[mode])
    words = order[:1]
    for best, mode in pairwise(order):
        words += ["<" if errors[mode] > CLEARLY * errors[best] else "=", mode]
    return " ".join(words)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--for", dest="seconds", type=float, default=1.5, help="of each sine")
    parser.add_argument("--modes", default=",".join(MODES))
    args = parser.parse_args()
    modes = args.modes.split(",")
    model, line = identified()
    models = {mode: (line, "static") if mode == "linear" else (model, mode) for mode in modes}
    fit = 1e3 * (model.fit.rms or 0.0)
    kind = "static" if model.hysteresis.static else "rate-dependent"
    print(f"model: {kind}, {model.hysteresis.n} operators, fit {fit:.0f} nm; rms error in nm")
    without = {mode: offline(*models[mode], args.seconds) for mode in modes}
    with tempfile.TemporaryDirectory(prefix="dehyst-modes-") as name:
        within = {}
        for mode in modes:
            folder = Path(name) / mode
            folder.mkdir()
            within[mode] = in_daemon(folder, *models[mode], args.seconds)
    print(f"{'target':18}" + "".join(f"{m + ', daemon':>17}{'offline':>9}" for m in modes)
          + "  same ranking")  # fmt: skip
    bars = Bars()
    for k, (f, size) in enumerate(SINES):
        here, there = {m: within[m][k] for m in modes}, {m: without[m][k] for m in modes}
        order = alike(here, there)
        bars.add(f"{f:g} Hz: preview is clearly best, the modes rank as offline", ranking(here),
                 ranking(there), order)  # fmt: skip
        cells = "".join(f"{within[m][k]:17.0f}{without[m][k]:9.0f}" for m in modes)
        print(f"{f:3g} Hz, {size:g} um p-p  {cells}  {'yes' if order else 'no'}")
        print(f"    daemon: {ranking(here)};  offline: {ranking(there)}")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
