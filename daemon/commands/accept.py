"""Accept the model that the doctor offers, on trial."""

import argparse
import sys

from dehyst.daemon.client.connection import add_connection, connect_axes, say
from dehyst.daemon.client.offer_change import CUTS, cuts_trajectory, describe_change
from dehyst.daemon.commands.reject import add_offer, find_offer, offer_of_axes
from dehyst.daemon.terminal.number_options import within
from dehyst.models.errors import BadInput, NotNow

EPILOG = """\
The loop switches to the model without a jump, within range and slew; the configured file stays
unchanged. The model is on trial: if its error has not fallen after `doctor.trial_s` of motion, the
loop returns to the previous model, and an event names the reason. After `doctor.trial_limit_s` the
trial ends with the motion seen so far. An offer that is accepted during another trial waits until
that trial ends. The command first shows the change in reach, error and rate. If a trajectory is
playing and the reach shrinks, it asks for confirmation; --yes confirms. With several axes it
accepts the offer of the axis that has one, or of --name.
Exit 0: accepted, or with --wait confirmed; 1: there is no offer, or with --wait the loop returned
to the previous model; 2: refused (the reason is printed) or no daemon.

examples: dehyst accept
          dehyst accept --wait 60
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst accept`."""
    parser.epilog = EPILOG
    add_offer(parser)
    parser.add_argument(
        "--wait",
        type=within(0.0, 86_400.0),
        default=0.0,
        metavar="S",
        help="wait at most S seconds for the end of the trial",
    )
    parser.add_argument(
        "--yes",
        action="store_true",
        help="do not ask where the trajectory in play may leave the new reach",
    )
    add_connection(parser)


def require_consent() -> None:
    """Ask whether to go on. Raises BadInput if nobody can be asked, NotNow if the answer is no."""
    if not sys.stdin.isatty():
        raise BadInput(f"{CUTS}; --yes accepts: they are played at the nearest position")
    say(f"{CUTS}: these are played at the nearest position and flagged. Accept? [y/N]")
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise NotNow("not accepted; the offer stays")


def run(args: argparse.Namespace) -> int:
    """Accept the offer; with --wait, also wait for the result of its trial."""
    from dehyst.daemon import clock

    with connect_axes(args, "accept") as stage:
        client, report = offer_of_axes(stage, args.offer, ("found",))
        assert report.offer is not None
        status = client.status()
        say(f"{report.case}: {describe_change(report.offer, status)}")
        if cuts_trajectory(report.offer, status) and not args.yes:
            require_consent()
        others = [r.case for r in client.doctor() if r.state == "trial"]
        client.decide_offer("accept", report.offer.number)
        waits = f"it waits until the trial of {others[-1]} is over; then it is " if others else ""
        say(
            f"{report.case}: accepted; {waits}on trial for {report.offer.trial_s:g} s of motion, "
            f"at most {report.offer.trial_limit_s:g} s in all; then the loop keeps it "
            "or returns to the previous model"
        )
        end_ns = clock.monotonic_ns() + round(args.wait * clock.NS)
        while clock.monotonic_ns() < end_ns:
            clock.sleep_s(0.25)
            now = find_offer(client.doctor(), report.offer.number, ())
            if now.state in ("accepted", "returned", "rejected"):
                say(now.says.removeprefix(report.says).strip())
                return 0 if now.state == "accepted" else 1
    if args.wait:
        raise NotNow(f"the trial is not over after {args.wait:g} s: does the stage move?")
    return 0
