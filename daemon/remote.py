"""What the remote commands share: how to reach a daemon, and how to print results."""

import argparse
import getpass
import os
import socket
import sys
from typing import Any

import msgspec

from dehyst.daemon.client import DEFAULT, Client


def add_connection(parser: argparse.ArgumentParser) -> None:
    """--connect, --name and --base."""
    group = parser.add_argument_group("connection")
    group.add_argument(
        "--connect",
        metavar="ADDRESS",
        default=os.environ.get("DEHYST_CONNECT", DEFAULT),
        help="zenoh address of the daemon or of a router (default: $DEHYST_CONNECT, else "
        f"{DEFAULT})",
    )
    group.add_argument(
        "--credentials",
        metavar="PATH",
        default=os.environ.get("DEHYST_CREDENTIALS", ""),
        help="directory with ca.pem, certificate.pem and key.pem, or a file with name:password "
        "(default: $DEHYST_CREDENTIALS)",
    )
    group.add_argument("--name", help="the controller's name, where several answer")
    group.add_argument(
        "--base", default="dehyst", help="first chunks of the keys (default: dehyst)"
    )


def connect(args: argparse.Namespace, what: str) -> Client:
    """The client of one command. `what` tells others who commands. Raises BusError."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError):
        user = f"user {os.getuid()}"
    label = f"dehyst {what} of {user} on {socket.gethostname()}, process {os.getpid()}"
    return Client(args.name, args.connect, args.base, label, args.credentials)


def print_json(value: Any) -> None:
    """One JSON value on stdout; NaN becomes null."""
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n")


def say(text: str) -> None:
    """A line for the user, on stderr: stdout belongs to results."""
    print(text, file=sys.stderr, flush=True)
