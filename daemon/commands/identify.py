"""identify a stage's model from one or more recordings"""

import argparse
import json
from pathlib import Path

from dehyst.daemon.files import save_model
from dehyst.daemon.recordings import read_recording
from dehyst.models.identify import Options, identify


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst identify`."""
    parser.epilog = "example: dehyst identify run1.csv -o stage.toml"
    parser.add_argument("recordings", nargs="+", type=Path, metavar="REC")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="MODEL.toml")
    parser.add_argument("--order", type=int, help="number of play operators")
    parser.add_argument("--json", action="store_true", help="result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Identify and write the model."""
    recordings = [read_recording(path, need_displacement=True) for path in args.recordings]
    result = identify(recordings, Options(order=args.order))
    save_model(result.model, args.output)
    fit = result.model.fit
    if args.json:
        print(json.dumps({"rms": fit.rms, "unit": result.model.displacement_unit}))
    else:
        print(f"{args.output}: fit rms {fit.rms:.4g} {result.model.displacement_unit}")
    return 0
