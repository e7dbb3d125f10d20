"""invert a model along a trajectory: displacements in, drive out"""

import argparse
import json
import math
from pathlib import Path

import numpy as np

from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.files.recordings import read_trajectory, write_recording
from dehyst.daemon.loop.reach import displacement_range
from dehyst.daemon.tools.trajectories import channels_along, spaced_evenly, target_in_unit
from dehyst.models.inverse.compensator import FLAG_NAMES, Compensator
from dehyst.models.inverse.offline import Inverted, invert_streamed, invert_trajectory
from dehyst.models.model import Model

EPILOG = """\
Writes t_s, target, the drive, what the model predicts, and flags (a sum of:
1 beyond the saturation, 2 beyond the drive range, 4 limited by the slew rate, 8 fewer targets
ahead than the mode wants, 32 outside the range or rate that the model was identified in).

exit status: 0; 1 when part of the trajectory cannot be reached (flag 1 or 2).

example: dehyst invert paper-eq12 trajectory.csv -o drive.csv
         dehyst invert stage.toml trajectory.csv -o drive.csv --preview 0.05 --slew 200
"""
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
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="summary as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Invert and write the drive."""
    check_outputs([args.output], [args.model, args.trajectory], args.force)
    model = load_model(args.model)
    trajectory = read_trajectory(args.trajectory)
    target = target_in_unit(trajectory, model)
    t_s, target, period = spaced_evenly(trajectory, target, args.period)
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
    channels = channels_along(args.trajectory, compensator, trajectory.t_s, t_s)
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
        low, high = displacement_range(model, compensator.low, compensator.high)
        print(f"no target can be reached: the stage goes from {low:.3g} to {high:.3g} {unit}")
    if compensator.price:
        print(f"nearest monotone model: {compensator.price:.3g} {unit} rms from this one")
    for name, count in flagged.items():
        print(f"{count} samples: {name}")
