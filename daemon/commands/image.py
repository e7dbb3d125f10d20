"""Image a grid with a virtual microscope: raw, compensated, learned."""

import argparse
import sys
from pathlib import Path

from dehyst.daemon.api.results import write_page
from dehyst.daemon.files.outputs import check_outputs, whole_file
from dehyst.daemon.imaging.experiment import COMPENSATED_LEAST, LEARNED_LEAST, LINES, image
from dehyst.daemon.json_text import json_text
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.models.errors import BadInput

LEAST_LINES, MOST_LINES = 8, 1024  # least: a trace and a retrace per pit; most: takes minutes
FILES = PNG, JSON, HDF5 = "image.png", "image.json", "image.h5"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst image`."""
    parser.description = (
        "Image a calibration grid with the simulated two-axis stage, scanning each line in both "
        "directions: with volts proportional to the target position, with the inverse model, and "
        f"with learning from the gauges. Writes DIR/{PNG} (the three pictures side by side), "
        f"DIR/{JSON} and, with h5py, DIR/{HDF5} with NeXus names. Distortion is the rms distance "
        "between true and target position without the shift and the scale of each axis, which a "
        "calibration corrects. Seam is the rms distance between trace and retrace. Exit status "
        "0: the distortion of the compensated picture is smaller than that of the raw one by a "
        f"factor of at least {COMPENSATED_LEAST:g}, and that of the learned one by at least "
        f"{LEARNED_LEAST:g}; 1: it is not. No daemon is needed."
    )
    parser.epilog = "example: dehyst image -o pictures"
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--lines",
        type=int,
        default=LINES,
        metavar="N",
        help=f"lines of a picture, half of them trace, half retrace (default: {LINES})",
    )
    parser.add_argument("--json", action="store_true", help="the figures as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Image and write; return 0, or 1 if the pictures do not improve as much as required."""
    from dehyst.daemon.imaging.nexus import to_hdf5
    from dehyst.daemon.imaging.report import draw_pictures, picture_table, pictures_to_json

    if not MOST_LINES >= args.lines >= LEAST_LINES or args.lines % 2:
        raise BadInput(
            f"--lines: an even number from {LEAST_LINES} to {MOST_LINES}, not {args.lines}"
        )
    check_outputs([args.output / name for name in FILES], [], force=True)
    with progress_bar("three pictures of a grid") as progress:
        imaged = image(progress, args.lines)
    text = json_text(pictures_to_json(imaged), indent=2)
    write_page(args.output / JSON, text + "\n")
    with whole_file(args.output / PNG) as file:
        file.write(draw_pictures(imaged))
    try:
        content = to_hdf5(imaged)
    except ImportError:
        print(
            f"dehyst image: {HDF5} is not written: it needs h5py (pip install 'dehyst[hdf5]')",
            file=sys.stderr,
        )
    else:
        with whole_file(args.output / HDF5) as file:
            file.write(content)
    print(text if args.json else f"{picture_table(imaged)}\npictures: {args.output / PNG}")
    return 0 if imaged.reached else 1
