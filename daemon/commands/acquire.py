"""play a drive in volts open loop and record what the stage does (before there is a model)"""

import argparse
import json
import sys

from dehyst.daemon.config import load_config
from dehyst.daemon.progress import progress_bar


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("drive", metavar="DRIVE.csv", help="columns t_s, u_v (see dehyst excite)")
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.add_argument("-o", "--output", required=True, metavar="REC.csv")
    parser.add_argument(
        "--exercise", type=float, default=5.0, metavar="S",
        help="full loops before the recording, so that it has crept already (default: 5 s)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="result as JSON on stdout")
    parser.epilog = "example: dehyst acquire drive.csv --config stage.toml -o recording.csv"


def run(args: argparse.Namespace) -> int:
    from dehyst.daemon.acquire import acquire
    from dehyst.daemon.recordings import read_recording, write_recording

    config = load_config(args.config)
    drive = read_recording(args.drive)
    with progress_bar("recording") as progress:
        recording = acquire(
            config, drive.t_s, drive.drive, drive.drive_unit, args.exercise, progress
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
        print(json.dumps({"file": args.output, "samples": recording.size}))
    else:
        print(f"{args.output}: {recording.size} samples", file=sys.stderr)
        if defects := recording.defects():
            print(defects, file=sys.stderr)
    return 0
