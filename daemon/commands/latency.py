"""Test whether this machine meets the loop's deadlines."""

import argparse
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from dehyst.daemon.config import Config, load_config
from dehyst.daemon.json_text import print_json
from dehyst.daemon.latency import machine
from dehyst.daemon.latency.latency import Setup, measure, time_devices
from dehyst.daemon.latency.latency_report import describe_latency, latency_figures
from dehyst.daemon.loop.checks import SPARE, devices_of
from dehyst.daemon.loop.timing.histogram import Histogram
from dehyst.drivers.direct_calls import Reachable
from dehyst.models.errors import BadInput

MOST_CPUS = 1024  # of a set of CPUs in Linux
EPILOG = """\
Runs the daemon's own loop on a simulated stage, in this process, with the priority, CPU and engine
of --config if given, and times the device calls of an emulated MDT693B and KSG101, or with
--config those of the configured sensor. On a configured amplifier it sets no voltage; the time of
its call is the one that its driver measures when it opens the unit.

exit status: 0 if the rate was sustained; 1 if more than one deadline, and more than one in 10 000,
was missed, or if the device calls do not fit into the period.

examples: dehyst latency
          dehyst latency --rate 10000 --for 60
          dehyst latency --config /etc/dehyst/stage.toml --json
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst latency`."""
    parser.epilog = EPILOG
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="sampling rate (default: that of --config, else what the devices allow, at most 1000)",
    )
    parser.add_argument(
        "--for",
        dest="seconds",
        type=float,
        default=30.0,
        metavar="SECONDS",
        help="duration (default: %(default)g)",
    )
    parser.add_argument("--config", metavar="FILE", type=Path, help="a daemon's configuration")
    parser.add_argument("--engine", choices=("compiled", "python"), help="engine of the loop")
    parser.add_argument("--priority", type=int, help="FIFO priority; 0: ordinary; default: 80")
    parser.add_argument("--cpu", type=int, help="pin the loop to this CPU; default: none")
    parser.add_argument("--spin", type=float, metavar="US", help="loop.spin_us")
    parser.add_argument("--no-io", action="store_true", help="do not time the device calls")
    parser.add_argument("--json", action="store_true", help="results as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Measure and report; return 0 if the deadlines are met, otherwise 1."""
    config = load_config(args.config) if args.config else None
    _setup(args, config, _default_hz({}))  # check the arguments before measuring anything
    io = {} if args.no_io else time_devices(config)
    setup = _setup(args, config, _default_hz(io))
    with _progress(setup.seconds):
        outcome = measure(setup)
    outcome.io.update(io)
    found = machine.facts(setup.cpu)
    hints = machine.advice(found, outcome.obtained, setup.cpu, setup.priority, setup.rate_hz)
    if args.json:
        print_json(latency_figures(outcome, found, hints))
    else:
        print("\n".join(describe_latency(outcome, found, hints, sys.stdout.isatty())))
    return 0 if outcome.held else 1


def _default_hz(io: dict[str, Histogram]) -> float:
    """Return the default loop rate [Hz]: the highest for which the devices leave time, at most
    1000."""
    busy_us = sum(h.quantile(0.99) for h in io.values())
    return min(1000.0, round(SPARE * 1e6 / busy_us, -1)) if busy_us else 1000.0


def _setup(args: argparse.Namespace, config: Config | None, default_hz: float) -> Setup:
    loop = config.loop if config else None
    compiled = config is None or all(isinstance(one, Reachable) for one in devices_of(config))
    engine = args.engine or ("compiled" if compiled else "python")
    if loop is not None and args.engine is None and loop.engine != "auto":
        engine = loop.engine

    def chosen(given: Any, configured: Any, default: Any) -> Any:
        return given if given is not None else configured if loop is not None else default

    setup = Setup(
        chosen(args.rate, loop and loop.rate_hz, default_hz),
        args.seconds,
        engine,
        chosen(args.priority, loop and loop.priority, 80),
        chosen(args.cpu, loop and loop.cpu, -1),
        chosen(args.spin, loop and loop.spin_us, None),
    )
    for name, value, low, high in (
        ("--rate", setup.rate_hz, 1.0, 20_000.0),
        ("--for", setup.seconds, 0.1, 86_400.0),
        ("--priority", setup.priority, 0, 99),
        ("--cpu", setup.cpu, -1, MOST_CPUS - 1),
        ("--spin", setup.spin_us or 0.0, 0.0, 1000.0),
    ):
        if not low <= value <= high:
            raise BadInput(f"{name} {value:g} is outside {low:g} to {high:g}")
    usable = machine.usable_cpus()
    if setup.cpu >= 0 and setup.cpu not in usable:
        known = ", ".join(map(str, usable))
        raise BadInput(f"CPU {setup.cpu} (--cpu, loop.cpu): this process can use only CPUs {known}")
    return setup


def _progress(seconds: float) -> Any:
    if not sys.stderr.isatty():
        return nullcontext()
    from rich.console import Console

    return Console(stderr=True).status(f"measuring for {seconds:g} s")
