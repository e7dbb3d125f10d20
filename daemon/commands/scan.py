"""Write the path of a scan in the plane: raster, spiral or Lissajous figure."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dehyst.daemon.client.connection import add_connection
from dehyst.daemon.config.plausible import check_plausible
from dehyst.daemon.files.outputs import add_force, check_outputs, whole_file
from dehyst.daemon.terminal.number_options import finite, positive
from dehyst.models.errors import BadInput, DehystError

if TYPE_CHECKING:
    from dehyst.daemon.scan_check import Reached
    from dehyst.models.drive_design.scans import Scan

SAMPLING_HZ = 100.0  # suits every bench: the daemon interpolates between points
FREE_SLEW = 1e12  # if only models are given: no slew limit
EPILOG = """The file has the columns t_s, target_x_um, target_y_um (others with --axes and --unit);
`dehyst play` streams it. Every path begins and ends at rest at the same position, so that it can be
repeated and learned, and has no corners. With --config (or --model) every target is inverted as in
the daemon: a path that leaves an axis' reach, or exceeds its slew limit, is refused, and nothing is
written. Without them, reach, slew and rate are those of the daemon at --connect, if one is running.
Targets are relative to the set-point origin of each axis.

examples: dehyst scan raster --size 5 5 --lines 20 --config stage.toml -o raster.csv
          dehyst scan spiral --radius 2.5 --pitch 0.25 --center 8 8 -o spiral.csv
          dehyst scan lissajous --size 5 5 --ratio 2 3 -o figure.csv --picture figure.png
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst scan`."""
    parser.epilog = EPILOG
    parser.add_argument("kind", choices=("raster", "spiral", "lissajous"))
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PATH.csv")
    add = parser.add_argument
    add(
        "--size",
        nargs=2,
        type=float,
        metavar=("W", "H"),
        help="width and height (raster, lissajous)",
    )
    add(
        "--lines",
        type=int,
        default=20,
        metavar="N",
        help="number of lines of a raster (default: 20)",
    )
    add(
        "--line-s",
        type=float,
        default=0.5,
        metavar="S",
        help="time of a line with its turn (default: 0.5 s)",
    )
    add(
        "--turn",
        type=float,
        default=0.2,
        help="share of a line's time that the turn takes (default: 0.2)",
    )
    add("--radius", type=float, metavar="R", help="outer radius of a spiral")
    add(
        "--pitch",
        type=float,
        metavar="P",
        help="distance between turns of a spiral (default: R / 10)",
    )
    add("--speed", type=float, metavar="V", help="speed along a spiral, per second (default: 4 R)")
    add(
        "--most-hz",
        type=float,
        default=2.0,
        metavar="HZ",
        help="highest number of turns per second, near the middle (default: 2)",
    )
    add(
        "--ratio",
        nargs=2,
        type=int,
        default=(2, 3),
        metavar=("A", "B"),
        help="frequency ratio of a figure (default: 2 3)",
    )
    add(
        "--figure-s", type=float, default=4.0, metavar="S", help="time of one figure (default: 4 s)"
    )
    add("--turns", type=int, default=2, metavar="N", help="number of figures (default: 2)")
    add(
        "--center",
        nargs=2,
        type=finite,
        metavar=("X", "Y"),
        help="center of the path (default: middle of the reach; where that is not known, 0 0)",
    )
    add(
        "--axes",
        nargs=2,
        default=("x", "y"),
        metavar=("A", "B"),
        help="the two axes (default: x y)",
    )
    add(
        "--unit",
        default="um",
        choices=("um", "nm", "mrad", "urad"),
        help="displacement unit (default: um)",
    )
    add(
        "--sampling",
        type=float,
        metavar="HZ",
        help=f"default: the loop's of --config or of the daemon that runs, else {SAMPLING_HZ:g}",
    )
    add("--config", type=Path, metavar="FILE", help="reach and slew of this controller's axes")
    add(
        "--model",
        nargs=2,
        action="append",
        default=[],
        metavar=("AXIS", "MODEL.toml"),
        help="without --config: the model of this axis, which gives its reach; one for each axis",
    )
    add("--slew", type=positive, metavar="PER_S", help="with --model: largest rate of the drive")
    add("--picture", type=Path, metavar="PNG", help="draw the path and its targets over time")
    add_force(parser)
    add("--json", action="store_true", help="print what was written as JSON on stdout")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Make, check and write the path; return 0."""
    from dehyst.daemon.files.recordings import write_recording
    from dehyst.daemon.scan_check import require_reach

    models = [Path(file) for _, file in args.model]
    check_outputs([args.output, args.picture], [args.config, *models], args.force)
    for option, lengths in (
        ("--size", args.size or ()),
        ("--radius", () if args.radius is None else (args.radius,)),
        ("--center", args.center or ()),
    ):
        check_plausible(option, lengths, args.unit)
    axes, rate_hz = _axes(args)
    period_s = 1.0 / (args.sampling or rate_hz)
    scan = _scan(args, period_s)
    center = args.center or [_middle(axes.get(name)) for name in args.axes]
    targets = {
        name: values + at
        for name, values, at in zip(args.axes, (scan.x, scan.y), center, strict=True)
    }
    for name, one in axes.items():
        if (unit := one.model.displacement_unit) != args.unit:
            raise BadInput(f"axis {name} is in {unit}: give --unit {unit}")
    said = require_reach(axes, targets, period_s)
    if not axes:
        said.append("reach and slew are not checked: give --config or --model to check them")
        if not args.center:
            said.append(
                "the path is centred at (0, 0), which may be out of the stage's reach: give "
                "--center X Y, or --config"
            )
    columns = {f"target_{name}_{args.unit}": values for name, values in targets.items()}
    columns["scan"] = scan.image.astype(float)
    write_recording(args.output, scan.t_s, columns, {"source": f"dehyst scan: {scan.says}"})
    if args.picture:
        from dehyst.daemon.report.scan import picture_scan

        x, y = targets.values()
        png = picture_scan(scan, x, y, tuple(args.axes), args.unit)
        with whole_file(args.picture) as file:
            file.write(png)
    for words in said:
        print(f"dehyst scan: {words}", file=sys.stderr)
    facts = {
        "file": str(args.output),
        "says": scan.says,
        "seconds": float(scan.t_s[-1]),
        "samples": int(scan.t_s.size),
        "center": [float(at) for at in center],
        "fastest_per_s": list(scan.speed),
        "checked": sorted(axes),
    }
    if args.json:
        print(json.dumps(facts))
    else:
        print(
            f"{args.output}: {scan.says}; {scan.t_s[-1]:.4g} s, at most {scan.speed[0]:.3g} and "
            f"{scan.speed[1]:.3g} {args.unit}/s, about ({center[0]:.4g}, {center[1]:.4g})"
        )
    return 0


def _scan(args: argparse.Namespace, period_s: float) -> "Scan":
    from dehyst.models.drive_design.scans import scan_lissajous, scan_raster, scan_spiral

    if args.axes[0] == args.axes[1]:
        raise BadInput(f"--axes {args.axes[0]} {args.axes[1]}: a path in the plane needs two axes")
    if args.kind == "spiral":
        if args.radius is None:
            raise BadInput("a spiral needs --radius")
        pitch = 0.1 * args.radius if args.pitch is None else args.pitch
        speed = 4.0 * args.radius if args.speed is None else args.speed
        return scan_spiral(args.radius, pitch, speed, args.most_hz, period_s)
    if args.size is None:
        raise BadInput(f"a {args.kind} needs --size W H")
    width, height = args.size
    if args.kind == "raster":
        return scan_raster(width, height, args.lines, args.line_s, period_s, args.turn)
    return scan_lissajous(width, height, tuple(args.ratio), args.figure_s, period_s, args.turns)


def _axes(args: argparse.Namespace) -> tuple[dict[str, "Reached"], float]:
    """Return what is known about the axes, by name, and the sampling rate [Hz]."""
    from dehyst.daemon.files.models import load_model
    from dehyst.daemon.scan_check import axes_of, axis_of_model

    if args.sampling is not None and not 0 < args.sampling < np.inf:
        raise BadInput(f"--sampling: must be above 0, not {args.sampling:g}")
    if args.config and args.model:
        raise BadInput("--model goes without --config: the configuration names the models itself")
    if args.config:
        return axes_of(args.config, tuple(args.axes))
    names = [name for name, _ in args.model]
    if names and sorted(names) != sorted(args.axes):
        raise BadInput(f"--model is needed for each of the axes {' and '.join(args.axes)}")
    if not names and (running := _running(args)):
        return running
    slew = FREE_SLEW if args.slew is None else args.slew
    return {name: axis_of_model(load_model(file), slew) for name, file in args.model}, SAMPLING_HZ


def _middle(one: "Reached | None") -> float:
    return 0.0 if one is None else 0.5 * sum(one.set_points)


def _running(args: argparse.Namespace) -> "tuple[dict[str, Reached], float] | None":
    """Return the axes of the running daemon and its rate [Hz]; None if no daemon with these axes
    runs and none was named."""
    from dehyst.daemon.client.connection import address_of, connect_axes
    from dehyst.daemon.client.finding import listens
    from dehyst.daemon.scan_check import axis_of_daemon

    where, _ = address_of(args)
    asked_for = args.connect or args.name
    if not asked_for and not listens(where):
        return None
    try:
        with connect_axes(args, "scan", args.axes) as stage:
            stage.wait_until_started()
            clients = stage.clients
            axes = {a: axis_of_daemon(one.model(), one.config()) for a, one in clients.items()}
            print(f"dehyst scan: reach, slew and rate are those of {stage.name}", file=sys.stderr)
            return axes, stage.first.config().loop.rate_hz
    except DehystError:
        if asked_for:
            raise
        return None
