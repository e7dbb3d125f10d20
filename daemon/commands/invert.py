"""Invert a model along a trajectory: displacements in, drive out."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dehyst.daemon.files.foreign.reading import add_reading, reading_of
from dehyst.daemon.files.given_recordings import say_read
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.files.recordings import read_trajectory
from dehyst.daemon.json_text import print_json_line
from dehyst.models.units import how_many

if TYPE_CHECKING:
    from dehyst.daemon.api.results import Drive

EPILOG = """\
Writes t_s, target, the drive, the model's prediction, and flags (a sum of:
1 beyond the saturation, 2 beyond the drive range, 4 limited by the slew rate, 8 fewer targets
ahead than the mode needs, 32 outside the range or rate of the model's recording).

exit status: 0; 1 if part of the trajectory cannot be reached (flag 1 or 2).

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
        help="compute the daemon's drive with this look-ahead (0: none); default: the whole "
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
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="summary as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Invert and write the drive."""
    check_outputs([args.output], [args.model, args.trajectory], args.force)
    trajectory = read_trajectory(args.trajectory, reading=reading_of(args))
    say_read(trajectory.read)
    # slow imports, which help and a refused file do not need
    from dehyst.daemon.api.functions import invert

    made = invert(
        args.model,
        trajectory,
        preview=args.preview,
        mode=args.mode,
        low=args.min,
        high=args.max,
        slew=args.slew,
        start=args.start,
        period=args.period,
    )
    notes = {"model": str(args.model), "trajectory": args.trajectory.name}
    made.save(args.output, force=args.force, notes=notes)
    if args.json:
        print_json_line(_summary(made))
    else:
        _report(args.output, made)
    return 1 if np.any(made.result.flags & UNREACHABLE) else 0


def _summary(made: "Drive") -> dict[str, Any]:
    return {
        "mode": made.mode,
        "reason": made.reason,
        "rms": made.rms,
        "unit": made.model.displacement_unit,
        "latency_s": made.latency_s,
        "monotone_price": made.monotone_price,
        "samples": int(made.drive.size),
        "flagged": made.flagged,
    }


def _report(output: Path, made: "Drive") -> None:
    unit = made.model.displacement_unit
    print(f"{output}: {how_many(made.drive.size, 'sample')}, {made.mode} ({made.reason})")
    if math.isfinite(made.rms):
        print(
            f"predicted error {made.rms:.3g} {unit} rms where the target can be reached, after "
            "the approach from rest"
        )
    else:
        low, high = made.reach
        print(f"no target can be reached: the stage goes from {low:.3g} to {high:.3g} {unit}")
    if made.monotone_price:
        print(f"nearest monotone model: {made.monotone_price:.3g} {unit} rms from this one")
    for name, count in made.flagged.items():
        print(f"{how_many(count, 'sample')}: {name}")
