"""Write a commented configuration."""

import argparse
from pathlib import Path
from typing import Any

from dehyst.daemon.config import load_controller, parse_config
from dehyst.daemon.config.sections import MOST_RATE_HZ, check_name
from dehyst.daemon.config.text import SLEW_SPANS, check_range, limits_within, write_commented
from dehyst.daemon.files.known_units import ACTUATOR, SENSOR
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import add_force, check_outputs, report_failures
from dehyst.daemon.loop.checks import check_unopened
from dehyst.daemon.service.pin import pin_units, with_serial
from dehyst.models.errors import BadInput

EPILOG = """\
`dehyst config init` writes a configuration with every key: the values that you give, and all other
keys as comments with their default, meaning and allowed values. It moves nothing; if the units
answer, it also writes their serial numbers. The voltage limits are required.
docs/reference-configuration.md lists all keys.

`dehyst config pin` registers the units that are plugged in now as those of a configuration: the
daemon sets a voltage only on these units, and names any other unit that it finds.

exit status: 0; 2 if an input is wrong, or the file exists (--force replaces it).

examples: dehyst config init --range 0 100 -o stage.toml
          dehyst config pin --config stage.toml
          dehyst config init --range 0 10 --actuator nidaqmx --set channel=Dev1/ao0 \\
            --sensor nidaqmx --sensor-set channel=Dev1/ai0 --sensor-set um_per_v_per_v=1000
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst config`."""
    parser.epilog = EPILOG
    parser.add_argument("what", choices=("init", "pin"), help="write one; accept its units")
    parser.add_argument("--config", metavar="FILE", type=Path, help="pin: of this configuration")
    parser.add_argument(
        "--range",
        nargs=2,
        type=float,
        metavar=("MIN", "MAX"),
        help="init: voltage limits of the stage, V",
    )
    parser.add_argument(
        "--slew",
        type=float,
        metavar="V_PER_S",
        help="largest rate of the voltage (default: 20 ranges per second)",
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=200.0,
        metavar="HZ",
        help="rate of the loop (default: %(default)g)",
    )
    parser.add_argument(
        "--name", default="stage-1", help="the controller's name (default: %(default)s)"
    )
    parser.add_argument(
        "--model",
        default="stage.model.toml",
        metavar="MODEL.toml",
        help="model file, relative to the configuration (default: %(default)s)",
    )
    parser.add_argument(
        "--actuator",
        default="mdt693b",
        metavar="DRIVER",
        help="actuator driver, see `dehyst drivers` (default: %(default)s)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a setting of the actuator's driver; may be repeated",
    )
    parser.add_argument(
        "--sensor", default="ksg101", metavar="DRIVER", help="sensor driver (default: %(default)s)"
    )
    parser.add_argument(
        "--sensor-set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a setting of the sensor's driver",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="output file (default: stdout)"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Write the configuration, or with `pin` accept the connected units; return 0."""
    if args.what == "pin":
        if args.config is None:
            raise BadInput("pin: name the configuration: --config FILE")
        print("\n".join(pin_units(load_controller(args.config), args.config)))
        return 0
    if args.config is not None:
        raise BadInput("--config goes with pin")
    if args.range is None:
        raise BadInput("init: give the voltage limits of the stage: --range MIN MAX")
    low, high = args.range
    check_name(args.name)
    check_range(low, high, args.slew)
    if not 0.0 < args.rate <= MOST_RATE_HZ:
        raise BadInput(
            f"--rate {args.rate:g}: a sampling rate in Hz, above 0 and at most {MOST_RATE_HZ}"
        )
    slew = args.slew or SLEW_SPANS * (high - low)
    actuator = with_serial(ACTUATOR, args.actuator, parse_settings(args.set))
    sensor = with_serial(SENSOR, args.sensor, parse_settings(args.sensor_set))
    text = write_commented(
        {
            "": {"name": args.name},
            "model": {"file": args.model},
            "loop": {"rate_hz": args.rate},
            "actuator": {"driver": args.actuator, "settings": actuator},
            "sensor": {"driver": args.sensor, "settings": sensor},
            **limits_within(low, high, slew),
        }
    )
    check_unopened(parse_config(text, "the configuration"))
    if args.output is None:
        print(text, end="")
        return 0
    check_outputs([args.output], [], args.force)
    with report_failures(args.output):
        write_text(args.output, text)
    return 0


def parse_settings(pairs: list[str]) -> dict[str, Any]:
    """Parse KEY=VALUE words into settings; a value that is not valid TOML is a string."""
    import tomllib

    table: dict[str, Any] = {}
    for pair in pairs:
        key, sign, text = pair.partition("=")
        if not sign or not key.isidentifier():
            raise BadInput(f"{pair}: write KEY=VALUE")
        try:
            table[key] = tomllib.loads(f"x = {text}")["x"]
        except tomllib.TOMLDecodeError:
            table[key] = text
    return table
