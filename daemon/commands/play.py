"""Stream a trajectory to a running daemon."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.client.connection import add_connection, connect, print_json, say
from dehyst.daemon.files.outputs import check_outputs
from dehyst.models.errors import BadInput

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Status
    from dehyst.daemon.client.player import Played
    from dehyst.daemon.tools.learning import Lessons
    from dehyst.models.learning.passes import Outcome

EPILOG = """The file has the columns t_s and target_um (or the daemon's own unit); further columns
are ignored. Targets count from the daemon's set-point origin. The trajectory is checked against
the daemon's reach before anything moves.
With --learn the error of each pass corrects the targets of the next: what repeats goes, what the
gauge's noise adds does not come in. It needs a gauge, and acts beside the daemon's slow trim.
Exit 0: played to the end; 1: ended early, samples missing or out of reach; 2: refused or no daemon.

examples: dehyst play scan.csv --repeat 3
          dehyst play scan.csv --repeat 20 --learn --learned scan.learned.json
          dehyst play scan.csv --repeat 0 --learn       (until Ctrl-C)
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
    parser.add_argument(
        "--repeat",
        "--loop",
        dest="repeat",
        type=int,
        default=1,
        metavar="N",
        help="play it N times; 0: until Ctrl-C",
    )
    parser.add_argument(
        "--learn", action="store_true", help="correct each pass by what the ones before have shown"
    )
    parser.add_argument(
        "--learned",
        type=Path,
        metavar="FILE",
        help="take up what was learned, and save it; belongs to one model and one trajectory "
        "(implies --learn)",
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="PNG",
        help="error by pass, before and after (default with --learn: TRAJECTORY-learned.png)",
    )
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
    from dehyst.daemon.tools.learning import play_learning

    learn = args.learn or args.learned is not None
    picture = args.picture or Path(f"{Path(args.trajectory).name.partition('.')[0]}-learned.png")
    check_asked(args, learn, picture)
    trajectory = read_trajectory(args.trajectory, min_rows=2, column=args.column)
    with connect(args, "play") as client:
        status = client.status()
        if trajectory.unit != status.unit:
            raise BadInput(
                f"{args.trajectory}: the targets are in {trajectory.unit}, the daemon "
                f"{client.name} takes {status.unit}; convert the column"
            )
        target = trajectory.target + args.offset_um
        if not args.allow_unreachable:
            check_reach(target, status, args.offset_um)
        if args.take_over:
            client.take_over()
        jump = abs(float(trajectory.target[-1] - trajectory.target[0]))
        if args.repeat != 1 and jump > 0.01 * float(np.ptp(trajectory.target)):
            say(
                f"the trajectory ends {jump:g} {status.unit} from where it begins: every "
                "repetition starts with that step, held back by the slew limit"
            )
        with progress_bar(f"playing {trajectory.name}") as progress:

            def shown(at_s: float, total_s: float) -> None:
                progress(min(1.0, at_s / total_s))

            if not learn:
                played = client.play(
                    trajectory.t_s, target, args.allow_unreachable, shown, repeat=args.repeat
                )
                return report(played, args.json)
            lessons = play_learning(
                client,
                trajectory.t_s,
                target,
                args.repeat,
                args.learned,
                lambda one: say(words(one, status.unit)),
                args.allow_unreachable,
                shown,
            )
    draw(lessons, picture, status.unit)
    return report(lessons.played, args.json, lessons.outcomes)


def check_asked(args: argparse.Namespace, learn: bool, picture: Path) -> None:
    """BadInput where the options do not go together, or a file would be lost."""
    if args.repeat < 0:
        raise BadInput(f"--repeat {args.repeat}: 1 is the least, 0 is until stopped")
    if args.picture and not learn:
        raise BadInput("--picture goes with --learn")
    if learn and args.repeat == 1 and not args.learned:
        raise BadInput("--learn needs more than one pass: give --repeat N, or --learned FILE")
    if learn:
        check_outputs([args.learned, picture], [args.trajectory, args.credentials], False)


def words(one: "Outcome", unit: str) -> str:
    """One pass in a line."""
    text = f"pass {one.number}: error {one.rms:.3g} {unit} rms without the noise"
    text += f", mean {one.mean:+.2g}"
    if one.learned:
        text += f"; learned up to {one.width_hz:.3g} Hz"
    return text + (f"; {one.says}" if one.says else "")


def draw(lessons: "Lessons", path: Path, unit: str) -> None:
    """The picture at the end, where there was a pass."""
    from dehyst.daemon.files.outputs import whole_file
    from dehyst.daemon.report.learning import learning_picture

    if not lessons.errors:
        return
    try:
        with whole_file(path) as file:
            file.write(learning_picture(lessons.outcomes, lessons.errors, lessons.period_s, unit))
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from None
    say(f"error by pass, before and after: {path}")


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


def report(played: "Played", as_json: bool, outcomes: "Sequence[Outcome]" = ()) -> int:
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
    if outcomes:
        result["passes"] = [asdict(one) for one in outcomes]
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
