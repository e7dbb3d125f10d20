"""Identify a model from a recording."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from dehyst.daemon import clock
from dehyst.daemon.files.foreign.reading import add_reading
from dehyst.daemon.files.given_recordings import read_given
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.json_text import print_json


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst identify`."""
    parser.description = (
        "Identify one invertible hysteresis model from one or more recordings of a stage. "
        "Thresholds, weights, rate-dependence and saturation are all found from the data. Options "
        "that are not given, except --order, are chosen on held-out rows and reported."
    )
    parser.epilog = (
        "examples: dehyst identify run.csv -o stage.toml --report findings\n"
        "          dehyst identify slow.csv fast.csv -o stage.toml --static --order 12"
    )
    parser.add_argument(
        "recordings", nargs="+", type=Path, metavar="REC", help="recordings of one stage"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="MODEL.toml",
        help="the model file to write",
    )
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--static", action="store_true", help="identify without rate-dependence")
    kind.add_argument("--rate", action="store_true", help="identify with rate-dependent weights")
    parser.add_argument(
        "--order", type=int, metavar="N", help="number of play operators (default: 45)"
    )
    parser.add_argument("--saturation", type=int, metavar="M", help="degree of the saturation")
    parser.add_argument(
        "--bias",
        action=argparse.BooleanOptionalAction,
        help="with or without even powers in the saturation (for an asymmetric loop)",
    )
    parser.add_argument("--report", type=Path, metavar="DIR", help="write DIR/report.html")
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Identify, write the model and the report; return 0."""
    rate = True if args.rate else False if args.static else None
    page = args.report / "report.html" if args.report else None
    check_outputs([args.output, page], args.recordings, args.force)
    started_ns = clock.monotonic_ns()
    recordings = read_given(args.recordings, args)
    # slow imports, which help and a refused file do not need
    from dehyst.daemon.api.functions import identify
    from dehyst.daemon.api.identification_summary import describe_result, summary

    with working() as say:
        found = identify(
            recordings,
            rate=rate,
            order=args.order,
            saturation=args.saturation,
            bias=args.bias,
            progress=say,
        )
        seconds = (clock.monotonic_ns() - started_ns) / clock.NS
        found.save(args.output, force=args.force)
        report = None
        if page:
            say("writing the report")
            report = found.report(page, args.output.name, force=args.force)
    result, covered = found.details, found.coverage
    if args.json:
        print_json(summary(result, covered, args.output, seconds, report))
    else:
        print(describe_result(result, covered, args.output, report))
    return 0


@contextmanager
def working() -> Iterator[Callable[[str], None]]:
    """Show a line on a terminal that says what is being done; show nothing in a pipe."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("starting") as status:
        yield lambda text: status.update(text)
