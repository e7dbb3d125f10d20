"""Bring the output to its configured safe state (for systemd)."""

import argparse
import sys
from contextlib import ExitStack

from dehyst.daemon.config import load_controller
from dehyst.daemon.rings import run_folder
from dehyst.models.errors import DehystError


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration (TOML)")
    parser.description = (
        "After the loop's process has died, ramp the output of every axis to safe.voltage_v or "
        "leave it, depending on safe.on_fault."
    )
    parser.epilog = "example: dehyst safe --config /etc/dehyst/stage.toml"


def run(args: argparse.Namespace) -> int:
    from dehyst.daemon.service.safe_state import make_safe

    controller = load_controller(args.config)
    with ExitStack() as held:
        try:
            held.enter_context(
                run_folder.at_work(controller.directory, run_folder.OUTPUT, "safe", args.config)
            )
        except run_folder.InUse:
            raise
        except DehystError as error:  # a bad folder must not keep the output from its safe state
            print(f"dehyst safe: {error}; continuing without it", file=sys.stderr)
        outputs = make_safe(controller)
    for name, volts in outputs.items():
        of = f" of {name}" if len(outputs) > 1 else ""
        print(f"output{of} at {volts:.3f} V", file=sys.stderr)
    return 0
