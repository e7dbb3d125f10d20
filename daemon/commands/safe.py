"""bring the output to its configured safe state (for systemd)"""

import argparse
import sys

from dehyst.daemon.config import load_config


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.description = (
        "After the loop's process has died: ramp the output to safe.voltage_v, or leave it, "
        "as safe.on_fault says."
    )
    parser.epilog = "example: dehyst safe --config /etc/dehyst/stage.toml"


def run(args: argparse.Namespace) -> int:
    from dehyst.daemon.safe import make_safe

    volts = make_safe(load_config(args.config))
    print(f"output at {volts:.3f} V", file=sys.stderr)
    return 0
