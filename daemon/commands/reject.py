"""Reject the model that the doctor offers; if it is already in use, restore the previous one."""

import argparse
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from dehyst.daemon.client.connection import add_connection, connect_axes, say
from dehyst.models.errors import NotNow

if TYPE_CHECKING:
    from dehyst.daemon.bus.messages import DoctorReport
    from dehyst.daemon.client.client import Client
    from dehyst.daemon.client.group import Group

NOTHING_OFFERED = "nothing is offered; `dehyst doctor` says what was found"
EPILOG = """With several axes it rejects the offer of the axis that has one, or of --name.
Exit 0: rejected; 1: there is no offer; 2: refused (the reason is printed) or no daemon.

example: dehyst reject
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst reject`."""
    parser.epilog = EPILOG
    add_offer(parser)
    add_connection(parser)


def add_offer(parser: argparse.ArgumentParser) -> None:
    """Add the argument --offer."""
    parser.add_argument(
        "--offer",
        type=int,
        metavar="NUMBER",
        help="number of the offer (default: the newest; see `dehyst doctor`)",
    )


def find_offer(
    reports: "Sequence[DoctorReport]", number: int | None, states: tuple[str, ...]
) -> "DoctorReport":
    """Return the offer with this number, or the newest in one of these states. Raises NotNow if
    there is none."""
    offers = [r for r in reports if r.offer is not None]
    if number is not None:
        offers = [r for r in offers if r.offer is not None and r.offer.number == number]
    else:
        offers = [r for r in offers if r.state in states]
    if not offers:
        raise NotNow(NOTHING_OFFERED)
    return offers[-1]


def offer_of_axes(
    stage: "Group", number: int | None, states: tuple[str, ...]
) -> "tuple[Client, DoctorReport]":
    """Return the axis with such an offer, and the offer. Raises NotNow if no axis has one, or if
    several have."""
    found = {}
    for client in stage.clients.values():
        with suppress(NotNow):
            found[client.name] = client, find_offer(client.doctor(), number, states)
    if len(found) > 1:
        raise NotNow(f"there are offers at {', '.join(found)}: choose one with --name")
    if not found:
        raise NotNow(NOTHING_OFFERED)
    return next(iter(found.values()))


def run(args: argparse.Namespace) -> int:
    """Reject the offer; return 0."""
    with connect_axes(args, "reject") as stage:
        client, report = offer_of_axes(stage, args.offer, ("found", "waiting", "trial", "accepted"))
        assert report.offer is not None
        client.decide_offer("reject", report.offer.number)
        waits = report.state in ("found", "waiting")
        stays = "the model in use stays" if waits else "the previous model is restored"
        say(f"{report.case}: rejected; {stays}")
    return 0
