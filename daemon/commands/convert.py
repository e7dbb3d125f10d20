"""Write a recording in another file format."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from dehyst.daemon.files.foreign.reading import add_reading, reading_of
from dehyst.daemon.files.given_recordings import say_defects, say_read
from dehyst.daemon.files.outputs import add_force, check_outputs, file_of_axis
from dehyst.daemon.files.recordings import SUFFIXES, WRITTEN, read_parts, write_recording
from dehyst.models.units import how_many


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst convert`."""
    parser.description = (
        "Convert a recording or a trajectory to another file format; the suffix selects it. Every "
        f"column is kept with full precision. Formats read: {', '.join(SUFFIXES)}; written: "
        f"{', '.join(WRITTEN)}. Foxglove and PlotJuggler open MCAP. If the clock went back, the "
        "file is cut there: OUT-part1.csv, OUT-part2.csv, ..."
    )
    parser.epilog = "example: dehyst convert run.csv run.mcap"
    parser.add_argument("input", type=Path, metavar="IN")
    parser.add_argument("output", type=Path, metavar="OUT")
    parser.add_argument(
        "--unfinished",
        action="store_true",
        help="keep the complete part of a file whose writer was killed or ran out of disk space",
    )
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Read and write; return 0."""
    reading = reading_of(args)
    parts, understood = read_parts(args.input, args.unfinished, reading)
    outputs = [args.output]
    if len(parts) > 1:
        outputs = [file_of_axis(args.output, f"part{i}") for i in range(1, len(parts) + 1)]
    check_outputs(outputs, [args.input], args.force)
    say_read(understood)
    written = []
    for output, (columns, notes) in zip(outputs, parts, strict=True):
        t_s = columns["t_s"]
        others = {name: values for name, values in columns.items() if name != "t_s"}
        write_recording(output, t_s, others, notes)
        say_defects(output.name if len(parts) > 1 else args.input.name, columns)
        names = ["t_s", *others]
        if understood and not any(name.startswith("target") for name in names):
            say_read(what_is_missing(output.name, names))
        written.append({"output": str(output), "rows": int(t_s.size), "columns": names})
        if not args.json:
            print(f"{output}: {how_many(t_s.size, 'row')} of {', '.join(names)}")
    if args.json:
        print(json.dumps(written[0] if len(written) == 1 else {"parts": written}))
    return 0


def what_is_missing(name: str, columns: Sequence[str]) -> str:
    """Return a note if no column of a file of another program became the drive or displacement."""
    roles = {"u": "drive", "y": "displacement"}
    missing = [role for role in roles if not any(c.startswith(f"{role}_") for c in columns)]
    if not missing:
        return ""
    return (
        f"note: {name} has no {' and no '.join(roles[role] for role in missing)}, which identify, "
        "validate and diagnose need"
    )
