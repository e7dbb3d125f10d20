"""Stream a trajectory to a running daemon."""

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.client.connection import add_connection, connect, print_json, say
from dehyst.models.errors import BadInput

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Status
    from dehyst.daemon.client.player import Played

EPILOG = """The file has the columns t_s and target_um (or the daemon's own unit); further columns
are ignored. Targets count from the daemon's set-point origin. The trajectory is checked against
the daemon's reach before anything moves.
Exit 0: played to the end; 1: ended early, samples missing or out of reach; 2: refused or no daemon.

example: dehyst play scan.csv --loop 3
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst play`."""
    parser.epilog = EPILOG
    parser.add_argument("trajectory", metavar="TRAJECTORY.csv")
    parser.add_argument(
        "--column", default="", help="column with the targets (default: target_um or its like)"
    )
    parser.add_argument(
        "--offset-um",
        type=float,
        default=0.0,
        metavar="X",
        help="added to every target (in the daemon's displacement unit)",
    )
    parser.add_argument("--loop", type=int, default=1, metavar="N", help="play it N times")
    parser.add_argument(
        "--allow-unreachable",
        action="store_true",
        help="play it even where it leaves the reach: the daemon goes as near as it can and flags "
        "every such sample",
    )
    parser.add_argument(
        "--take-over", action="store_true", help="take the command from another client"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Check, stream, wait for the end, report."""
    from dehyst.daemon.files.recordings import read_trajectory
    from dehyst.daemon.terminal.progress import progress_bar

    trajectory = read_trajectory(args.trajectory, min_rows=2, column=args.column)
    with connect(args, "play") as client:
        status = client.status()
        if trajectory.unit != status.unit:
            raise BadInput(
                f"{args.trajectory}: the targets are in {trajectory.unit}, the daemon "
                f"{client.name} takes {status.unit}; convert the column"
            )
        t_s, target = looped(trajectory.t_s, trajectory.target + args.offset_um, args.loop)
        if not args.allow_unreachable:
            check_reach(target, status, args.offset_um)
        if args.take_over:
            client.take_over()
        jump = abs(float(trajectory.target[-1] - trajectory.target[0]))
        if args.loop > 1 and jump > 0.01 * float(np.ptp(trajectory.target)):
            say(
                f"the trajectory ends {jump:g} {status.unit} from where it begins: every "
                "repetition starts with that step, held back by the slew limit"
            )
        with progress_bar(f"playing {trajectory.name}") as progress:
            played = client.play(
                t_s,
                target,
                args.allow_unreachable,
                progress=lambda at_s, total_s: progress(min(1.0, at_s / total_s)),
            )
    return report(played, args.json)


def looped(
    t_s: NDArray[np.float64], target: NDArray[np.float64], times: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The trajectory so many times in a row, one typical step between."""
    if times < 1:
        raise BadInput(f"--loop {times}: once is the least")
    begun = t_s - t_s[0]
    length = begun[-1] + float(np.median(np.diff(begun)))
    return np.concatenate([begun + i * length for i in range(times)]), np.tile(target, times)


def check_reach(target: NDArray[np.float64], status: "Status", offset: float) -> None:
    """BadInput where targets are outside the daemon's reach, with what would fit."""
    low, high, unit = status.reach_min, status.reach_max, status.unit
    least, most = float(target.min()), float(target.max())
    if low <= least and most <= high:
        return
    outside = float(np.mean((target < low) | (target > high)))
    centred = offset + 0.5 * (low + high) - 0.5 * (least + most)
    advice = (
        f"--offset-um {centred:.6g} would centre it"
        if most - least <= high - low
        else f"it spans {most - least:.6g} {unit}, more than the stage's {high - low:.6g}: scale it"
    )
    raise BadInput(
        f"the trajectory goes from {least:.6g} to {most:.6g} {unit}, the stage reaches "
        f"{low:.6g} to {high:.6g} ({100 * outside:.3g} % of the points do not fit); {advice}, or "
        "--allow-unreachable plays it with these points flagged"
    )


def report(played: "Played", as_json: bool) -> int:
    """Print the result; the exit code."""
    tracking, unit = played.tracking, played.unit
    result: dict[str, Any] = {
        "completed": played.completed,
        "reason": played.reason,
        "unit": unit,
        "duration_s": played.duration_s,
        "samples": tracking.samples,
        "expected_samples": tracking.expected,
        "lost_telemetry_samples": played.lost,
        "rms_error": tracking.rms_error,
        "max_error": tracking.max_error if tracking.valid else float("nan"),
        "unreachable_samples": tracking.unreachable,
        "slew_limited_samples": tracking.slew_limited,
        "outside_validity_samples": tracking.outside_validity,
        "invalid_sensor_samples": tracking.invalid,
        "fallback_samples": tracking.dry,
        "missed_deadlines": tracking.missed,
        "state": played.state,
    }
    if as_json:
        print_json(result)
    else:
        end = "played to the end" if played.completed else f"ended early: {played.reason}"
        print(f"{end}; {tracking.samples} of {tracking.expected} samples, {played.lost} lost")
        print(
            f"tracking error: rms {result['rms_error']:.4g} {unit}, largest "
            f"{result['max_error']:.4g} {unit}"
        )
        print(
            f"unreachable {tracking.unreachable}, slew-limited {tracking.slew_limited}, outside "
            f"the model's validity {tracking.outside_validity}, without a reading "
            f"{tracking.invalid}, inverse fell back {tracking.dry}, missed deadlines "
            f"{tracking.missed}"
        )
    whole = played.completed and tracking.complete and not played.lost
    return 0 if whole and not tracking.unreachable else 1
