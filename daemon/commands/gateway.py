"""Run only the network process (for systemd), between zenoh and the core's rings."""

import argparse
import logging
import signal

from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.rings import run_folder

EPILOG = """\
The gateway may be started before or after `dehyst core`, and restarted at any time without an
effect on the loop. It ends on SIGTERM.

example: dehyst gateway --config /etc/dehyst/stage.toml
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst gateway`."""
    parser.epilog = EPILOG
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT."""
    realtime.die_with_parent(signal.SIGTERM)
    from dehyst.daemon.config import load_controller

    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    controller = load_controller(args.config)
    with run_folder.at_work(controller.directory, run_folder.NETWORK, "gateway", args.config):
        from dehyst.daemon.gateway.process import run_gateway

        return run_gateway(controller)
