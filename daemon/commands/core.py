"""Run only the real-time process (for systemd)."""

import argparse
import signal

from dehyst.daemon.config import load_controller
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.rings import run_folder


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.epilog = "example: dehyst core --config /etc/dehyst/stage.toml"


def run(args: argparse.Namespace) -> int:
    realtime.die_with_parent(signal.SIGTERM)
    from dehyst.daemon.service.requests import Requests

    requests = Requests()
    controller = load_controller(args.config)
    with (
        requests.before_the_loop(),
        run_folder.at_work(controller.directory, run_folder.OUTPUT, "core", args.config),
    ):
        from dehyst.daemon.loop.process import run_core

        return run_core(controller, requests.serve)
