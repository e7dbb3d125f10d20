"""Send one set-point to a running daemon, or stop it."""

import argparse
import math
from typing import TYPE_CHECKING

from dehyst.daemon.client.connection import add_connection, connect, print_json, say

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Status

EPILOG = """A set-point is held for `setpoint.stale_s` of the daemon's configuration (2 s by
default); then the daemon holds and ramps to its safe voltage. --for keeps the stage there by
sending again.
Exit 0: taken; 2: refused (the reason is printed) or no daemon.

examples:
  dehyst send 4.5 --for 10
  dehyst send --stop
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst send`."""
    parser.epilog = EPILOG
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "target", nargs="?", type=_finite, metavar="UM", help="target, from the set-point origin"
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
    from dehyst.daemon.rings.status import positioning

    with connect(args, "send") as client:
        if args.stop or args.release:
            client.stop() if args.stop else client.release()
            say("stopped: holding, then to the safe voltage" if args.stop else "released")
            return 0
        if args.take_over:
            client.take_over()
        reply = client.send(args.target, args.allow_unreachable)
        config = client.config()
        if args.json:
            print_json({"target": args.target, "unit": client.unit, "reply": reply})
        else:
            where = going_to(args.target, client.status())
            stale_s = config.setpoint.stale_s
            say(f"{client.name}: {where}, held for {args.seconds or stale_s:g} s")
            say(f"{client.name}: {positioning(client.status())}")
        end_ns = clock.monotonic_ns() + round((args.seconds or 0.0) * clock.NS)
        pause_s = min(config.setpoint.stale_s, config.setpoint.lease_s) / 4
        while (left_s := (end_ns - clock.monotonic_ns()) / clock.NS) > 0:
            clock.sleep_s(min(pause_s, left_s))
            client.send(args.target, args.allow_unreachable)
        if args.seconds and not args.json:
            say(f"{client.name}: at the end {positioning(client.status())}")
    return 0


def going_to(target: float, status: "Status") -> str:
    """Where the stage goes, in words."""
    low, high, unit = status.reach_min, status.reach_max, status.unit
    nearest = min(max(target, low), high)
    if nearest == target or math.isnan(nearest):
        return f"going to {target:g} {unit}"
    return f"{target:g} {unit} cannot be reached: going to {nearest:.6g} {unit}, the nearest"
