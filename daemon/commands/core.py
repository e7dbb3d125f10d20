"""the real-time process alone (for systemd)"""

import argparse
import os
import signal

from dehyst.daemon import realtime
from dehyst.daemon.config import load_config


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.epilog = "example: dehyst core --config /etc/dehyst/stage.toml"


def run(args: argparse.Namespace) -> int:
    if os.environ.get("DEHYST_SUPERVISED"):
        realtime.die_with_parent(signal.SIGTERM)
    from dehyst.daemon.core import run_core

    run_core(load_config(args.config))
    return 0
