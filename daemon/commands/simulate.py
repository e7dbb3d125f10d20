"""run a model on a recording's drive"""

import argparse
import json
from pathlib import Path

from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.tools.prediction import outside_validity, predict, rms_error
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst simulate`."""
    parser.description = (
        "Add the model's displacement to a recording, as the column y_model_<unit>. Only the "
        "columns that the model reads are needed: t_s, the drive, and the channels of its blocks. "
        "The stage is taken as de-energised before the first row."
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
    error = rms_error(recording, y, unit)
    if args.json:
        print(
            json.dumps(
                {
                    "output": str(args.output),
                    "rows": recording.size,
                    "unit": unit,
                    "outside": outside,
                    "rms": error,
                },
                indent=2,
            )
        )
        return 0
    print(f"{args.output}: {recording.size} rows, column y_model_{unit}")
    if error is not None:
        print(f"against the measured displacement: {error:.4g} {unit} rms")
    for what, share in outside.items():
        if share > 0.0:
            print(f"note: {share:.1%} of the rows are outside the model's validity: {what}")
    return 0


def _columns(model: Model, recording: Recording, y: Floats) -> dict[str, Floats]:
    columns = {recording.drive_column: recording.drive}
    if recording.displacement is not None:
        columns[recording.displacement_column] = recording.displacement
    columns |= recording.channels
    columns[f"y_model_{model.displacement_unit}"] = y
    return columns
