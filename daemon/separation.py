"""`dehyst excite --separate A B`: the drive that tells two candidates apart, into a file."""

import argparse
import json

from dehyst.daemon.files import load_model
from dehyst.daemon.recordings import write_recording
from dehyst.models.diagnosis.experiment import EFFECTS, Experiment, separate
from dehyst.models.diagnosis.waveforms import Limits
from dehyst.models.errors import BadInput
from dehyst.models.model import Model

SECONDS, SPANS_PER_S = 20.0, 200.0  # where the user says nothing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """--separate and --model, beside the range, sampling, duration and slew of `dehyst excite`."""
    parser.add_argument(
        "--separate",
        nargs=2,
        metavar=("A", "B"),
        help=f"design the drive that tells effect A from B: {', '.join(EFFECTS)}",
    )
    parser.add_argument("--model", metavar="MODEL.toml", help="the stage's model, for --separate")


def write_separation(args: argparse.Namespace) -> int:
    """Design, write the drive (`t_s`, `u_<unit>`), say what it is worth on stdout.

    Range and unit come from --range and --unit, else from the model. Raises BadInput on unknown
    names or limits that leave nothing.
    """
    a, b = args.separate
    model = load_model(args.model) if args.model else None
    if args.output is None:
        raise BadInput("--output missing; --separate needs -o DRIVE.csv")
    if args.range is None and model is None:
        raise BadInput("--range missing; --separate needs the drive's range or --model")
    valid = model.validity if model else None
    low, high = args.range or (valid.drive_min, valid.drive_max)  # type: ignore[union-attr]
    if not args.sampling > 0:
        raise BadInput(f"--sampling: must be greater than 0, not {args.sampling:g}")
    rate = args.slew or SPANS_PER_S * (high - low)
    limits = Limits(low, high, rate, 1.0 / args.sampling, args.duration or SECONDS)
    experiment = separate(a, b, limits, model)
    unit = model.drive_unit if model else args.unit
    notes = {"made_by": "dehyst excite", "purpose": f"separate {a} from {b}"}
    notes["waveform"] = experiment.chosen.waveform.name
    write_recording(args.output, experiment.t_s, {f"u_{unit}": experiment.drive}, notes)
    if args.json:
        print(json.dumps(_facts(args, experiment, model), indent=2, allow_nan=False))
        return 0
    print(experiment.says)
    print(
        f"{args.output}: {experiment.t_s.size} samples, {limits.seconds:g} s, {low:g} to {high:g} "
        f"{unit}, at most {rate:g} {unit}/s"
    )
    return 0


def _facts(
    args: argparse.Namespace, experiment: Experiment, model: Model | None
) -> dict[str, object]:
    a, b = args.separate
    return {
        "output": str(args.output),
        "separate": [a, b],
        "waveform": experiment.chosen.waveform.name,
        "says": experiment.says,
        "unit": model.displacement_unit if model else "um",
        "tried": [
            {"waveform": s.waveform.name, f"left_{a}": s.left_a, f"left_{b}": s.left_b}
            for s in experiment.tried
        ],
    }
