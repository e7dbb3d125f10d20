"""Send one set-point to a running daemon, or stop it."""

import argparse
import math
from typing import TYPE_CHECKING

from dehyst.daemon.client.connection import add_connection, connect_axes, print_json, say
from dehyst.daemon.rings.status import positioning
from dehyst.models.errors import BadInput

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Status

EPILOG = """A set-point is held for `setpoint.stale_s` of the daemon's configuration (2 s by
default); then the daemon holds and ramps to its safe voltage. --for keeps the stage there by
sending again.
Exit 0: taken; 2: refused (the reason is printed) or no daemon.

examples:
  dehyst send 4.5 --for 10
  dehyst send x=4.5 y=2 --to stage-1
  dehyst send --stop
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst send`."""
    parser.epilog = EPILOG
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "target",
        nargs="*",
        default=[],
        type=_target,
        metavar="UM",
        help="target, from the set-point origin; of several axes x=4.5 y=2",
    )
    what.add_argument("--stop", action="store_true", help="drop all targets: hold, then ramp")
    what.add_argument("--release", action="store_true", help="ramp to the safe voltage now")
    parser.add_argument(
        "--for", dest="seconds", type=_positive, metavar="S", help="stay there for S seconds"
    )
    parser.add_argument(
        "--allow-unreachable",
        action="store_true",
        help="go as near as possible, flagged, instead of refusing",
    )
    parser.add_argument(
        "--take-over", action="store_true", help="take the command from another client"
    )
    parser.add_argument("--json", action="store_true", help="print the daemon's answer as JSON")
    add_connection(parser)


def _target(text: str) -> tuple[str, float]:
    """(axis, value) from "4.5", whose axis is "", or "x=4.5"."""
    axis, _, value = text.rpartition("=")
    return axis, _finite(value)


def _finite(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a finite number; write it without a unit (targets are in the "
            "daemon's displacement unit, times in seconds)"
        )
    return value


def _positive(text: str) -> float:
    value = _finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError("must be greater than 0")
    return value


def run(args: argparse.Namespace) -> int:
    """Send, and with --for keep sending."""
    from dehyst.daemon import clock

    targets = dict(args.target)
    if len(targets) < len(args.target) or ("" in targets and len(targets) > 1):
        raise BadInput("one target, or one for each axis: x=4.5 y=2")
    named = None if "" in targets or not targets else list(targets)
    with connect_axes(args, "send", named) as stage:
        if args.stop or args.release:
            stage.stop() if args.stop else stage.release()
            say("stopped: holding, then to the safe voltage" if args.stop else "released")
            return 0
        if "" in targets:
            if len(stage) > 1:
                first, value = next(iter(stage)), targets[""]
                raise BadInput(
                    f"{stage.name} has the axes {', '.join(stage)}: say which, as {first}={value:g}"
                )
            targets = dict.fromkeys(stage, targets[""])
        stage.wait_until_started(told=say)
        if args.take_over:
            stage.take_over()
        replies = stage.send(targets, args.allow_unreachable)
        setpoints = [client.config().setpoint for client in stage.clients.values()]
        stale_s = min(setpoint.stale_s for setpoint in setpoints)
        if args.json:
            sent = {
                axis: {"target": value, "unit": stage[axis].unit, "reply": replies[axis]}
                for axis, value in targets.items()
            }
            print_json(sent if len(sent) > 1 else next(iter(sent.values())))
        else:
            for axis, value in targets.items():
                client = stage[axis]
                where = going_to(value, client.status())
                say(f"{client.name}: {where}, held for {args.seconds or stale_s:g} s")
                say(f"{client.name}: {positioning(client.status())}")
        end_ns = clock.monotonic_ns() + round((args.seconds or 0.0) * clock.NS)
        pause_s = min(stale_s, *(setpoint.lease_s for setpoint in setpoints)) / 4
        while (left_s := (end_ns - clock.monotonic_ns()) / clock.NS) > 0:
            clock.sleep_s(min(pause_s, left_s))
            stage.send(targets, args.allow_unreachable)
        if args.seconds and not args.json:
            for axis in targets:
                client = stage[axis]
                say(f"{client.name}: at the end {positioning(client.status())}")
    return 0


def going_to(target: float, status: "Status") -> str:
    """Where the stage goes, in words."""
    low, high, unit = status.reach_min, status.reach_max, status.unit
    nearest = min(max(target, low), high)
    if nearest == target or math.isnan(nearest):
        return f"going to {target:g} {unit}"
    return f"{target:g} {unit} cannot be reached: going to {nearest:.6g} {unit}, the nearest"
