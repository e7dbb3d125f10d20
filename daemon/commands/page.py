"""Serve a web page for one or many controllers."""

import argparse
import logging
import os
import signal
import sys
from pathlib import Path
from typing import Any

from dehyst.daemon.bus.security import check_page
from dehyst.daemon.client.connection import add_connection, address_of
from dehyst.daemon.config import PageConfig, load_controller
from dehyst.drivers import system
from dehyst.models.errors import BadInput

EPILOG = """\
Anybody on this machine may view the page and command the stage. On the network the page needs TLS
and passwords, for operators (view and command) and observers (view). /metrics is for Prometheus.

examples: dehyst page
          dehyst page --connect tcp/stage-pc:7447 --credentials observer/ --observe
          dehyst page --connect tcp/10.0.0.5:7447,tcp/10.0.0.6:7447        (several controllers)
          dehyst page --config /etc/dehyst/stage.toml      (with the settings of its [page])
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst page`."""
    parser.epilog = EPILOG
    default = PageConfig()
    parser.add_argument(
        "--listen", metavar="HOST:PORT", help=f"where it is served (default: {default.listen})"
    )
    parser.add_argument(
        "--public-url",
        metavar="URL",
        help="the address that people type, if a reverse proxy on this machine serves the page",
    )
    parser.add_argument("--observe", action="store_true", help="allow no commands from the page")
    parser.add_argument("--certificate", metavar="FILE", help="certificate for TLS (PEM)")
    parser.add_argument(
        "--key", metavar="FILE", help="private key of the certificate, for TLS (PEM)"
    )
    parser.add_argument("--passwords", metavar="FILE", help="name:password lines")
    for role in ("operators", "observers"):
        parser.add_argument(
            f"--{role}", metavar="NAMES", help="names in the password file, separated by commas"
        )
    parser.add_argument(
        "--config", metavar="FILE", type=Path, help="the daemon's configuration; its [page] is used"
    )
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until SIGTERM or Ctrl-C."""
    from dehyst.daemon.loop.timing import realtime

    realtime.die_with_parent(signal.SIGTERM)
    config, addresses, credentials, base = page_settings(args)
    from dehyst.daemon.kernel_cache import load_lightly

    load_lightly()
    # importing the server's packages takes long
    from dehyst.daemon.page.doors import open_door
    from dehyst.daemon.page.people import People, Public
    from dehyst.daemon.page.server import Tls, serve_page
    from dehyst.daemon.page.watching import Controllers

    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    check_page(config.listen, config.certificate, config.key, config.passwords, config.public_url)
    people = People(config.passwords, config.operators, config.observers, config.observe)
    check_files(config)
    system.allow_open_files()
    with open_door(config.listen) as door:
        controllers = Controllers(addresses, base, args.name, credentials)
        scheme = "https" if config.certificate else "http"
        where = config.public_url or f"{scheme}://{config.listen}/"
        print(f"dehyst page: {where}", file=sys.stderr, flush=True)
        try:
            tls = Tls(config.certificate, config.key)
            return serve_page(controllers, people, door, tls, Public.of(config.public_url))
        finally:
            controllers.close()


def page_settings(args: argparse.Namespace) -> tuple[PageConfig, list[str], str, str]:
    """Return ([page], addresses of the bus, credentials, base of the keys) from the arguments or
    from --config. Raises BadInput if both set the same."""
    if args.config is None:
        where, credentials = address_of(args)
        given: dict[str, Any] = {
            "certificate": args.certificate or "",
            "key": args.key or "",
            "passwords": args.passwords or "",
            "operators": split(args.operators),
            "observers": split(args.observers),
            "observe": args.observe,
            "public_url": args.public_url or "",
        }
        if args.listen:
            given["listen"] = args.listen
        return PageConfig(**given), where.split(","), credentials, args.base
    for name in (
        "listen",
        "public_url",
        "observe",
        "certificate",
        "key",
        "passwords",
        "operators",
        "observers",
        "connect",
        "credentials",
    ):
        if getattr(args, name):
            option = name.replace("_", "-")
            raise BadInput(f"--{option} cannot be combined with --config, whose [page] sets it")
    controller = load_controller(args.config)
    page, net = controller.page or PageConfig(), controller.bus
    addresses = [*(page.connect or (*net.listen, *net.connect)[:1])]
    return page, addresses, page.credentials, net.base


def split(names: str | None) -> tuple[str, ...]:
    """Split names at commas."""
    return tuple(n for n in (names or "").split(",") if n)


def check_files(config: PageConfig) -> None:
    """Raise BadInput if a TLS file cannot be read."""
    for what in ("certificate", "key"):
        path = getattr(config, what)
        if path and not os.access(path, os.R_OK):
            raise BadInput(f"page.{what}: {path} cannot be read")
