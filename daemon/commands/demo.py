"""the whole story on the simulated stage in about a minute"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.terminal.progress import progress_bar

DESCRIPTION = """\
The whole story on the simulated stage in about a minute: excite and record it through the serial
drivers, identify a model, run the daemon, stream a 1 Hz full-stroke sine to it from a separate
process over zenoh, once with a linear gain and once with the identified model, print the tracking
errors, save a picture, end."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = DESCRIPTION
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out"),
        metavar="DIR",
        help="where picture, recordings and model are saved (default: out)",
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="result as JSON on stdout")
    parser.epilog = """Exit 0: compensation made the error smaller; 1: it did not (where the machine
was too busy to judge, that is said).

example: dehyst demo -o out"""


def say(text: str) -> None:
    """One line on stderr."""
    print(text, file=sys.stderr, flush=True)


def run(args: argparse.Namespace) -> int:
    from dehyst.daemon.tools.demo import OUTPUTS, Demo, compare_errors, draw

    check_outputs([args.output / name for name in OUTPUTS], [], args.force)
    args.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="dehyst-demo-") as folder:
        demo = Demo(Path(folder), args.output, say)
        try:
            with progress_bar("recording") as progress:
                demo.excite_and_record(progress)
            demo.identify()
            results = demo.track()
        finally:
            demo.close()
    picture = args.output / "demo.png"
    draw(demo, picture)
    linear, compensated = results["linear gain"], results["compensated"]
    better, says = compare_errors(linear, compensated, demo.late_share)
    if args.json:
        print(
            json.dumps(
                {
                    "rms_um": results,
                    "picture": str(picture),
                    "better": better,
                    "late_share": demo.late_share,
                    "says": says,
                }
            )
        )
    else:
        print(f"\n1 Hz sine, {demo.stroke_um:.1f} um peak to peak, {demo.rate_hz:g} Hz over serial")
        print(f"  {'':14}{'rms error':>12}{'of stroke':>12}")
        for name, rms in results.items():
            print(f"  {name:14}{1e3 * rms:9.1f} nm{100 * rms / demo.stroke_um:10.2f} %")
        print(f"  {says}")
        print(f"  picture: {picture}")
    return 0 if better else 1
