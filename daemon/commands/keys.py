"""Make certificates for a controller and its clients."""

import argparse
import re
from pathlib import Path

from dehyst.models.errors import BadInput

MOST_DAYS = 36_500  # a hundred years
DAYS = 825  # the longest validity that Apple's systems accept of a server's certificate
EPILOG = """\
DIR/authority contains the authority's key: do not keep it on the controller. DIR/NAME of each
certificate contains ca.pem, certificate.pem and key.pem. To add clients, run the command again with
the same DIR. In the controller's configuration:

  [bus]
  listen = ["tls/0.0.0.0:7447"]
  [bus.auth]
  certificates = "stage"        # the directory made here
  operators = ["alice"]
  observers = ["bob"]

On a client: dehyst watch --connect tls/stage.lab:7447 --credentials alice

example: dehyst keys keys --controller stage --host stage.lab --host 10.0.0.5 --client alice
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst keys`."""
    parser.epilog = EPILOG
    parser.add_argument("directory", type=Path, metavar="DIR")
    parser.add_argument("--controller", metavar="NAME", help="make the controller's certificate")
    parser.add_argument(
        "--host",
        action="append",
        default=[],
        help="name or address under which clients reach the controller; may be repeated",
    )
    parser.add_argument(
        "--client", action="append", default=[], metavar="NAME", help="make a client's certificate"
    )
    parser.add_argument(
        "--days",
        type=int,
        default=DAYS,
        help=f"validity of a certificate in days (default: {DAYS})",
    )


def run(args: argparse.Namespace) -> int:
    """Make the requested files; print what was made."""
    from dehyst.daemon.bus.certificates import Authority

    if not args.controller and not args.client:
        raise BadInput("nothing to make: give --controller or --client")
    if bool(args.controller) != bool(args.host):
        raise BadInput("--controller and --host belong together: the addresses go into it")
    if not 1 <= args.days <= MOST_DAYS:
        raise BadInput(f"--days: from 1 to {MOST_DAYS}, not {args.days}")
    for host in args.host:
        if not re.fullmatch(r"[A-Za-z0-9.:_-]{1,253}", host):
            raise BadInput(
                f"--host {host!r}: an address or a name of a-z, 0-9, . and -; write a name with "
                "other letters as its xn-- form"
            )
    names = [*args.client, *([args.controller] if args.controller else [])]
    for name in names:
        if not re.fullmatch(r"[a-z0-9][a-z0-9._-]{0,62}", name) or name == "authority":
            raise BadInput(f"{name!r}: a name may hold a-z, 0-9, ., _ and -")
    if len(set(names)) < len(names):
        raise BadInput("a name is given twice")
    there = [name for name in names if (args.directory / name / "key.pem").exists()]
    if there:
        raise BadInput(
            f"{args.directory / there[0]} has a key already, and a key is never replaced; choose "
            "another name or folder, or delete that folder first"
        )
    authority = Authority(args.directory, args.days)
    if args.controller:
        authority.issue(args.directory / args.controller, args.controller, args.host)
    for name in args.client:
        authority.issue(args.directory / name, name)
    for name in names:
        print(args.directory / name)
    return 0
