"""Emulate an amplifier and its gauges on pseudo terminals, with a simulated stage."""

import argparse
import contextlib
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec import structs

from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.loop.timing import realtime
from dehyst.drivers.emulated.bench import Bench, BenchSettings
from dehyst.drivers.emulated.kpc101_unit import RACK_KNOBS, Kpc101Knobs
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Knobs
from dehyst.drivers.emulated.mdt693b_dialects import DIALECTS
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.process import ready_line, run_bench
from dehyst.drivers.simulated.axes import settings_by_axis
from dehyst.drivers.simulated.settings import AXES, StageSettings
from dehyst.models.errors import BadInput

LATENCY_S = 0.0015
"""Latency of an amplifier command; it leaves time for a 200 Hz loop that writes and reads in
turn."""

AMPLIFIERS = ("mdt693b", "mdt694b", "kpz101", "kpc101", "bpc303")
APT_KNOBS = {"kpz101": Kpz101Knobs(), "kpc101": Kpc101Knobs(), "bpc303": RACK_KNOBS}

BENCH_PRIORITY = 60  # real-time priority, below the loop's default of 80

EPILOG = """\
Prints one line of JSON with the paths of the ports and of the control socket when they can be
opened, and runs until SIGTERM or Ctrl-C. Send faults and changes to the control socket, one JSON
object per datagram, e.g. {"fault": "unplug", "for_s": 2} or {"stage": {"stroke_um": 15.0}}; with
several axes, "axis": "y" selects the axis.

examples: dehyst emulate --dir /tmp/bench --dialect 1.05 --stage creep_gain_per_decade=0.02
          dehyst emulate --axes 3 --stage x.from_y=0.03
          dehyst emulate --amplifier kpz101 --limit-v 75
          dehyst emulate --amplifier mdt694b
          dehyst emulate --amplifier bpc303 --axes 3
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst emulate`."""
    knobs = Mdt693bKnobs()
    parser.epilog = EPILOG
    parser.add_argument(
        "--dir", metavar="DIR", help="where the ports appear (default: a new temporary folder)"
    )
    parser.add_argument(
        "--amplifier",
        choices=AMPLIFIERS,
        default=AMPLIFIERS[0],
        help="the amplifier; MDT694B, KPZ101 and KPC101 have one axis; KPC101 and BPC303 read the "
        "gauges themselves (default: %(default)s)",
    )
    parser.add_argument(
        "--dialect",
        choices=sorted(DIALECTS),
        default=knobs.dialect,
        help="firmware of the MDT693B (default: %(default)s)",
    )
    parser.add_argument("--axis", choices=AXES, default="x", help="axis (default: x)")
    parser.add_argument(
        "--axes",
        type=int,
        choices=(1, 2, 3),
        default=1,
        help="number of axes (x, y, z), slightly coupled, each with its gauge",
    )
    parser.add_argument(
        "--limit-v",
        type=int,
        choices=(75, 100, 150),
        default=knobs.limit_v,
        help="the amplifier's limit switch (default: %(default)s)",
    )
    parser.add_argument(
        "--start-v",
        type=float,
        default=0.0,
        metavar="V",
        help="output that the amplifier recalls at power-on (default: 0)",
    )
    parser.add_argument(
        "--latency-s",
        type=float,
        default=LATENCY_S,
        metavar="S",
        help="latency of the amplifier's replies (default: %(default)s)",
    )
    parser.add_argument(
        "--jitter-s",
        type=float,
        default=knobs.jitter_s,
        metavar="S",
        help="jitter of the amplifier's replies (default: %(default)s)",
    )
    parser.add_argument(
        "--max-travel-um", type=float, metavar="UM", help="full scale of the gauge reader"
    )
    parser.add_argument(
        "--stage",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a setting of the stage, e.g. stroke_um=11.6 (each axis) or y.stroke_um=11.6 (that "
        "axis); may be repeated",
    )
    parser.add_argument(
        "--log", metavar="FILE", help="write the history of the output voltage (.npz or .csv)"
    )
    add_force(parser)


def stage_settings(pairs: list[str], axes: Sequence[str]) -> dict[str, StageSettings]:
    """Parse KEY=VALUE or AXIS.KEY=VALUE words into settings for each axis. Raises BadInput or
    DriverConfigError."""
    tables: dict[str, dict[str, Any]] = {axis: {} for axis in axes}
    for pair in pairs:
        name, sign, text = pair.partition("=")
        axis, dot, key = name.rpartition(".")
        try:
            number = int(text) if key == "seed" else float(text)
        except ValueError:
            raise BadInput(f"--stage {pair}: write KEY=NUMBER") from None
        if not sign:
            raise BadInput(f"--stage {pair}: write KEY=NUMBER")
        if dot and axis not in tables:
            raise BadInput(f"--stage {pair}: there is no axis {axis}; axes: {', '.join(tables)}")
        for one in [axis] if dot else tables:
            tables[one][key] = number
    return settings_by_axis(axes, tables)


def amplifier_knobs(args: argparse.Namespace) -> Mdt693bKnobs | Kpz101Knobs:
    """Return the emulated amplifier's properties. Raises BadInput for options that it does not
    have."""
    plain = Mdt693bKnobs()
    single = args.amplifier == "mdt694b"
    if single and (args.axes, args.axis) != (1, "x"):
        raise BadInput("an MDT694B has only the axis x: leave out --axis and --axes")
    if args.amplifier not in APT_KNOBS:
        return Mdt693bKnobs(
            axes="x" if single else "xyz",
            dialect=args.dialect,
            limit_v=args.limit_v,
            latency_s=args.latency_s,
            jitter_s=args.jitter_s,
            start_v=args.start_v,
        )
    knobs = APT_KNOBS[args.amplifier]
    axes = args.axes if args.amplifier == "bpc303" else 1
    for option, value in (("dialect", plain.dialect), ("jitter_s", plain.jitter_s), ("axes", axes)):
        if getattr(args, option) != value:
            name = option.replace("_", "-")
            raise BadInput(f"--{name}: not for a {knobs.model}; leave it out, or use an MDT693B")
    # an amplifier that starts at a voltage is enabled
    return structs.replace(
        knobs,
        limit_v=args.limit_v,
        latency_s=args.latency_s,
        start_v=args.start_v,
        enabled=args.start_v > 0,
    )


def run(args: argparse.Namespace) -> int:
    """Serve until SIGTERM or SIGINT."""
    check_outputs([args.log], [], args.force)
    realtime.die_with_parent(signal.SIGTERM)
    for name, low, high in (
        ("latency_s", 0.0, 1.0),
        ("jitter_s", 0.0, 1.0),
        ("start_v", 0.0, float(args.limit_v)),
    ):
        if not low <= getattr(args, name) <= high:
            raise BadInput(f"--{name.replace('_', '-')} must be from {low:g} to {high:g}")
    if args.axes > 1 and args.axis != "x":
        raise BadInput(f"--axis {args.axis}: goes with one axis; --axes {args.axes} has x first")
    axes = AXES[: args.axes] if args.axes > 1 else (args.axis,)
    stages = stage_settings(args.stage, axes)
    gauge = None
    if args.max_travel_um is not None:
        if not 0 < args.max_travel_um <= 6500:
            raise BadInput("--max-travel-um must be above 0 and at most 6500")
        gauge = Ksg101Knobs(max_travel_um=args.max_travel_um)
    amplifier = amplifier_knobs(args)
    first = stages.pop(axes[0])
    settings = BenchSettings(first, amplifier, gauge, axes[0], stages)
    # like hardware, answer in time even on a busy machine; the priority is below the loop's
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(BENCH_PRIORITY))
    stop = threading.Event()

    def started(bench: Bench) -> None:
        def end(*_: object) -> None:
            stop.set()
            bench.amplifier.wake()

        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, end)

    def ready(ports: dict[str, str]) -> None:
        print(ready_line(ports), flush=True)

    with contextlib.ExitStack() as held:
        directory = Path(
            args.dir or held.enter_context(tempfile.TemporaryDirectory(prefix="dehyst-bench-"))
        )
        log = Path(args.log) if args.log else None
        try:
            run_bench(directory, settings, stop, ready, started, log)
        except BrokenPipeError:  # the process that started it is gone
            raise
        except OSError as error:
            raise BadInput(f"emulate in {directory}: {error.strerror or error}") from None
    if sys.stderr.isatty():
        print("emulated bench ended", file=sys.stderr)
    return 0
