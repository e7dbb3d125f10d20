"""Stream a trajectory to a running daemon."""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.client.connection import add_connection, connect, connect_axes, say
from dehyst.daemon.client.group import Group
from dehyst.daemon.files.foreign.reading import add_reading, reading_of
from dehyst.daemon.files.outputs import add_force, check_outputs, file_of_axis, report_failures
from dehyst.daemon.json_text import print_json
from dehyst.models.errors import BadInput

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Status
    from dehyst.daemon.client.client import Client
    from dehyst.daemon.client.play_learning import Lessons
    from dehyst.daemon.client.player import Played
    from dehyst.models.learning.passes import Outcome
    from dehyst.models.recording import Floats

LONGEST_FILTER_S = 0.1  # a larger number was probably given in ms or us
EPILOG = """The file has the columns t_s and target_um (or the daemon's own unit); further columns
are ignored. With target_x_um, target_y_um ... it moves several axes of one controller: they start
on the same sample and hold together, and the lease covers all of them or none.
Targets are relative to the daemon's set-point origin. The trajectory is checked against
the daemon's reach before anything moves.
With --learn the error of each pass corrects the targets of the next: the repeating error falls,
and the gauge's noise is filtered out. This needs a gauge, and works together with the slow trim.
At the end the stage holds its last point as after `dehyst send`; --stay keeps it there.

exit status: 0: played to the end; 1: ended early, samples missing or out of reach; 2: refused, or
no daemon.

examples: dehyst play scan.csv --repeat 3
          dehyst play scan.csv --repeat 20 --learn --learned scan.learned.json
          dehyst play scan.csv --repeat 0 --learn       (until Ctrl-C)
          dehyst play raster.csv --to stage-1
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst play`."""
    parser.epilog = EPILOG
    parser.add_argument("trajectory", metavar="TRAJECTORY.csv")
    parser.add_argument(
        "--column", default="", help="column with the targets (default: target_um or similar)"
    )
    parser.add_argument(
        "--offset-um",
        default="",
        metavar="X",
        help="added to every target (in the daemon's displacement unit); several axes: x=1.5,y=-2",
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
        "--learn", action="store_true", help="correct each pass by the errors of earlier passes"
    )
    parser.add_argument(
        "--learned",
        type=Path,
        metavar="FILE",
        help="continue from the learned correction in this file, and save it; it belongs to one "
        "model and one trajectory (implies --learn)",
    )
    parser.add_argument(
        "--gauge-filter-s",
        type=float,
        default=0.0,
        metavar="TAU",
        help="time constant of the gauge's filter, from its data sheet: --learn then compensates "
        "the filter's lag on a ringing stage",
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="PNG",
        help="picture of the error by pass (default with --learn: TRAJECTORY-learned.png, which "
        "each run replaces)",
    )
    parser.add_argument(
        "--allow-unreachable",
        action="store_true",
        help="play it even where it leaves the reach: the daemon moves to the nearest position "
        "and flags each such sample",
    )
    parser.add_argument(
        "--stay",
        action="store_true",
        help="stay at the last point until another command, with no client",
    )
    parser.add_argument(
        "--take-over", action="store_true", help="take the command from another client"
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    add_reading(parser)
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Check, stream, wait for the end, report; return the exit status."""
    from dehyst.daemon.files.given_recordings import say_read
    from dehyst.daemon.files.trajectories import read_trajectories

    learn = args.learn or args.learned is not None
    picture = args.picture or Path(f"{Path(args.trajectory).name.partition('.')[0]}-learned.png")
    trajectories = read_trajectories(
        args.trajectory, min_rows=2, column=args.column, reading=reading_of(args)
    )
    say_read(next(iter(trajectories.values())).read)
    offsets = offsets_of(args.offset_um, trajectories)
    pictures = {axis: file_of_axis(picture, axis) for axis in trajectories}
    learned = {axis: args.learned and file_of_axis(args.learned, axis) for axis in trajectories}
    check_asked(args, learn)
    if learn:
        check_written(args, list(learned.values()), list(pictures.values()))
    together = "" not in trajectories
    with (
        connect_axes(args, "play", list(trajectories)) if together else connect(args, "play")
    ) as stage:
        clients = stage.clients if isinstance(stage, Group) else {"": stage}
        targets = {}
        stage.wait_until_started(on_wait=say)
        for axis, trajectory in trajectories.items():
            clients[axis].report = say
            status = clients[axis].status()
            targets[axis] = trajectory.target + offsets[axis]
            check_units(args.trajectory, trajectory.unit, status)
            if not args.allow_unreachable:
                check_reach(targets[axis], status, offsets[axis], axis)
            if args.repeat != 1:
                say_of_step(trajectory.target, status, axis)
        if args.stay:
            check_may_stay(clients)
        if args.take_over:
            stage.take_over()
        t_s, name = next(iter(trajectories.values())).t_s, Path(args.trajectory).name
        with saying_when_interrupted(clients):
            if not learn:
                played = play_on_stage(stage, t_s, targets, args, name)
            else:
                lessons = learn_of(stage, t_s, targets, args, learned, name)
        if not learn:
            say_what_follows(clients, targets, args, played)
            return report_played(played, args.json)
        say_what_follows(clients, targets, args, {a: one.played for a, one in lessons.items()})
    for axis, one in lessons.items():
        draw_learning(one, pictures[axis], one.played.unit)
    return report_played(
        {axis: one.played for axis, one in lessons.items()},
        args.json,
        {axis: one.outcomes for axis, one in lessons.items()},
    )


def check_may_stay(clients: "Mapping[str, Client]") -> None:
    """Raise BadInput, before anything moves, if a daemon does not allow --stay."""
    for client in clients.values():
        if not client.config().setpoint.stay:
            raise BadInput(
                f"--stay: setpoint.stay is false in the configuration of {client.name}: a "
                "position is kept only while a client requests it; set it to true, and start the "
                "daemon again"
            )


def say_what_follows(
    clients: "Mapping[str, Client]",
    targets: "Mapping[str, Floats]",
    args: argparse.Namespace,
    played: "Mapping[str, Played]",
) -> None:
    """Stay at the last point if --stay was given, and print what the stage does now."""
    from dehyst.daemon.terminal.what_follows import STAYS, after_a_stop, what_follows

    for axis, client in clients.items():
        stays = args.stay and played[axis].completed
        if stays:
            client.send(float(targets[axis][-1]), args.allow_unreachable, stay=True)
        if not args.json:
            follows = what_follows if played[axis].completed else after_a_stop
            say(f"{client.name}: {STAYS if stays else follows(client.config())}")


@contextmanager
def saying_when_interrupted(clients: "Mapping[str, Client]") -> "Iterator[None]":
    """Print what the stage does after an interrupt, which has stopped it."""
    from dehyst.daemon.terminal.what_follows import after_a_stop

    after = {client.name: after_a_stop(client.config()) for client in clients.values()}
    try:
        yield
    except KeyboardInterrupt:
        for name, follows in after.items():
            say(f"{name}: stopped early; the stage {follows}")
        raise


def play_on_stage(
    stage: "Client | Group",
    t_s: "Floats",
    targets: "Mapping[str, Floats]",
    args: argparse.Namespace,
    name: str,
) -> "dict[str, Played]":
    """Stream the trajectory; return what was played, by axis."""
    with playing(name) as shown:
        if isinstance(stage, Group):
            return stage.play(t_s, targets, args.allow_unreachable, shown, repeat=args.repeat)
        played = stage.play(t_s, targets[""], args.allow_unreachable, shown, repeat=args.repeat)
        return {"": played}


def learn_of(
    stage: "Client | Group",
    t_s: "Floats",
    targets: "Mapping[str, Floats]",
    args: argparse.Namespace,
    learned: Mapping[str, Path | None],
    name: str,
) -> "dict[str, Lessons]":
    """Stream the trajectory and learn; return the results, by axis."""
    from dehyst.daemon.client.play_learning import Course, play_learning, play_learning_together

    def course(axis: str, client: "Client") -> Course:
        head, unit = f"{axis}: " if axis else "", client.status().unit

        def report(one: "Outcome") -> None:
            say(head + describe_pass(one, unit))

        return Course(
            client, t_s, targets[axis], args.repeat, learned[axis], report, args.gauge_filter_s
        )

    with playing(name) as shown:
        if isinstance(stage, Group):
            courses = {axis: course(axis, client) for axis, client in stage.clients.items()}
            return play_learning_together(stage, courses, args.allow_unreachable, shown)
        return {"": play_learning(stage, course("", stage), args.allow_unreachable, shown)}


@contextmanager
def playing(name: str) -> "Iterator[Callable[[float, float], None]]":
    """Show a progress bar; yield a function that takes the played and the total time [s]."""
    from dehyst.daemon.terminal.progress import progress_bar

    with progress_bar(f"playing {name}") as progress:
        yield lambda at_s, total_s: progress(min(1.0, at_s / total_s))


def offsets_of(given: str, axes: Iterable[str]) -> dict[str, float]:
    """Parse the offset that is added to each axis' targets from "1.5" or "x=1.5,y=-2". Raises
    BadInput."""
    names = list(axes)
    out = dict.fromkeys(names, 0.0)
    for part in filter(None, given.split(",")):
        axis, equals, number = part.rpartition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if axis not in out or not math.isfinite(value) or bool(equals) is (names == [""]):
            wanted = "a number" if names == [""] else f"{names[0]}=1.5,{names[-1]}=-2"
            raise BadInput(f"--offset-um {given}: write {wanted}")
        out[axis] = value
    return out


def check_units(file: str, unit: str, status: "Status") -> None:
    """Raise BadInput if the file's unit is not the daemon's."""
    if unit != status.unit:
        raise BadInput(
            f"{file}: the targets are in {unit}, the daemon "
            f"{status.name} takes {status.unit}; convert the column"
        )


def say_of_step(target: NDArray[np.float64], status: "Status", axis: str) -> None:
    """Warn if every repetition begins with a step."""
    jump = abs(float(target[-1] - target[0]))
    if jump > 0.01 * float(np.ptp(target)):  # a closed path may lack its last point
        say(
            f"the trajectory{' of ' + axis if axis else ''} ends {jump:g} {status.unit} from where "
            "it begins: every repetition starts with that step, limited only by the slew limit"
        )


def check_asked(args: argparse.Namespace, learn: bool) -> None:
    """Raise BadInput if options cannot be combined."""
    if args.repeat < 0:
        raise BadInput(f"--repeat {args.repeat}: give 1 or more, or 0 to play until stopped")
    if args.picture and not learn:
        raise BadInput("--picture goes with --learn")
    if args.gauge_filter_s and not learn:
        raise BadInput("--gauge-filter-s goes with --learn")
    if not 0.0 <= args.gauge_filter_s <= LONGEST_FILTER_S:
        raise BadInput(f"--gauge-filter-s: 0 to {LONGEST_FILTER_S:g} s, in seconds: 150e-6")
    if learn and args.repeat == 1 and not args.learned:
        raise BadInput("--learn needs more than one pass: give --repeat N, or --learned FILE")


def check_written(
    args: argparse.Namespace, learned: Sequence[Path | None], pictures: Sequence[Path]
) -> None:
    """Raise BadInput if a file would be overwritten; a learned correction is continued, and the
    picture without --picture is drawn again."""
    inputs = [args.trajectory, args.credentials]
    check_outputs(learned, inputs, force=True)
    check_outputs(pictures, [*inputs, *learned], args.force or not args.picture)


def describe_pass(one: "Outcome", unit: str) -> str:
    """Return a line about one pass."""
    text = f"pass {one.number}: error {one.rms:.3g} {unit} rms without the noise"
    text += f", mean {one.mean:+.2g}"
    if one.learned:
        text += f"; learned up to {one.width_hz:.3g} Hz"
    return text + (f"; {one.says}" if one.says else "")


def draw_learning(lessons: "Lessons", path: Path, unit: str) -> None:
    """Draw the picture of the error by pass, if there was a pass. Raises BadInput if it cannot be
    written."""
    from dehyst.daemon.files.outputs import whole_file
    from dehyst.daemon.report.learning import learning_picture

    if not lessons.errors:
        return
    with report_failures(path), whole_file(path) as file:
        file.write(learning_picture(lessons.outcomes, lessons.errors, lessons.period_s, unit))
    say(f"error by pass, before and after: {path}")


def check_reach(
    target: NDArray[np.float64], status: "Status", offset: float, axis: str = ""
) -> None:
    """Raise BadInput if targets are outside the daemon's reach, suggesting an offset or scaling."""
    low, high, unit = status.reach_min, status.reach_max, status.unit
    least, most = float(target.min()), float(target.max())
    if low <= least and most <= high:
        return
    outside = float(np.mean((target < low) | (target > high)))
    centred = offset + 0.5 * (low + high) - 0.5 * (least + most)
    advice = (
        f"--offset-um {axis + '=' if axis else ''}{centred:.6g} would centre it"
        if most - least <= high - low
        else f"it spans {most - least:.6g} {unit}, more than the stage's {high - low:.6g}: scale it"
    )
    of = f"axis {axis}: the " if axis else "the "
    raise BadInput(
        f"{of}trajectory goes from {least:.6g} to {most:.6g} {unit}, the "
        "stage reaches "
        f"{low:.6g} to {high:.6g} ({100 * outside:.3g} % of the points do not fit); {advice}, or "
        "--allow-unreachable plays it with these points flagged"
    )


def report_played(
    played: "Mapping[str, Played]",
    as_json: bool,
    outcomes: "Mapping[str, Sequence[Outcome]] | None" = None,
) -> int:
    """Print the result of each axis; return the exit code."""
    from dehyst.daemon.client.played_summary import describe_played, list_figures

    results = {axis: list_figures(one) for axis, one in played.items()}
    for axis, passes in (outcomes or {}).items():
        results[axis]["passes"] = [asdict(one) for one in passes]
    alone = "" in played
    if as_json:
        done = all(one.completed for one in played.values())
        print_json(results[""] if alone else {"completed": done, "axes": results})
    else:
        for axis, one in played.items():
            print("\n".join(describe_played(one, axis)))
    bad = [
        one
        for one in played.values()
        if not (one.completed and one.tracking.complete) or one.lost or one.tracking.unreachable
    ]
    return 1 if bad else 0
