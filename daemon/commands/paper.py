"""Repeat the source paper's experiments, errors and figures next to the paper's."""

import argparse
from pathlib import Path

from dehyst.daemon.api.results import write_page
from dehyst.daemon.files.outputs import check_outputs, whole_file
from dehyst.daemon.json_text import json_text
from dehyst.daemon.paper.experiments import NOISE_NM, run_experiments
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.models.errors import BadInput


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst paper`."""
    parser.description = (
        "Repeat the experiments of the paper's section 3 on stages given by its Eq. 11 and "
        "Eq. 12 and on a Bouc-Wen stage: identify, predict, draw Figures 3 to 7, and track each "
        "signal with the inverse. Writes DIR/paper.html, DIR/paper.json and plots. Exit "
        "status 0: every figure of the paper is reached: the standard deviation is at most the "
        "paper's, and the mean at most the paper's mean plus its standard deviation; for the "
        "sweep, the maximum of the last second is at most the paper's. 1: a figure is not "
        "reached. Static models are judged on the stage of Eq. 11, rate-dependent ones on that "
        "of Eq. 12."
    )
    parser.epilog = "example: dehyst paper -o paper-again"
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--noise",
        type=float,
        default=NOISE_NM,
        metavar="NM",
        help=f"sensor noise, nm rms (default: {NOISE_NM:g}, the paper's 100 nm peak to peak)",
    )
    parser.add_argument("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Repeat the experiments; return 0, or 1 if one of the paper's errors is not reached."""
    from dehyst.daemon.paper.report import page, paper_table, pictures

    if not 0 < args.noise <= 1000:
        raise BadInput(f"--noise: more than 0 and at most 1000 nm rms, not {args.noise:g}")
    check_outputs([args.output / "paper.html", args.output / "paper.json"], [], force=True)
    with progress_bar("experiments of the paper") as progress:
        results = run_experiments(progress, args.noise)
    text = json_text([r.to_json() for r in results], indent=2)
    write_page(args.output / "paper.html", page(results))
    write_page(args.output / "paper.json", text + "\n")
    for name, png in pictures(results).items():
        with whole_file(args.output / name) as file:
            file.write(png)
    print(text if args.json else f"{paper_table(results)}\nreport: {args.output / 'paper.html'}")
    return 0 if all(r.reached for r in results if r.counts) else 1
