"""Compare models of hysteresis on the same recordings."""

import argparse
import json
import sys
from pathlib import Path

from dehyst.daemon.api.results import write_page
from dehyst.daemon.files.outputs import check_outputs
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.models.errors import BadInput

FILES = JSON, TABLE = "bench.json", "bench.md"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst bench`."""
    parser.description = (
        "Fit this project's model, a classical Prandtl-Ishlinskii model, a Preisach plane, "
        "Bouc-Wen, Duhem, NARX and a small neural net (with scikit-learn) to the same recordings, "
        "and predict held-out rows from the drive alone. Without --recordings the stages are "
        "simulated. All figures except the cost are the same in every run on a machine."
    )
    parser.epilog = "example: dehyst bench --recordings recordings -o bench"
    add = parser.add_argument
    add(
        "--recordings",
        type=Path,
        metavar="DIR",
        help="also compare on the recordings in this folder: the first 60 %% of each is fitted",
    )
    add(
        "--only",
        nargs="+",
        default=[],
        metavar="CASE",
        help="only these cases, by the names in the table",
    )
    add("-o", "--output", type=Path, metavar="DIR", help=f"write {JSON} and {TABLE} there")
    add("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Compare and print; return 0."""
    from dehyst.daemon.benchmark.cases import made_cases, read_cases
    from dehyst.daemon.benchmark.report import markdown, scores_to_json
    from dehyst.daemon.benchmark.rivals.table import RIVALS
    from dehyst.daemon.benchmark.run import run_comparisons

    if args.output:
        check_outputs([args.output / name for name in FILES], [], force=True)
    cases = made_cases()
    left_out: list[str] = []
    if args.recordings:
        more, left_out = read_cases(args.recordings)
        cases += more
    names = [one.name for one in cases]
    if unknown := [name for name in args.only if name not in names]:
        raise BadInput(f"--only: there is no case {unknown[0]!r}; known: {', '.join(names)}")
    chosen = [one for one in cases if one.name in args.only or not args.only]
    with progress_bar("models compared") as progress:
        scores = run_comparisons(chosen, RIVALS, progress)
    for text in left_out:
        print(f"dehyst bench: left out: {text}", file=sys.stderr)
    result = json.dumps(scores_to_json(scores, left_out), indent=2)
    table = markdown(scores, RIVALS, left_out)
    if args.output:
        write_page(args.output / JSON, result + "\n")
        write_page(args.output / TABLE, table + "\n")
    print(result if args.json else table)
    return 0
