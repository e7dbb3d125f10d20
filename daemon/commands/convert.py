"""write a recording in another kind of file"""

import argparse
import json
from pathlib import Path

from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.files.recordings import SUFFIXES, WRITTEN, read_columns, write_recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst convert`."""
    parser.description = (
        "Write a recording or a trajectory in another kind of file; the suffix says which. Every "
        f"column is kept, to the last bit. Read: {', '.join(SUFFIXES)}; written: "
        f"{', '.join(WRITTEN)}. MCAP opens in Foxglove and PlotJuggler."
    )
    parser.epilog = "example: dehyst convert run.csv run.mcap"
    parser.add_argument("input", type=Path, metavar="IN")
    parser.add_argument("output", type=Path, metavar="OUT")
    parser.add_argument(
        "--unfinished",
        action="store_true",
        help="keep the complete part of an .mcap whose writer was killed or met a full disk",
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print what was done as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Read and write; 0."""
    check_outputs([args.output], [args.input], args.force)
    columns, notes = read_columns(args.input, args.unfinished)
    t_s = columns.pop("t_s")
    write_recording(args.output, t_s, columns, notes)
    names = ["t_s", *columns]
    if args.json:
        print(json.dumps({"output": str(args.output), "rows": int(t_s.size), "columns": names}))
    else:
        print(f"{args.output}: {t_s.size} rows of {', '.join(names)}")
    return 0
