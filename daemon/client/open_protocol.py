"""Options shared by the servers of foreign protocols (`dehyst epics`, `dehyst serve`), and their
checks. These protocols have no passwords."""

import argparse
import ipaddress

from dehyst.daemon.client.connection import add_connection
from dehyst.models.errors import BadInput


def add_serving(parser: argparse.ArgumentParser) -> None:
    """Add --without-passwords, --on-target, --tolerance and the connection options."""
    parser.add_argument(
        "--without-passwords",
        action="store_true",
        help="allow addresses beyond this machine; everybody who reaches them may command",
    )
    parser.add_argument(
        "--on-target",
        choices=("model", "gauge"),
        default="model",
        help="criterion for on target",
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.0,
        metavar="UM",
        help="distance that counts as on target, stage's unit (default: 0.2 %% of the reach)",
    )
    add_connection(parser)


def check_tolerance(tolerance: float) -> None:
    """Raise BadInput if the tolerance is negative."""
    if tolerance < 0.0:
        raise BadInput(f"--tolerance {tolerance:g}: it must be 0 or positive")


def check_exposure(listen: str, host: str, allowed: bool, protocol: str, ways: str) -> None:
    """Raise BadInput if other machines could reach the server and this was not allowed.

    listen: the option as given; host: an address or a name; protocol: name of the protocol without
    passwords; ways: the options that allow it, for the message."""
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    if not local and not allowed:
        raise BadInput(
            f"--listen {listen}: {protocol} has no passwords, so anybody who reaches this "
            f"address could command the stage; {ways}"
        )
