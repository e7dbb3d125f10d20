"""Three axes end to end: identified and then played from another process, over emulated serial.

    python -m tests.benchmarks.daemon.three_axes_through_serial [--passes N] [--seconds S]

It runs the unchanged `dehyst acquire`, `identify`, `scan` and `play`, each in its own process,
through an emulated MDT693B and three emulated KSG101, and plays a raster and a Lissajous figure.
The daemon runs once with a straight line for each axis, once with the models without their
coupling, once with it, and once more with learning. The error is that of the true displacement,
which the emulated bench logs at each reading; z is commanded to hold throughout. Cross-talk is the
change in z when the others move: its displacement while they follow the figure, minus that while
they hold for the same time before and after, which creep and trim leave.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.gateway_bench import free_port
from tests.rigs.processes import EmulatedBench, dehyst, until

from dehyst.daemon.bench.simulated import AXES_RATE_HZ, exploring_drive, write_axes_bench
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recordings import read_columns, write_recording
from dehyst.daemon.rings.records import Flag
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Floats, Hysteresis, Model

AXES = "xyz"
NAME = "three"
LEAST_GAIN = 3.0
FIGURES = {
    "raster of 5 x 5 um": ("raster", "--size", "5", "5", "--lines", "10"),
    "Lissajous figure of 5 x 5 um": ("lissajous", "--size", "5", "5", "--figure-s", "3"),
}
CENTER = ("--center", "8", "7.5")
STILL_UM = 8.5
SETTLE_S = 15.0  # at the first targets, before anything is judged
AFTER_S = 60.0  # time for `dehyst play` to end: its report, its picture


def run_command(*words: str, seconds: float = 600.0) -> None:
    """Run a dehyst command in its own process; it must not end with 2."""
    command = [sys.executable, "-m", "dehyst.daemon.main", *words]
    ended = subprocess.run(command, check=False, env=os.environ, timeout=seconds)
    if ended.returncode not in (0, 1):
        raise SystemExit(f"dehyst {words[0]} ended with {ended.returncode}")


def straight(model: Model) -> Model:
    """Return the line through the ends of the loop, which is a linear gain."""
    low, high = model.validity.drive_min, model.validity.drive_max
    ends = simulate_hysteresis(model.hysteresis, np.linspace(low, high, 500), 1e9)[[0, -1]]
    slope = float(ends[1] - ends[0]) / (high - low)
    offset = float(ends[0]) - slope * low
    line = Hysteresis(r=np.zeros(1), b=np.array([slope]), k=np.zeros(1), c=np.array([offset, 1.0]))
    return replace(model, hysteresis=line, blocks=())


def identified(folder: Path, config: Path, seconds: float) -> dict[str, dict[str, Model]]:
    """Return the models of each axis by kind, from recordings that `dehyst acquire` makes."""
    t_s, volts = exploring_drive(AXES_RATE_HZ, seconds)
    write_recording(folder / "drive.csv", t_s, {"u_v": volts})
    recording = str(folder / "rec.csv")
    run_command("acquire", str(folder / "drive.csv"), "--config", str(config), "-o", recording)
    kinds: dict[str, dict[str, Model]] = {"linear": {}, "compensated": {}, "coupled": {}}
    for axis in AXES:
        path, model = folder / f"rec-{axis}.csv", folder / f"identified-{axis}.toml"
        run_command("identify", str(path), "-o", str(model))
        kinds["coupled"][axis] = load_model(model)
        own = tuple(b for b in kinds["coupled"][axis].blocks if not b.channel)
        kinds["compensated"][axis] = replace(kinds["coupled"][axis], blocks=own)
        kinds["linear"][axis] = straight(kinds["compensated"][axis])
    return kinds


def log_of(bench: EmulatedBench) -> dict[str, tuple[Floats, Floats]]:
    """Return (time [ns], true displacement [um]) at each reading, by axis."""
    bench.output()
    with np.load(bench.log) as saved:
        heads = [name.removesuffix("true_um") for name in saved.files if "true_um" in name]
        return {
            (head.rstrip("_") or "x"): (saved[f"{head}reading_ns"] * 1.0, saved[f"{head}true_um"])
            for head in heads
        }


def courses_um(
    client: Mapping[str, Client], bench: EmulatedBench, n: int, passes: int
) -> tuple[dict[str, Floats], NDArray[np.bool_]]:
    """Return (n,) true displacement minus target by axis in the last pass; (n,) in time."""
    true, off, good = log_of(bench), {}, np.ones(n, bool)
    for axis, one in client.items():
        records = one.history(seconds=passes * n / AXES_RATE_HZ + AFTER_S)
        begun = int(np.flatnonzero(records["flags"] & int(Flag.APPROACH))[-1]) + 1
        last = records[begun : begun + passes * n][-n:]
        at_ns, where = true[axis]
        off[axis] = np.interp(last["scheduled_ns"], at_ns, where) - last["target"]
        good &= (last["flags"] & int(Flag.MISSED)) == 0
    return off, good


def errors_nm(off: Mapping[str, Floats], good: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the rms of the path's error in the plane, and of z's, each about its mean."""
    power = {axis: float(np.var(1e3 * error[good])) for axis, error in off.items()}
    return float(np.sqrt(power["x"] + power["y"])), float(np.sqrt(power["z"]))


