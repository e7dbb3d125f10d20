"""the daemon in the foreground (without --config: on the simulated stage)"""

import argparse
import sys
import tempfile
from pathlib import Path

import msgspec

from dehyst.daemon.config import Config, load_config
from dehyst.models.errors import BadInput

DESCRIPTION = """\
The daemon in the foreground: the loop's process, the network's process, and their restarts.

Without --config it runs on the simulated stage, behind an emulated MDT693B and KSG101 on pseudo
terminals that the real serial drivers talk to.

SIGTERM or Ctrl-C ends it in the state that [safe] names; SIGHUP loads the model file again."""


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = DESCRIPTION
    parser.add_argument("--config", metavar="FILE", type=Path, help="configuration (TOML)")
    parser.add_argument(
        "--check", metavar="FILE", type=Path, help="read a configuration and its model, say what "
        "they mean, move nothing",
    )  # fmt: skip
    parser.add_argument(
        "--listen", default="tcp/127.0.0.1:7447", help="without --config: where clients connect"
    )
    parser.add_argument(
        "--model", metavar="MODEL.toml", help="without --config: this model, on a simulated stage "
        "that is scaled to it",
    )  # fmt: skip
    parser.add_argument("--name", default="bench", help="without --config: the daemon's name")
    parser.epilog = (
        "examples: dehyst run\n          dehyst run --model stage.toml\n          "
        "dehyst run --config /etc/dehyst/stage.toml"
    )


def say(text: str) -> None:
    """One line on stderr."""
    print(f"dehyst run: {text}", file=sys.stderr, flush=True)


def run(args: argparse.Namespace) -> int:
    if args.check:
        return check(args.check)
    if args.config and args.model:
        raise BadInput("--model goes without --config; a configuration names its model itself")
    from dehyst.daemon.supervisor import Bench, Supervisor

    if args.config:
        return Supervisor(load_config(args.config), args.config, say).run()
    from dehyst.daemon.benchconfig import Imitation, simulated_model, write_bench
    from dehyst.daemon.files import load_model

    model = load_model(args.model) if args.model else simulated_model()
    imitation = Imitation.of(model) if args.model else Imitation()

    with tempfile.TemporaryDirectory(prefix="dehyst-") as folder:
        directory = Path(folder)
        say("no --config: an emulated MDT693B and KSG101 with a simulated stage behind")
        bench = Bench(directory, list(imitation.stage))
        try:
            path = write_bench(directory, bench.ports, args.name, args.listen, model, imitation)
            say(f"configuration and model in {directory}; try `dehyst watch` in another terminal")
            return Supervisor(load_config(path), path, say).run()
        finally:
            bench.close()


def check(path: Path) -> int:
    """Print what a configuration means."""
    from dehyst.daemon.checks import drive_range, origin, reach
    from dehyst.daemon.files import load_model

    config: Config = load_config(path)
    model = load_model(config.model.file)
    low, high = reach(model, *drive_range(config, model))
    zero = origin(config.setpoint.origin, low, high)
    print(msgspec.json.format(msgspec.json.encode(config), indent=2).decode())
    unit = model.displacement_unit
    print(
        f"{path}: ok. Set-points from {low - zero:.4g} to {high - zero:.4g} {unit}; set-point 0 is "
        f"the model's {zero:.4g} {unit}; {config.loop.rate_hz:g} Hz; rings in {config.directory}",
        file=sys.stderr,
    )
    return 0
