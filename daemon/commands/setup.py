"""Lead from two plugged-in units to a validated model, step by step."""

import argparse
import shlex
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from dehyst.daemon.client.connection import say
from dehyst.daemon.config.sections import check_name
from dehyst.daemon.json_text import print_json
from dehyst.daemon.rings.run_folder import locked
from dehyst.daemon.setup.names import NAMES
from dehyst.models.errors import BadInput

OUTPUTS = ("x", "y", "z")
AMPLIFIERS = {name: name.upper() for name in ("mdt693b", "mdt694b", "kpz101", "kpc101", "bpc303")}
WITH_GAUGE = ("kpc101", "bpc303")
"""Amplifiers that read the gauge of their output themselves."""
UNITS = ("mdt693b", "kpz101", *WITH_GAUGE, "ksg101")  # prefixes of an emulated bench's port names
DESCRIPTION = """\
Sets up a stage, from two plugged-in units to a validated model: finds the units, asks for the
stage's limits, measures the rate, writes the configuration, exercises the stage gently, excites and
records it, identifies a model, validates it on a new drive, tracks a sine without and with the
model, and prints how to run it.

Before it moves anything, each step announces what it will move, and how far, and asks for
confirmation. FOLDER/setup.json records which steps are done: the same command resumes where it
stopped, --from STEP repeats from that step, and changing an option repeats the steps that depend on
it. Recordings are never overwritten. If FOLDER contains your own stage.toml, the set-up uses it
unchanged, with the drivers that it names.

--axes sets up several axes of one amplifier: the exercise finds which gauge is on which axis; the
axes are recorded one after another, then together; each model includes coupling from the others."""

EPILOG = """\
steps: {steps}

exit status: 0: all steps are done, the model is as good as it claims, and it reduces the error;
1: a step found a problem, which it names, or was interrupted; 2: bad input, or a unit that cannot
be used.

examples: dehyst setup stage-1
          dehyst setup stage-1 --yes --ports /dev/ttyACM0 /dev/ttyUSB0 --range 0 100
          dehyst setup try-out --yes --emulated --range 0 150
          dehyst setup try-out --yes --emulated --amplifier kpc101 --range 0 150
          dehyst setup three --yes --emulated --axes 3 --range 0 150
          dehyst setup stage-1 --from record --band 10
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst setup`."""
    parser.description = DESCRIPTION
    parser.epilog = EPILOG.format(steps=", ".join(NAMES))
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="where everything is written; created if needed"
    )
    parser.add_argument(
        "--yes",
        action="store_true",
        help="run without questions, with defaults; needs --range",
    )
    parser.add_argument(
        "--ports",
        nargs="+",
        metavar="PORT",
        default=[],
        help="ports that may be probed (default: those whose USB identity is known)",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--axis", choices=("x", "y", "z"), help="axis of the amplifier (default: ask; x)"
    )
    which.add_argument(
        "--axes",
        type=_axes,
        default=(),
        metavar="NAMES",
        help="several axes, each with a gauge: x,y or x,y,z, or their number: 2, 3",
    )
    parser.add_argument(
        "--range",
        nargs=2,
        type=float,
        metavar=("MIN", "MAX"),
        help="voltage limits of the stage, V",
    )
    parser.add_argument(
        "--slew",
        type=float,
        metavar="V_PER_S",
        help="slew limit, V/s (default: 20 times the range per second)",
    )
    parser.add_argument(
        "--name",
        help="the controller's name (default: the folder's; stage-1 if that is not valid)",
    )
    parser.add_argument(
        "--rate", type=float, metavar="HZ", help="rate of the loop (default: measured)"
    )
    parser.add_argument(
        "--band",
        type=float,
        metavar="HZ",
        help="fastest motion through the range (default: 1, less where rate or slew allow less)",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="length of each recording (default: 20)"
    )
    parser.add_argument("--from", dest="first", choices=NAMES, help="repeat from this step on")
    parser.add_argument("--until", choices=NAMES, help="stop after this step")
    parser.add_argument(
        "--emulated", action="store_true", help="use an emulated bench, no hardware"
    )
    parser.add_argument(
        "--amplifier",
        choices=tuple(AMPLIFIERS),
        help="with --emulated: its amplifier (default: mdt693b, the only one with several axes)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result of each step, on stdout"
    )


def _axes(text: str) -> tuple[str, ...]:
    """Parse axis names such as x,y,z, or their number."""
    names = OUTPUTS[: int(text)] if text in ("2", "3") else tuple(text.split(","))
    if len(names) < 2 or len(set(names)) < len(names) or not set(names) <= set(OUTPUTS):
        raise argparse.ArgumentTypeError(f"{text!r}: several of x, y, z (x,y), or 2 or 3")
    return names


