"""run a model on a recording's drive"""

import argparse
import json
from pathlib import Path

from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.tools.prediction import Misfit, misfit, outside_validity, predict
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording

SAME = 0.02
"""Two rms errors that differ by less are not both told."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst simulate`."""
    parser.description = (
        "Add the model's displacement to a recording, as the column y_model_<unit>. Only the "
        "columns that the model reads are needed: t_s, the drive, and the channels of its blocks. "
        "The stage is taken as de-energised before the first row; where it was not, the error is "
        "also given for the rows that no longer depend on that."
    )
    parser.epilog = "example: dehyst simulate stage.toml drive.csv -o predicted.csv"
    parser.add_argument("model", metavar="MODEL.toml", help="a file, or a shipped model by name")
    parser.add_argument("recording", type=Path, metavar="REC.csv")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.csv")
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="what was done as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Simulate and write; 0."""
    check_outputs([args.output], [args.model, args.recording], args.force)
    model = load_model(args.model)
    recording = read_recording(args.recording, min_rows=1)
    y = predict(model, recording)
    write_recording(
        args.output, recording.t_s, _columns(model, recording, y), dict(recording.metadata)
    )
    outside = outside_validity(model, recording)
    unit = model.displacement_unit
    error = misfit(model, recording, y)
    if args.json:
        print(
            json.dumps(
                {
                    "output": str(args.output),
                    "rows": recording.size,
                    "unit": unit,
                    "outside": outside,
                    "band": model.fit.band,
                    "rms": error and error.rms,
                    "rms_settled": error and (error.rms_settled if error.rows_settled else None),
                    "settled_from_s": error and (error.from_s if error.rows_settled else None),
                },
                indent=2,
            )
        )
        return 0
    print(f"{args.output}: {recording.size} rows, column y_model_{unit}")
    if model.fit.band is not None:
        print(f"95 % of it within +-{model.fit.band:.4g} {unit}, inside the model's validity")
    if error is not None:
        print(f"against the measured displacement: {describe(error, unit)}")
    for what, share in outside.items():
        if share > 0.0:
            print(f"note: {share:.1%} of the rows are outside the model's validity: {what}")
    return 0


def describe(error: Misfit, unit: str) -> str:
    """The error, and over which rows it is."""
    whole = f"{error.rms:.4g} {unit} rms over all {error.rows} rows"
    if not error.rows_settled:
        return f"{whole}; all of them depend on how the stage stood before, which is not known"
    if abs(error.rms_settled - error.rms) < SAME * error.rms:
        return whole
    return (
        f"{whole}; {error.rms_settled:.4g} {unit} rms over the {error.rows_settled} from "
        f"{error.from_s:.4g} s on, which no longer depend on how the stage stood before the first"
    )


def _columns(model: Model, recording: Recording, y: Floats) -> dict[str, Floats]:
    columns = {recording.drive_column: recording.drive}
    if recording.displacement is not None:
        columns[recording.displacement_column] = recording.displacement
    columns |= recording.channels
    columns[f"y_model_{model.displacement_unit}"] = y
    return columns
