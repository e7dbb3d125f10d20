"""Run a model on a recording's drive."""

import argparse
from pathlib import Path

from dehyst.daemon.files.foreign.reading import add_reading
from dehyst.daemon.files.given_recordings import read_one_given, say_converted
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.json_text import print_json
from dehyst.models.units import how_many

NEARLY_ALL = 0.9995
"""Least share of rows outside the validity that the note prints as 100.0 %."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst simulate`."""
    parser.description = (
        "Add the model's displacement to a recording, as the column y_model_<unit>. Only the "
        "columns that the model reads are needed: t_s, the drive, and the channels of its blocks. "
        "Without a measured displacement the stage is assumed to be de-energised before the first "
        "row. With one, the start (de-energised, from above or from below) is the one that fits "
        "best, and the error is also given for the rows that no longer depend on the start, and "
        "without its mean, as in diagnosis.json, because the gauge may have had another zero."
    )
    parser.epilog = "example: dehyst simulate stage.toml drive.csv -o predicted.csv"
    parser.add_argument("model", metavar="MODEL.toml", help="a file, or a shipped model by name")
    parser.add_argument("recording", type=Path, metavar="REC.csv")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.csv")
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Simulate and write; return 0."""
    check_outputs([args.output], [args.model, args.recording], args.force)
    # slow imports, which help and a refused file do not need
    from dehyst.daemon.api.functions import load_model, simulate

    model, recording = load_model(args.model), read_one_given(args.recording, args)
    say_converted([recording], model.displacement_unit)
    found = simulate(model, recording)
    found.save(args.output, force=args.force)
    error, unit, rows = found.error, found.unit, found.recording.size
    settled = error if error and error.rows_settled else None
    if args.json:
        said = {
            "output": str(args.output),
            "rows": rows,
            "unit": unit,
            "outside": found.outside,
            "band": found.band,
            "start": found.start,
            "rms": found.rms,
            "rms_settled": settled and settled.rms_settled,
            "settled_from_s": settled and settled.from_s,
            "offset": error and error.offset,
            "rms_without_offset": error and error.rms_without_offset,
            "rms_settled_without_offset": settled and settled.rms_settled_without_offset,
        }
        print_json(said)
        return 0
    print(f"{args.output}: {how_many(rows, 'row')}, column y_model_{unit}")
    if found.band is not None:
        if max(found.outside.values(), default=0.0) < NEARLY_ALL:
            print(
                f"95 % of the rows inside the model's validity are within +-{found.band:.4g} {unit}"
                ", apart from the gauge's noise and a constant offset"
            )
        else:
            print("no 95 % band: the drive is outside the model's validity")
    if error is not None:
        print(f"against the measured displacement, start {found.start}: {found}")
    for what, share in found.outside.items():
        if share > 0.0:
            print(f"note: {share:.1%} of the rows are outside the model's validity: {what}")
    return 0
