"""play a drive in volts open loop and record what the stage does (before there is a model)"""

import argparse
import json
import signal
import sys

from dehyst.daemon.config import load_config
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.terminal.progress import progress_bar


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drive", metavar="DRIVE.csv", help="columns t_s, u_v (see dehyst excite)")
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.add_argument("-o", "--output", required=True, metavar="REC.csv")
    parser.add_argument(
        "--exercise",
        type=float,
        default=5.0,
        metavar="S",
        help="full loops before the recording, so that it has crept already (default: 5 s)",
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="result as JSON on stdout")
    parser.epilog = """Ctrl-C ends it: the output goes back to where it was, and what was recorded
is written.
Exit 0: the whole drive was recorded; 1: it ended before; 2: nothing was recorded.

example: dehyst acquire drive.csv --config stage.toml -o recording.csv"""


def run(args: argparse.Namespace) -> int:
    from dehyst.daemon.files.recordings import read_recording, write_recording
    from dehyst.daemon.tools.acquire import acquire

    check_outputs([args.output], [args.drive, args.config], args.force)
    config = load_config(args.config)
    check_outputs([args.output], [config.model.file], args.force)
    drive = read_recording(args.drive)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))
    with progress_bar("recording") as progress:
        recording, ended = acquire(
            config,
            drive.t_s,
            drive.drive,
            drive.drive_unit,
            args.exercise,
            progress,
            lambda: "it was interrupted" if stopped else "",
        )
    assert recording.displacement is not None
    write_recording(
        args.output,
        recording.t_s,
        {
            recording.drive_column: recording.drive,
            recording.displacement_column: recording.displacement,
        },
        {"source": f"dehyst acquire, {config.name}", "actuator": config.actuator.driver},
    )
    if args.json:
        print(json.dumps({"file": args.output, "samples": recording.size, "ended": ended}))
    else:
        early = f", before the drive's end: {ended}" if ended else ""
        print(f"{args.output}: {recording.size} samples{early}", file=sys.stderr)
        if defects := recording.defects():
            print(defects, file=sys.stderr)
    return 1 if ended else 0
