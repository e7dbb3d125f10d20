"""invert a model along a trajectory: displacements in, drive out"""

import argparse
import json
import math
from pathlib import Path

import numpy as np

from dehyst.daemon.checks import reach
from dehyst.daemon.csvtable import read_table
from dehyst.daemon.files import load_model
from dehyst.daemon.recordings import read_trajectory, write_recording
from dehyst.models.compensator import FLAG_NAMES, Compensator
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.inverse_offline import Inverted, invert_streamed, invert_trajectory
from dehyst.models.model import Floats, Model
from dehyst.models.recording import Trajectory

EPILOG = """\
Writes t_s, target, the drive, what the model predicts, and flags (a sum of:
1 beyond the saturation, 2 beyond the drive range, 4 limited by the slew rate, 8 fewer targets
ahead than the mode wants, 32 outside the range or rate that the model was identified in).

exit status: 0; 1 when part of the trajectory cannot be reached (flag 1 or 2).

example: dehyst invert paper-eq12 trajectory.csv -o drive.csv
         dehyst invert stage.toml trajectory.csv -o drive.csv --preview 0.05 --slew 200
"""
EVEN = 1e-3  # largest deviation of a time step from the mean one, as a part of it
UM = {"um": 1.0, "nm": 1e-3}
UNREACHABLE = 3


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst invert`."""
    parser.epilog = EPILOG
    parser.add_argument("model", metavar="MODEL.toml")
    parser.add_argument("trajectory", type=Path, metavar="TRAJECTORY.csv")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DRIVE.csv")
    parser.add_argument(
        "--preview",
        type=float,
        metavar="SECONDS",
        help="run what the daemon would with this look-ahead (0: none); default: the whole "
        "trajectory at once, to convergence",
    )
    parser.add_argument(
        "--mode",
        choices=("auto", "static", "causal", "preview"),
        default="auto",
        help="with --preview: the daemon's mode (default: auto)",
    )
    parser.add_argument("--min", type=float, help="lowest drive (default: the model's validity)")
    parser.add_argument("--max", type=float, help="highest drive (default: the model's validity)")
    parser.add_argument("--slew", type=float, help="largest drive rate per second")
    parser.add_argument("--start", type=float, help="drive before the first sample (default: 0)")
    parser.add_argument(
        "--period",
        type=float,
        metavar="SECONDS",
        help="resample the trajectory to this period (default: its own, which must be even)",
    )
    parser.add_argument("--json", action="store_true", help="summary as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Invert and write the drive."""
    model = load_model(args.model)
    trajectory = read_trajectory(args.trajectory)
    target = _in_unit(trajectory, model)
    t_s, target, period = _even(trajectory, target, args.period)
    v = model.validity
    compensator = Compensator(
        model,
        period,
        v.drive_min if args.min is None else args.min,
        v.drive_max if args.max is None else args.max,
        1e12 if args.slew is None else args.slew,
        args.mode if args.preview is not None else "auto",
        0.1 if args.preview is None else args.preview,
    )
    channels = _channels(args.trajectory, compensator, trajectory.t_s, t_s)
    invert = invert_trajectory if args.preview is None else invert_streamed
    result = invert(compensator, target, channels, args.start)
    disp = model.displacement_unit
    write_recording(
        args.output,
        t_s,
        {
            f"target_{disp}": target,
            f"u_{model.drive_unit}": result.drive,
            f"y_model_{disp}": result.predicted,
            "flags": result.flags,
        },
        {"model": str(args.model), "trajectory": trajectory.name, "mode": result.mode},
    )
    _report(args, model, compensator, result)
    return 1 if np.any(result.flags & UNREACHABLE) else 0


def _in_unit(trajectory: Trajectory, model: Model) -> Floats:
    unit, wanted = trajectory.unit, model.displacement_unit
    if unit == wanted:
        return trajectory.target
    if unit in UM and wanted in UM:
        return trajectory.target * (UM[unit] / UM[wanted])
    raise BadRecording(
        f"{trajectory.name}: targets in {unit}, the model's displacement is in {wanted}; "
        f"a column target_{wanted} is needed"
    )


def _even(
    trajectory: Trajectory, target: Floats, period: float | None
) -> tuple[Floats, Floats, float]:
    """Times and targets spaced evenly, and the period."""
    t_s = trajectory.t_s
    if period is not None:
        if not period > 0:
            raise BadInput(f"--period: must be greater than 0, not {period:g}")
        even = t_s[0] + np.arange(int((t_s[-1] - t_s[0]) / period + 1.5)) * period
        return even, np.interp(even, t_s, target), period
    if t_s.size < 2:
        raise BadRecording(f"{trajectory.name}: one sample has no period; give --period")
    steps = np.diff(t_s)
    mean = float(np.median(steps))
    row = int(np.argmax(np.abs(steps - mean)))
    if abs(steps[row] - mean) > EVEN * mean:
        raise BadRecording(
            f"{trajectory.name}: the time step after {t_s[row]:g} s is {steps[row]:g} s, "
            f"elsewhere {mean:g} s; give --period to resample"
        )
    return t_s, target, float((t_s[-1] - t_s[0]) / (t_s.size - 1))


def _channels(path: Path, compensator: Compensator, t_file: Floats, t_s: Floats) -> Floats | None:
    """(N, number of channels) values of the model's further channels, from the trajectory."""
    if not compensator.channels:
        return None
    columns = read_table(path).columns
    for name in compensator.channels:
        if name not in columns:
            raise BadRecording(f"{path.name}: the model needs the column {name}; it is missing")
    return np.stack([np.interp(t_s, t_file, columns[n]) for n in compensator.channels], axis=1)


def _report(
    args: argparse.Namespace, model: Model, compensator: Compensator, result: Inverted
) -> None:
    flagged = {name: int(np.count_nonzero(result.flags & bit)) for bit, name in FLAG_NAMES.items()}
    flagged = {name: count for name, count in flagged.items() if count}
    latency = compensator.latency_s if args.preview is not None else None
    summary = {
        "mode": result.mode,
        "reason": compensator.reason,
        "rms": result.rms if math.isfinite(result.rms) else None,
        "unit": model.displacement_unit,
        "latency_s": latency,
        "monotone_price": compensator.price,
        "samples": int(result.drive.size),
        "flagged": flagged,
    }
    if args.json:
        print(json.dumps(summary))
        return
    unit = model.displacement_unit
    print(f"{args.output}: {result.drive.size} samples, {result.mode} ({compensator.reason})")
    if math.isfinite(result.rms):
        print(
            f"predicted error {result.rms:.3g} {unit} rms where the target can be reached, after "
            "the approach from rest"
        )
    else:
        low, high = reach(model, compensator.low, compensator.high)
        print(f"no target can be reached: the stage goes from {low:.3g} to {high:.3g} {unit}")
    if compensator.price:
        print(f"nearest monotone model: {compensator.price:.3g} {unit} rms from this one")
    for name, count in flagged.items():
        print(f"{count} samples: {name}")
