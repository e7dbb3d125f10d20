"""Send one set-point to a running daemon, or stop it."""

import argparse
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from dehyst.daemon.client.connection import add_connection, connect_axes, say
from dehyst.daemon.json_text import print_json
from dehyst.daemon.rings.status import place, positioning
from dehyst.daemon.terminal.number_options import finite, positive
from dehyst.daemon.terminal.what_follows import (
    HELD,
    STAYS,
    after_a_stop,
    after_a_stop_in_fault,
    after_the_last,
    ramp_of,
    what_follows,
)
from dehyst.models.errors import BadInput

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import Reply, Status
    from dehyst.daemon.client.group import Group
    from dehyst.daemon.config import Config

EPILOG = """The stage moves to the target at `setpoint.approach_um_per_s` and stays there for
`setpoint.stale_s` of the daemon's configuration (2 s by default) and `setpoint.hold_s` (5 s); then
the output ramps to its safe voltage. --for S keeps the stage there for S seconds; --stay keeps it
there until another command, also after this one has ended (if the daemon's configuration has
`setpoint.stay = true`). --hold keeps the present voltage at any position.

exit status: 0: the daemon accepted the command; 2: it refused (the reason is printed), or there is
no daemon.

examples:
  dehyst send 4.5 --for 10
  dehyst send 4.5 --stay
  dehyst send x=4.5 y=2 --to stage-1
  dehyst send --hold
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
        help="target, from the set-point origin; for several axes x=4.5 y=2",
    )
    what.add_argument("--stop", action="store_true", help="drop all targets: hold, then ramp")
    what.add_argument("--hold", action="store_true", help="keep the present voltage")
    what.add_argument("--release", action="store_true", help="ramp to the safe voltage now")
    until = parser.add_mutually_exclusive_group()
    until.add_argument(
        "--for", dest="seconds", type=positive, metavar="S", help="stay there for S seconds"
    )
    until.add_argument(
        "--stay",
        action="store_true",
        help="stay there until another command, with no client",
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
    """Parse "4.5", whose axis is "", or "x=4.5" into (axis, value)."""
    axis, _, value = text.rpartition("=")
    return axis, finite(value)


def run(args: argparse.Namespace) -> int:
    """Send the command; with --for, keep sending it."""
    from dehyst.daemon import clock

    targets = dict(args.target)
    if len(targets) < len(args.target) or ("" in targets and len(targets) > 1):
        raise BadInput("one target, or one for each axis: x=4.5 y=2")
    named = None if "" in targets or not targets else list(targets)
    with connect_axes(args, "send", named) as stage:
        if args.stop or args.release:
            stage.stop() if args.stop else stage.release()
            say_stopped(stage) if args.stop else say_end(stage, released)
            if args.json:
                names = [client.name for client in stage.clients.values()]
                print_json({"stopped" if args.stop else "released": names})
            return 0
        if "" in targets:
            if len(stage) > 1:
                first, value = next(iter(stage)), targets[""]
                raise BadInput(
                    f"{stage.name} has the axes {', '.join(stage)}: say which, as {first}={value:g}"
                )
            targets = dict.fromkeys(stage, targets[""])
        stage.wait_until_started(on_wait=say)
        if args.take_over:
            stage.take_over()

        def command() -> "dict[str, Reply]":
            if args.hold:
                return stage.hold(args.stay)
            return stage.send(targets, args.allow_unreachable, args.stay)

        setpoints = [client.config().setpoint for client in stage.clients.values()]
        pause_s = min(min(s.stale_s, s.lease_s) for s in setpoints) / 4
        replies = command()
        try:
            say_sent(stage, targets, replies, args.json)
            end_ns = clock.monotonic_ns() + round((args.seconds or 0.0) * clock.NS)
            while (left_s := (end_ns - clock.monotonic_ns()) / clock.NS) > 0:
                clock.sleep_s(min(pause_s, left_s))
                command()
        except KeyboardInterrupt:
            say_end(stage, end_of(args, after_the_last))
            raise
        if not args.json:
            if args.seconds:
                for axis in replies:
                    say(f"{stage[axis].name}: {where(stage[axis].status())}")
            say_end(stage, end_of(args, what_follows))
    return 0


def say_sent(
    stage: "Group", targets: "Mapping[str, float]", replies: "Mapping[str, Reply]", as_json: bool
) -> None:
    """Print where each axis goes, or the replies as JSON."""
    if as_json:
        sent = {
            axis: {"target": targets.get(axis), "unit": stage[axis].unit, "reply": reply}
            for axis, reply in replies.items()
        }
        print_json(sent if len(sent) > 1 else next(iter(sent.values())))
        return
    for axis in replies:
        client = stage[axis]
        status = client.status()
        going = going_to(targets[axis], status) if axis in targets else "held"
        say(f"{client.name}: {going}; {positioning(status)}")


def where(status: "Status") -> str:
    """Describe the stage's present position and how it is controlled."""
    at = status.gateway
    return f"{place(at.measured, at.target, status.volts, status.unit)}; {positioning(status)}"


def say_stopped(stage: "Group") -> None:
    """Print what the stage does after a stop, which depends on the state that the stop found."""
    say_lines(
        stage,
        {
            client.name: describe_stop(client.config(), client.status())
            for client in stage.clients.values()
        },
    )


def describe_stop(config: "Config", status: "Status") -> str:
    """Describe what a stop does. status: just after it."""
    if status.state == "fault":
        return after_a_stop_in_fault(config)
    if status.state == "ready" and status.volts != config.safe.voltage_v:
        return (
            f"nothing moves, so the output stays at {status.volts:.4g} V; --release ramps it to "
            f"{config.safe.voltage_v:g} V"
        )
    return after_a_stop(config)


def end_of(
    args: argparse.Namespace, follows: "Callable[[Config], str]"
) -> "Callable[[Config], str]":
    """Return the description of what the stage does after the command: `follows` after a target."""
    if args.stay:
        return lambda _: HELD if args.hold else STAYS
    return after_a_stop if args.hold else follows


def say_end(stage: "Group", words: "Callable[[Config], str]") -> None:
    """Print what the stage does from now on."""
    of_axes = {client.name: words(client.config()) for client in stage.clients.values()}
    say_lines(stage, of_axes)


def say_lines(stage: "Group", of_axes: dict[str, str]) -> None:
    """Print one line per axis, or one if all are equal."""
    if len(set(of_axes.values())) == 1:
        of_axes = {stage.name: next(iter(of_axes.values()))}
    for name, text in of_axes.items():
        say(f"{name}: {text}")


def released(config: "Config") -> str:
    """Describe what a release does."""
    return f"{ramp_of(config)} now"


def going_to(target: float, status: "Status") -> str:
    """Describe where the stage goes; if the target cannot be reached, to the nearest position."""
    low, high, unit = status.reach_min, status.reach_max, status.unit
    nearest = min(max(target, low), high)
    if nearest == target or math.isnan(nearest):
        return f"going to {target:g} {unit}"
    return f"{target:g} {unit} cannot be reached: going to {nearest:.6g} {unit}, the nearest"