def run(args: argparse.Namespace) -> int:
    """Run the steps; return 0, or 1 if a model is worse than it claims or does not help."""
    from rich.console import Console

    from dehyst.daemon.setup.journal import Journal
    from dehyst.daemon.setup.questions import UserPrompts, Wishes
    from dehyst.daemon.setup.sequence import do_steps
    from dehyst.daemon.setup.workbench import Workbench

    if not args.yes and not sys.stdin.isatty():
        raise BadInput("stdin is not a terminal; --yes with --range MIN MAX runs without questions")
    if args.emulated and args.ports:
        raise BadInput("--emulated has its own ports; leave out --ports")
    if args.amplifier and not args.emulated:
        raise BadInput("--amplifier goes with --emulated: a real one is recognised at its port")
    if args.yes and args.range is None and not Journal(args.folder).done("limits"):
        raise BadInput("--yes needs --range MIN MAX: the stage's voltage limits have no default")
    _check_numbers(args)
    if args.name:
        check_name(args.name)
    try:
        str(args.folder.resolve()).encode()
    except UnicodeEncodeError:
        raise BadInput(
            f"{args.folder}: its path is not UTF-8, so no configuration can contain it; choose "
            "another folder"
        ) from None
    try:
        args.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{args.folder}: cannot be made: {error.strerror or error}") from None
    with ExitStack() as held:
        advice = "end that one, or wait until it has ended"
        held.enter_context(locked(args.folder, "setup", "setup", args.folder, advice))
        journal = Journal(args.folder)
        known = journal.result("units").get("axes", ()) if journal.done("units") else ()
        axes = args.axes or (() if args.axis else tuple(known))
        ports = tuple(_absolute(port) for port in args.ports)
        if args.emulated:
            amplifier = args.amplifier or _noted_amplifier(args.folder / "bench")
            ports = _emulated_ports(args.folder / "bench", amplifier, axes, held)
        wishes = Wishes(
            ports,
            args.axis,
            tuple(args.range) if args.range else None,
            args.slew,
            args.name,
            args.rate,
            args.band,
            args.duration,
            axes,
        )
        asking = UserPrompts(args.yes, Console(stderr=True))
        bench = Workbench(args.folder, wishes, journal, asking, say)
        do_steps(bench, args.first, args.until)
    return _conclude(bench, args)


def _check_numbers(args: argparse.Namespace) -> None:
    """Raise BadInput if a number that was given cannot be used with any units."""
    from dehyst.daemon.config.text import check_range

    if args.range:
        low, high = args.range
        check_range(low, high, None)
    for option, value, what in (
        ("--slew", args.slew, "a rate in V/s"),
        ("--rate", args.rate, "a sampling rate in Hz"),
        ("--band", args.band, "a frequency in Hz"),
        ("--duration", args.duration, "a time in s"),
    ):
        if value is not None and not 0.0 < value < float("inf"):
            raise BadInput(f"{option} {value:g}: {what}, greater than 0")


def _absolute(port: str) -> str:
    """Return a port's path as the configuration needs it: the same from every working directory,
    and however the folder is spelled. A port that is not a file, such as COM3, keeps its name."""
    path = Path(port)
    return str(path.parent.resolve() / path.name) if path.exists() else port


def _noted_amplifier(folder: Path) -> str:
    """Return the amplifier of the bench that an earlier set-up in this folder used, otherwise
    "mdt693b"."""
    from dehyst.daemon.bench.emulated import noted

    words = noted(folder)
    return words[words.index("--amplifier") + 1] if "--amplifier" in words else "mdt693b"


def _emulated_ports(
    folder: Path, amplifier: str, axes: tuple[str, ...], held: ExitStack
) -> tuple[str, ...]:
    from dehyst.daemon.bench.emulated import note_bench
    from dehyst.daemon.service.supervisor import BenchProcess
    from dehyst.drivers.emulated.control import is_served

    if axes and amplifier != "mdt693b":
        name = AMPLIFIERS[amplifier]
        raise BadInput(f"--axes {','.join(axes)}: a {name} is set up with one axis")
    count = len(axes) or 1
    if axes and axes != OUTPUTS[:count]:
        raise BadInput(f"--axes {','.join(axes)}: an emulated bench has x,y or x,y,z")
    more = ["--axes", str(count)] if axes else []
    more += ["--amplifier", amplifier] if amplifier != "mdt693b" else []
    gauges = f"{count} KSG101s" if axes else "a KSG101"
    units = AMPLIFIERS[amplifier] + ("" if amplifier in WITH_GAUGE else f" and {gauges}")
    config = shlex.quote(str(folder.parent / "stage.toml"))
    if is_served(folder / "control"):
        raise BadInput(
            f"{folder}: its emulated bench is in use, by `dehyst run` for example; end that first"
        )
    say(
        f"starting an emulated {units} with a simulated stage; it "
        f"ends with this command, and `dehyst run --config {config}` starts it again"
    )
    bench = BenchProcess(folder, more)
    note_bench(folder, more)
    held.callback(bench.close)
    return tuple(_absolute(path) for name, path in bench.ports.items() if name.startswith(UNITS))


def _conclude(bench: Any, args: argparse.Namespace) -> int:
    results = {name: bench.journal.result(name) for name in NAMES if bench.journal.done(name)}
    if args.json:
        print_json(results)
    tracked, validated = (_each(results.get(name, {})) for name in ("track", "validate"))
    found = any(one.get("worse_than_claimed", False) for one in validated)
    found |= any(one.get("times_smaller", 2.0) <= 1.0 for one in tracked)
    if found and not args.json:
        bench.say("exit status 1: a model is worse than it claims, or does not reduce the error")
    return 1 if found else 0


def _each(result: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the result of each axis; for one axis, the result itself."""
    return list(result["axes"].values()) if "axes" in result else [result]
