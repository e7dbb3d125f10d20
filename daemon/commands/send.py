"""Send one set-point to a running daemon, or stop it."""

import argparse
import math

from dehyst.daemon.remote import add_connection, connect, print_json, say

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
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError("a finite number is needed")
    return value


def _positive(text: str) -> float:
    value = _finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError("must be greater than 0")
    return value


def run(args: argparse.Namespace) -> int:
    """Send, and with --for keep sending."""
    from dehyst.daemon import clock

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
            where = f"{args.target:g} {client.unit}"
            stale_s = config.setpoint.stale_s
            say(f"{client.name}: going to {where}, held for {args.seconds or stale_s:g} s")
        end_ns = clock.monotonic_ns() + round((args.seconds or 0.0) * clock.NS)
        pause_s = min(config.setpoint.stale_s, config.setpoint.lease_s) / 4
        while (left_s := (end_ns - clock.monotonic_ns()) / clock.NS) > 0:
            clock.sleep_s(min(pause_s, left_s))
            client.send(args.target, args.allow_unreachable)
    return 0
