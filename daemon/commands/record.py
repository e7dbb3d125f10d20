"""Record a running daemon's telemetry into a file."""

import argparse
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dehyst import __version__
from dehyst.daemon.client.connection import add_connection, connect_axes, say
from dehyst.daemon.files.outputs import add_force, check_outputs, file_of_axis
from dehyst.daemon.json_text import print_json
from dehyst.daemon.rings.records import Flag
from dehyst.daemon.terminal.number_options import positive
from dehyst.models.errors import BadInput, NotNow
from dehyst.models.units import how_many

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Status
    from dehyst.daemon.client.client import Client
    from dehyst.daemon.client.telemetry import TelemetryStream
    from dehyst.daemon.files.recorder import OtherAxis, Recorder

# how long after the planned end the last telemetry may come; wait for a loop that is starting
LATE_S, LOOP_S = 10.0, 60.0
EPILOG = """\
The columns are t_s, the drive in the model's unit (u_v), the measured displacement (y_um), the
target (target_um), trim_um, learned_um, missed and flags; `dehyst identify` reads the file.
On a controller with several axes each axis gets its own file (run-x.csv, run-y.csv), with the
displacements and drives of the other axes (axis_y_um, axis_y_drive_v).
Displacements are relative to the daemon's set-point origin; with --frame model they are relative to
the model's own zero, for identifying a new model for the same configuration. Missing samples are
fetched from the daemon's history; samples that are no longer there leave a gap in t_s.
Ctrl-C ends the recording.

The suffix selects the format: .csv grows line by line and can be read at any time, with the
metadata in NAME.csv.meta.json; .csv.gz grows in blocks; .mcap opens in Foxglove and PlotJuggler;
.npz is written at the end. For recordings of days or weeks, --rotate begins a new piece
(run-00001.mcap, ...) after that time or size, with t_s continuing, and --keep deletes the oldest
pieces of this recording when the total would exceed that size; with --force, also those of earlier
recordings of the same name.
Exit 0: every sample written; 1: samples are missing; 2: no daemon, or the file cannot be written.

examples: dehyst record -o run.csv --for 60
          dehyst record -o run.mcap --rotate 10min --keep 200GB
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst record`."""
    parser.epilog = EPILOG
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="REC")
    parser.add_argument(
        "--for", dest="seconds", type=positive, metavar="S", help="seconds to record"
    )
    parser.add_argument(
        "--frame",
        choices=("setpoint", "model"),
        default="setpoint",
        help="zero of the displacements (default: setpoint)",
    )
    parser.add_argument("--rotate", metavar="TIME|SIZE", help="e.g. 10min, 1h, 500MB")
    parser.add_argument(
        "--keep", metavar="SIZE", help="with --rotate: largest total size on the disk, e.g. 20GB"
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Record until --for, SIGINT or SIGTERM."""
    from dehyst.daemon import clock
    from dehyst.daemon.files.joined import JoinedTelemetry, at_the_same_time
    from dehyst.daemon.files.pieces import parse_rotation
    from dehyst.daemon.files.recorder import Recorder
    from dehyst.daemon.files.rows import check_kind

    if args.keep and not args.rotate:
        raise BadInput("--keep goes with --rotate: it deletes whole pieces")
    rotation = parse_rotation(args.rotate, args.keep, args.force) if args.rotate else None
    check_kind(args.output)
    check_outputs([args.output], [args.credentials], args.force)
    ending: list[int] = []
    until_s = args.seconds if args.seconds is not None else float("inf")
    with connect_axes(args, "record") as stage, ExitStack() as opened:
        stage.wait_until_started(on_wait=say)
        # from here on, a signal first closes the files; during the wait there is nothing to close
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, _: ending.append(number))
        axes = {axis: Recorded(client, ending) for axis, client in stage.clients.items()}
        alone = len(axes) == 1
        recorders = {
            axis: opened.enter_context(
                Recorder(
                    args.output if alone else file_of_axis(args.output, axis),
                    one.gain,
                    one.units,
                    one.origin(args.frame),
                    notes(one.status, args.frame),
                    replace=args.force and rotation is None,
                    rotation=rotation,
                    others=[
                        other.beside(name, args.frame)
                        for name, other in axes.items()
                        if name != axis
                    ],
                )
            )
            for axis, one in axes.items()
        }
        joined = JoinedTelemetry(list(axes))
        begun_ns = heard_ns = clock.monotonic_ns()
        done = quiet = late = False
        while not (ending or done or late):
            came = 0
            for axis, one in axes.items():
                samples = one.stream.read(0.1 / len(axes))
                joined.add(axis, samples)
                came += samples.size
            parts = joined.take()
            for axis, file in recorders.items():
                others = {
                    name: at_the_same_time(parts[axis], parts[name])
                    for name in axes
                    if name != axis
                }
                done |= file.add(parts[axis], until_s, axes[axis].stream.wall_offset_ns, others)
            now_ns = clock.monotonic_ns()
            late = (now_ns - begun_ns) / clock.NS > until_s + LATE_S
            if came:
                heard_ns, quiet = now_ns, False
            elif not quiet and now_ns - heard_ns > 5 * clock.NS:
                quiet = True
                say("no telemetry for 5 s; waiting")
        opened.close()
    results = {
        axis: outcome(file, axes[axis].stream, late, rotation is not None)
        for axis, file in recorders.items()
    }
    return report_recorded(results, args.json)


class Recorded:
    """One axis being recorded. ending: filled by a signal; not empty if recording must end."""

    def __init__(self, client: "Client", ending: list[int]) -> None:
        self.status, self.stream = known_status(client, ending), client.stream()
        self.gain = client.config().actuator.gain
        self.units = (self.status.drive_unit, self.status.unit)

    def origin(self, frame: str) -> float:
        """Return the offset added to its displacements, which are counted from the set-point origin
        or, with frame "model", from the model's own zero."""
        return self.status.origin if frame == "model" else 0.0

    def beside(self, axis: str, frame: str) -> "OtherAxis":
        """Return the description of this axis for the recordings of the other axes."""
        from dehyst.daemon.files.recorder import OtherAxis

        return OtherAxis(axis, self.gain, *self.units, self.origin(frame))


def outcome(
    file: "Recorder", stream: "TelemetryStream", late: bool, pieces: bool
) -> dict[str, Any]:
    """Return the result for one file."""
    made = {"pieces": [str(p) for p in file.pieces.made], "dropped": file.pieces.dropped}
    return {
        "file": str(file.path),
        "samples": file.rows,
        "seconds": file.time_s,
        "lost_samples": stream.lost,
        "gaps": file.gaps,
        "ended_early": "no telemetry came for the rest of the time" if late else "",
        "fetched_from_history": stream.recovered,
        **(made if pieces else {}),
        "complete": not (stream.lost or file.gaps or late) and file.rows > 0,
    }


def known_status(client: "Client", ending: list[int]) -> "Status":
    """Wait until the status contains the loop's units, which a gateway that has just started does
    not know yet, and return it. Raises NotNow if they do not come or `ending` is set."""
    from dehyst.daemon import clock

    end_ns = clock.monotonic_ns() + round(LOOP_S * clock.NS)
    while not (status := client.status()).drive_unit:
        if ending or clock.monotonic_ns() > end_ns:
            raise NotNow("the daemon's loop is not running yet; nothing was recorded")
        clock.sleep_s(0.1)
    return status


def notes(status: "Status", frame: str) -> dict[str, str]:
    """Return the notes for the head of the file."""
    return {
        "recorded_by": f"dehyst {__version__} from the daemon {status.name}",
        "period_s": repr(status.period_ns / 1e9),
        "setpoint_origin": f"{status.origin!r} {status.unit} in the model's own displacement",
        "displacements": "from the set-point origin"
        if frame == "setpoint"
        else "from the model's own zero (set-point plus origin)",
        "flags": ", ".join(f"{flag.value} {flag.name}".lower() for flag in Flag),
    }


def report_recorded(results: dict[str, dict[str, Any]], as_json: bool) -> int:
    """Print the result of each axis; return the exit code."""
    if as_json:
        print_json(results if len(results) > 1 else next(iter(results.values())))
    else:
        for result in results.values():
            lost, fetched = result["lost_samples"], result["fetched_from_history"]
            say(
                f"{result['file']}: {how_many(result['samples'], 'sample')}, "
                f"{result['seconds']:.3f} s; {lost} lost"
                + (f", {fetched} fetched from the history" if fetched else "")
                + (f"; {how_many(result['gaps'], 'gap')} in the times" if result["gaps"] else "")
                + (f"; {result['ended_early']}" if result["ended_early"] else "")
            )
    return 0 if all(result["complete"] for result in results.values()) else 1
