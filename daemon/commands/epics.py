"""Serve a controller as EPICS process variables."""

import argparse
import ipaddress
import sys

from dehyst.daemon.client.connection import connect_axes
from dehyst.daemon.client.open_protocol import add_serving, check_exposure, check_tolerance
from dehyst.models.errors import BadInput

DEFAULT = "127.0.0.1"
EPILOG = """\
Each axis is a motor record (VAL, RBV, DMOV, STOP, VELO, limits, alarms) with further PVs for volts,
error, trim, state and the doctor's offer. docs/epics.md lists them. Channel Access has no
passwords: anybody who reaches the address can command the stage, so an address beyond this machine
needs --without-passwords; --observe refuses every put.

examples: dehyst epics
          dehyst epics --prefix LAB:PIEZO: --observe
          dehyst epics --listen 192.168.1.10 --without-passwords
          EPICS_CA_ADDR_LIST=127.0.0.1 caput -c dehyst:stage-1 4.5
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst epics`."""
    parser.epilog = EPILOG
    parser.add_argument(
        "--prefix", help="prefix of all names (default: dehyst:NAME:, the controller's name)"
    )
    parser.add_argument(
        "--listen", default=DEFAULT, metavar="ADDRESS", help=f"interface (default: {DEFAULT})"
    )
    parser.add_argument(
        "--port", type=int, default=0, help="port (default: $EPICS_CA_SERVER_PORT, else 5064)"
    )
    parser.add_argument("--observe", action="store_true", help="refuse every put")
    add_serving(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until SIGTERM or Ctrl-C."""
    check_listening_address(args.listen, args.without_passwords or args.observe)
    check_tolerance(args.tolerance)
    if not 0 <= args.port <= 65535:
        raise BadInput(f"--port {args.port}: it must be from 0 to 65535")
    try:
        from dehyst.daemon.epics.server import axis_sources, records_of, serve_records
    except ImportError as error:
        raise BadInput(f"{error}; install it: pip install 'dehyst[epics]'") from None
    from dehyst.daemon.kernel_cache import load_lightly

    load_lightly()
    from dehyst.daemon.client.group import Group
    from dehyst.daemon.client.held_axes import HeldAxes

    def connect() -> Group:
        return connect_axes(args, "epics")

    with HeldAxes(connect, tolerance=args.tolerance, by=args.on_target) as held, connect() as asks:
        prefix = f"dehyst:{held.name}:" if args.prefix is None else args.prefix
        records = records_of(held, axis_sources(asks, args.observe), prefix)
        names = ", ".join(group.prefix for group in records)

        def ready(port: int) -> None:
            print(f"dehyst epics: {names} at {args.listen}:{port}", file=sys.stderr, flush=True)

        try:
            serve_records(records, args.listen, args.port, ready)
        except OSError as error:
            raise BadInput(f"--listen {args.listen}: {error.strerror or error}") from None
    return 0


def check_listening_address(text: str, allowed: bool) -> None:
    """Raise BadInput if it is not an address, or if other machines can reach it and that is not
    allowed."""
    try:
        ipaddress.ip_address(text)
    except ValueError:
        raise BadInput(f"--listen {text}: it must be an address such as 127.0.0.1") from None
    ways = "add --without-passwords if the network is trusted, or --observe"
    check_exposure(text, text, allowed, "Channel Access", ways)
