"""Shared by the remote commands: connecting to a daemon and printing results."""

import argparse
import getpass
import os
import socket
import sys
from collections.abc import Sequence

from dehyst.daemon.client.client import ADDRESS, CREDENTIALS, DEFAULT, Client
from dehyst.daemon.client.group import Group
from dehyst.daemon.printable import printable
from dehyst.drivers import system


def add_connection(parser: argparse.ArgumentParser) -> None:
    """Add the options --connect, --credentials, --name and --base."""
    group = parser.add_argument_group("connection")
    group.add_argument(
        "--connect",
        metavar="ADDRESS",
        help="zenoh address of the daemon or of a router (default: $DEHYST_CONNECT, else "
        f"{DEFAULT})",
    )
    group.add_argument(
        "--credentials",
        metavar="PATH",
        help="directory with ca.pem, certificate.pem and key.pem, or a file with name:password "
        "(default: $DEHYST_CREDENTIALS)",
    )
    group.add_argument(
        "--name",
        "--to",
        help="the controller's name, if several answer; with several axes also an axis name, "
        "such as stage-1-x",
    )
    group.add_argument(
        "--base", default="dehyst", help="first chunks of the keys (default: dehyst)"
    )


def address_of(args: argparse.Namespace) -> tuple[str, str]:
    """Return (address, credentials) from the options, else the environment, else the defaults."""
    where = args.connect or os.environ.get(ADDRESS, DEFAULT)
    given = args.credentials
    return where, os.environ.get(CREDENTIALS, "") if given is None else given


def connect(args: argparse.Namespace, what: str) -> Client:
    """Return the client of one command. `what` names the command to others. Raises BusError."""
    return Client(args.name, args.connect, args.base, label_of(what), args.credentials)


def connect_axes(args: argparse.Namespace, what: str, axes: Sequence[str] | None = None) -> Group:
    """Same as `connect`, for these axes of the controller; None: all."""
    return Group(args.name, axes, args.connect, args.base, label_of(what), args.credentials)


def label_of(what: str) -> str:
    """Return the label that identifies this command to others."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):  # Windows has no pwd
        user = f"user {system.user_id()}"
    return f"dehyst {what} of {user} on {socket.gethostname()}, process {os.getpid()}"


def say(text: str) -> None:
    """Print a line for the user on stderr; stdout is reserved for results."""
    print(printable(text), file=sys.stderr, flush=True)
