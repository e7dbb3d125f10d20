"""from two plugged-in units to a validated model, step by step"""

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from dehyst.daemon.client.connection import print_json, say
from dehyst.daemon.setup.names import NAMES
from dehyst.models.errors import BadInput

DESCRIPTION = """\
From two plugged-in units to a validated model: finds the units, asks for the stage's limits,
measures the rate, writes the configuration, exercises the stage gently, excites and records it,
identifies a model, validates it on a fresh drive, follows a sine without and with it, and says how
to run it.

Each step says what it will move, and how far, before it moves, and asks. What is done stands in
FOLDER/setup.json: the same command goes on where it ended, --from STEP repeats from a step on, and
an option of another value repeats the steps that heed it. Recordings are never replaced. A
stage.toml of your own in FOLDER is used as it stands, with whatever drivers it names."""

EPILOG = """\
steps: {steps}

exit status: 0: all is done, the model keeps what it claims, and the error with it is smaller; 1: a
step found something (it says what), or it was ended; 2: bad input, or a unit that cannot be used.

examples: dehyst setup stage-1
          dehyst setup stage-1 --yes --ports /dev/ttyACM0 /dev/ttyUSB0 --range 0 100
          dehyst setup try-out --yes --emulated --range 0 150
          dehyst setup stage-1 --from record --band 10
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst setup`."""
    parser.description = DESCRIPTION
    parser.epilog = EPILOG.format(steps=", ".join(NAMES))
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where everything goes; made")
    parser.add_argument(
        "--yes",
        action="store_true",
        help="ask nothing: go on after each announcement, with defaults; needs --range",
    )
    parser.add_argument(
        "--ports",
        nargs="+",
        metavar="PORT",
        default=[],
        help="these may be asked who they are (default: those whose USB numbers say it)",
    )
    parser.add_argument("--axis", choices=("x", "y", "z"), help="of the amplifier (asked; x)")
    parser.add_argument(
        "--range", nargs=2, type=float, metavar=("MIN", "MAX"), help="voltages the stage may see, V"
    )
    parser.add_argument("--slew", type=float, metavar="V_PER_S", help="most; 20 ranges a second")
    parser.add_argument("--name", help="the controller's name (default: stage-1)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="of the loop (default: measured)")
    parser.add_argument(
        "--band",
        type=float,
        metavar="HZ",
        help="fastest motion through the range (default: 1, less where rate or slew allow less)",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="of each recording (default: 20)"
    )
    parser.add_argument("--from", dest="first", choices=NAMES, help="repeat from this step on")
    parser.add_argument("--until", choices=NAMES, help="end after this step")
    parser.add_argument(
        "--emulated", action="store_true", help="on an emulated bench that lives as long as this"
    )
    parser.add_argument("--json", action="store_true", help="what came of each step, on stdout")


def run(args: argparse.Namespace) -> int:
    """Do the steps; 0, or 1 where one found something."""
    from rich.console import Console

    from dehyst.daemon.setup.journal import Journal
    from dehyst.daemon.setup.questions import Questions, Wishes
    from dehyst.daemon.setup.sequence import do_steps
    from dehyst.daemon.setup.workbench import Workbench

    if not args.yes and not sys.stdin.isatty():
        raise BadInput("nobody is here to be asked: --yes with --range MIN MAX goes on by itself")
    if args.emulated and args.ports:
        raise BadInput("--emulated brings its own ports; leave out --ports")
    try:
        args.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{args.folder}: cannot be made: {error.strerror}") from None
    with ExitStack() as held:
        ports = tuple(args.ports) or _emulated_ports(args, held)
        wishes = Wishes(
            ports,
            args.axis or ("x" if args.yes else None),
            tuple(args.range) if args.range else None,
            args.slew,
            args.name,
            args.rate,
            args.band,
            args.duration,
        )
        asking = Questions(args.yes, Console(stderr=True))
        bench = Workbench(args.folder, wishes, Journal(args.folder), asking, say)
        do_steps(bench, args.first, args.until)
    return _conclude(bench, args)


def _emulated_ports(args: argparse.Namespace, held: ExitStack) -> tuple[str, ...]:
    if not args.emulated:
        return ()
    from dehyst.daemon.service.supervisor import BenchProcess

    folder = args.folder / "bench"
    say(
        "an emulated MDT693B and KSG101, with a simulated stage behind; "
        f"`dehyst emulate --dir {folder}` brings the same ports back"
    )
    bench = BenchProcess(folder, [])
    held.callback(bench.close)
    return bench.ports["mdt693b"], bench.ports["ksg101"]


def _conclude(bench: Any, args: argparse.Namespace) -> int:
    results = {name: bench.journal.result(name) for name in NAMES if bench.journal.done(name)}
    if args.json:
        print_json(results)
    tracked, validated = results.get("track", {}), results.get("validate", {})
    found = validated.get("worse_than_claimed", False) or tracked.get("times_smaller", 2.0) <= 1.0
    return 1 if found else 0