def connected(address: str) -> dict[str, Client] | None:
    """Return a client for each axis, once all loops run."""
    clients: dict[str, Client] = {}
    try:
        for axis in AXES:
            clients[axis] = Client(f"{NAME}-{axis}", address)
        if all(client.status().state == "ready" for client in clients.values()):
            return clients
    except BusError:
        pass
    for one in clients.values():
        one.close()
    return None


def write_figure(folder: Path, config: Path, words: tuple[str, ...]) -> tuple[Path, Path, Path]:
    """Write the trajectories of all axes: the figure, a hold at its first point for the same time,
    and a hold during which creep settles."""
    path, alone, settle = (folder / f"{words[0]}{kind}.csv" for kind in ("", "-alone", "-settle"))
    if not path.exists():
        plane = folder / f"{words[0]}-plane.csv"
        run_command("scan", *words, *CENTER, "--config", str(config), "-o", str(plane))
        columns, _ = read_columns(plane)
        t_s = columns.pop("t_s")
        columns["target_z_um"] = np.full(t_s.size, STILL_UM)
        del columns["scan"]
        write_recording(path, t_s, columns)
        write_recording(alone, t_s, {k: np.full(t_s.size, v[0]) for k, v in columns.items()})
        t_s = np.arange(round(SETTLE_S * AXES_RATE_HZ)) / AXES_RATE_HZ
        write_recording(settle, t_s, {k: np.full(t_s.size, v[0]) for k, v in columns.items()})
    return path, alone, settle


class Played(NamedTuple):
    """Rms [nm] of a figure: of the path's error, of z's about its mean, and of its cross-talk."""

    path: float
    still: float
    talk: float


def played(
    folder: Path, bench: EmulatedBench, config: Path, address: str, passes: int
) -> dict[str, Played]:
    """Return the errors of each figure with the models in the folder; the last pass counts."""
    out = {}
    daemon = dehyst("run", "--config", str(config), stdout=None, stderr=subprocess.DEVNULL)
    where = ("--to", NAME, "--connect", address)
    try:
        clients = until(lambda: connected(address), 240.0, "the daemon")
        for name, words in FIGURES.items():
            path, alone, settle = write_figure(folder, config, words)
            n = read_columns(path)[0]["t_s"].size
            run_command("play", str(settle), *where)

            def course(file: Path, n: int, repeat: int = 1, *more: str) -> Any:
                run_command("play", str(file), *where, "--repeat", str(repeat), *more)
                return courses_um(clients, bench, n, repeat)

            before, good = course(alone, n)
            picture = ("--picture", str(folder / "p.png"), "--force")
            more = ("--learn", *picture) if passes > 1 else ()
            found, in_time = course(path, n, passes, *more)
            good &= in_time
            behind, in_time = course(alone, n)
            good &= in_time
            talk = found["z"] - 0.5 * (before["z"] + behind["z"])
            out[name] = Played(*errors_nm(found, good), float(np.std(1e3 * talk[good])))
        for one in clients.values():
            one.close()
    finally:
        daemon.terminate()
        daemon.wait(60)
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--passes", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the drive")
    args = parser.parse_args()
    bars, busy = Bars(), too_busy(1.0)
    with tempfile.TemporaryDirectory() as name:
        folder, address = Path(name), f"tcp/127.0.0.1:{free_port()}"
        bench = EmulatedBench(folder, "--axes", str(len(AXES)))
        try:
            nothing: dict[str, Model | None] = dict.fromkeys(AXES)
            config = write_axes_bench(folder, bench.ports, NAME, address, nothing, trim=False)
            found = {}
            for kind, models in identified(folder, config, args.seconds).items():
                for axis, model in models.items():
                    save_model(model, folder / f"model-{axis}.toml")
                found[kind] = played(folder, bench, config, address, 1)
                print(kind, found[kind], flush=True)
            found["learned"] = played(folder, bench, config, address, args.passes)
        finally:
            bench.close()
    for figure in FIGURES:
        reported = "; ".join(
            f"{kind} {r[figure].path:.0f}, z {r[figure].still:.1f}, {r[figure].talk:.1f}"
            for kind, r in found.items()
        )
        print(f"{figure}: error of the path, of z which stands, cross-talk on z, nm: {reported}")
        gain = found["compensated"][figure].talk / found["coupled"][figure].talk
        if busy and not gain >= LEAST_GAIN:
            bars.cannot(f"{figure}: cross-talk, without over with: {gain:.1f}", busy)
        else:
            bars.least(f"{figure}: cross-talk, without over with", gain, LEAST_GAIN)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
