"""run a model on a recording's drive"""

import argparse
import json
from pathlib import Path

import numpy as np

from dehyst.daemon.files import load_model
from dehyst.daemon.recordings import read_recording, write_recording
from dehyst.models.cascade import channels_of, simulate
from dehyst.models.errors import BadInput
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
    parser.add_argument("--json", action="store_true", help="what was done as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Simulate and write; 0."""
    model = load_model(args.model)
    recording = read_recording(args.recording, min_rows=1)
    y = predict(model, recording)
    write_recording(
        args.output, recording.t_s, _columns(model, recording, y), dict(recording.metadata)
    )
    outside = outside_validity(model, recording)
    unit = model.displacement_unit
    error = _error(recording, y, unit)
    if args.json:
        print(json.dumps({"output": str(args.output), "rows": recording.size, "unit": unit,
                          "outside": outside, "rms": error}, indent=2))  # fmt: skip
        return 0
    print(f"{args.output}: {recording.size} rows, column y_model_{unit}")
    if error is not None:
        print(f"against the measured displacement: {error:.4g} {unit} rms")
    for what, share in outside.items():
        if share > 0.0:
            print(f"note: {share:.1%} of the rows are outside the model's validity: {what}")
    return 0


def predict(model: Model, recording: Recording) -> Floats:
    """(N,) displacement by the model. NaN where the drive or a channel that it reads is missing.

    The plays pass over missing rows; nothing is filled in. Raises BadInput on other units or
    missing channels.
    """
    if model.drive_unit != recording.drive_unit:
        raise BadInput(
            f"{recording.name}: the drive is in {recording.drive_unit}, the model's in "
            f"{model.drive_unit}"
        )
    needed = channels_of(model)
    absent = [name for name in needed if name not in recording.channels]
    if absent:
        raise BadInput(
            f"{recording.name}: the model reads the channel {absent[0]}, which is absent"
        )
    known = ~recording.missing_drive
    for name in needed:
        known &= ~np.isnan(recording.channels[name])
    if not known.any():
        raise BadInput(f"{recording.name}: no row has all that the model reads")
    channels = {name: recording.channels[name][known] for name in needed}
    out = np.full(recording.size, np.nan)
    out[known] = simulate(model, recording.t_s[known], recording.drive[known], channels)
    return out


def outside_validity(model: Model, recording: Recording) -> dict[str, float]:
    """Share of the rows that leave the model's drive range and its rate range."""
    v, u = model.validity, recording.drive
    margin = 1e-6 * (v.drive_max - v.drive_min)
    with np.errstate(invalid="ignore"):
        drive = (u < v.drive_min - margin) | (u > v.drive_max + margin)
        rate = np.abs(np.diff(u)) / np.diff(recording.t_s)
        fast = rate > v.rate_max * (1 + 1e-6) if v.rate_max else np.zeros(1, dtype=bool)
    return {"drive": float(np.mean(drive)), "rate": float(np.mean(fast)) if fast.size else 0.0}


def _columns(model: Model, recording: Recording, y: Floats) -> dict[str, Floats]:
    columns = {recording.drive_column: recording.drive}
    if recording.displacement is not None:
        columns[recording.displacement_column] = recording.displacement
    columns |= recording.channels
    columns[f"y_model_{model.displacement_unit}"] = y
    return columns


def _error(recording: Recording, y: Floats, unit: str) -> float | None:
    if recording.displacement is None or recording.displacement_unit != unit:
        return None
    error = recording.displacement - y
    known = error[~np.isnan(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None
