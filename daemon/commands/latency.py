"""self-test of this machine: does it hold the loop's deadlines?"""

import argparse
import json
import sys
import tempfile
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

from dehyst.daemon import machine
from dehyst.daemon.config import Config, load_config
from dehyst.daemon.histogram import Histogram
from dehyst.daemon.latency import Outcome, Setup, measure, time_actuator, time_sensor
from dehyst.daemon.records import MissCause
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.errors import BadInput

IO_S = 2.0
BAR = 46

EPILOG = """\
Runs the daemon's own loop on a simulated stage, in this process, with the priority, CPU and engine
of --config where there is one, and times the devices' calls: of an emulated MDT693B and KSG101, or
with --config of the configured sensor. It writes nothing to a configured amplifier.

exit status: 0 when the rate was held; 1 when more than one deadline in 10 000 was missed, or when
the device calls do not fit into the period.

examples: dehyst latency
          dehyst latency --rate 10000 --for 60
          dehyst latency --config /etc/dehyst/stage.toml --json
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Fill in the arguments."""
    parser.epilog = EPILOG
    parser.add_argument("--rate", type=float, metavar="HZ", help="default: 1000, or --config's")
    parser.add_argument(
        "--for", dest="seconds", type=float, default=30.0, metavar="SECONDS",
        help="how long; default: %(default)g",
    )  # fmt: skip
    parser.add_argument("--config", metavar="FILE", type=Path, help="a daemon's configuration")
    parser.add_argument("--engine", choices=("compiled", "python"), help="which loop")
    parser.add_argument("--priority", type=int, help="FIFO priority; 0: ordinary; default: 80")
    parser.add_argument("--cpu", type=int, help="pin the loop to this CPU; default: none")
    parser.add_argument("--spin", type=float, metavar="US", help="loop.spin_us")
    parser.add_argument("--no-io", action="store_true", help="leave the device calls out")
    parser.add_argument("--json", action="store_true", help="results as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Measure, report, judge."""
    config = load_config(args.config) if args.config else None
    setup = _setup(args, config)
    io = {} if args.no_io else _time_devices(config)
    with _progress(setup.seconds):
        outcome = measure(setup)
    outcome.io.update(io)
    found = machine.facts(setup.cpu)
    hints = machine.advice(found, outcome.obtained, setup.cpu, setup.priority, setup.rate_hz)
    if args.json:
        print(json.dumps(_table(outcome, found, hints), indent=2))
    else:
        print("\n".join(_report(outcome, found, hints, sys.stdout.isatty())))
    return 0 if outcome.held else 1


def _setup(args: argparse.Namespace, config: Config | None) -> Setup:
    loop = config.loop if config else None
    simulated = config is None or config.actuator.driver == config.sensor.driver == "simulated"
    engine = args.engine or ("compiled" if simulated else "python")
    if loop is not None and args.engine is None and loop.engine != "auto":
        engine = loop.engine

    def chosen(given: Any, configured: Any, default: Any) -> Any:
        return given if given is not None else configured if loop is not None else default

    setup = Setup(
        chosen(args.rate, loop and loop.rate_hz, 1000.0),
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
        ("--spin", setup.spin_us or 0.0, 0.0, 1000.0),
    ):
        if not low <= value <= high:
            raise BadInput(f"{name} {value:g} is outside {low:g} to {high:g}")
    return setup


def _time_devices(config: Config | None) -> dict[str, Histogram]:
    if config is not None:
        sensor = load_sensor(config.sensor.driver).from_settings(config.sensor.settings)
        with closing(sensor):
            sensor.open()
            return {f"read {config.sensor.driver}": time_sensor(sensor, IO_S)}
    from dehyst.daemon.supervisor import Bench

    with tempfile.TemporaryDirectory(prefix="dehyst-") as folder:
        bench = Bench(Path(folder), [])
        try:
            gauge = load_sensor("ksg101").from_settings({"port": bench.ports["ksg101"]})
            amplifier = load_actuator("mdt693b").from_settings({"port": bench.ports["mdt693b"]})
            with closing(gauge), closing(amplifier):
                gauge.open()
                amplifier.open()
                return {
                    "read emulated KSG101": time_sensor(gauge, IO_S),
                    "write emulated MDT693B": time_actuator(amplifier, IO_S),
                }
        finally:
            bench.close()


def _progress(seconds: float) -> Any:
    if not sys.stderr.isatty():
        return nullcontext()
    from rich.console import Console

    return Console(stderr=True).status(f"measuring for {seconds:g} s")


def _figures(histogram: Histogram) -> dict[str, float]:
    names = ("p50_us", "p99_us", "p99_9_us", "max_us")
    return dict(zip(names, (round(v, 1) for v in histogram.summary()), strict=True))


def _table(outcome: Outcome, found: dict[str, str], hints: list[str]) -> dict[str, Any]:
    setup, obtained = outcome.setup, outcome.obtained
    return {
        "held": outcome.held,
        "rate_hz": setup.rate_hz,
        "seconds": setup.seconds,
        "engine": setup.engine,
        "policy": "fifo" if obtained.fifo else "other",
        "priority": obtained.priority,
        "memory_locked": obtained.locked,
        "idle_states_bounded": obtained.awake,
        "cpus": list(obtained.cpus),
        "samples": outcome.samples,
        "missed": outcome.missed,
        "missed_by": outcome.missed_by,
        "missed_excused_by_witness": outcome.excused,
        "wake": _figures(outcome.wake),
        "execution": _figures(outcome.execution),
        "io": {name: _figures(h) for name, h in outcome.io.items()},
        "witness": {
            "threshold_us": outcome.stall_threshold_us,
            "late": outcome.stall_count,
            "longest_us_of_last_256": max(
                (late * 1e-3 for _, late, _ in outcome.stalls), default=0.0
            ),
            "by": {
                cause.name.lower(): sum(c is cause for _, _, c in outcome.stalls)
                for cause in MissCause
                if any(c is cause for _, _, c in outcome.stalls)
            },
        },
        "machine": found,
        "advice": hints,
    }


def _report(outcome: Outcome, found: dict[str, str], hints: list[str], pictures: bool) -> list[str]:
    setup, obtained = outcome.setup, outcome.obtained
    policy = f"FIFO {obtained.priority}" if obtained.fifo else "ordinary scheduling"
    memory = "memory locked" if obtained.locked else "memory not locked"
    idle = ", idle states bounded" if obtained.awake else ""
    lines = [
        f"{setup.rate_hz:g} Hz for {setup.seconds:g} s, {setup.engine} loop on a simulated stage",
        f"obtained: {policy}, {memory}{idle}, CPUs {', '.join(map(str, obtained.cpus))}",
        "machine: " + "; ".join(f"{name} {value}" for name, value in found.items() if value),
        "",
        f"{'microseconds':24}{'p50':>10}{'p99':>10}{'p99.9':>10}{'max':>10}",
    ]
    rows = {"wake-up lateness": outcome.wake, "execution": outcome.execution, **outcome.io}
    for name, histogram in rows.items():
        lines.append(f"{name:24}" + "".join(f"{v:10.1f}" for v in histogram.summary()))
    if pictures:
        for name, histogram in rows.items():
            lines += ["", f"{name}, us", *_bars(histogram)]
    lines += ["", *_verdict(outcome)]
    if hints:
        lines += ["", "advice:", *(f"- {hint}" for hint in hints)]
    return lines


def _bars(histogram: Histogram) -> list[str]:
    """One line a bin; the length grows with the logarithm, so that rare ones show."""
    rows = histogram.rows()
    most = max((n for _, _, n in rows), default=1)
    lines = []
    for low, high, n in rows:
        length = round(BAR * n.bit_length() / most.bit_length()) if n else 0
        lines.append(f"{low:9.1f} to {high:9.1f} {n:9d} {'#' * length}")
    return lines


def _verdict(outcome: Outcome) -> list[str]:
    own = outcome.missed - outcome.excused
    causes = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in outcome.missed_by.items())
    lines = [f"deadlines: {outcome.missed} of {outcome.samples} missed"]
    if outcome.missed:
        lines[0] += f" ({causes})"
        lines.append(
            f"  {outcome.excused} of them while the witness, at a higher priority on the same CPU, "
            f"was late as well: the machine's; {own} the program's own"
        )
    if outcome.stalls:
        longest = max(late for _, late, _ in outcome.stalls) * 1e-6
        lines.append(
            f"witness: late by more than {outcome.stall_threshold_us:.0f} us "
            f"{outcome.stall_count} times, {longest:.2f} ms at most among the last "
            f"{len(outcome.stalls)}"
        )
    else:
        lines.append(f"witness: never late by more than {outcome.stall_threshold_us:.0f} us")
    period_us = 1e6 / outcome.setup.rate_hz
    if outcome.io and outcome.io_us + outcome.execution.quantile(0.999) >= period_us:
        most_hz = 0.8e6 / (outcome.io_us + outcome.execution.quantile(0.999))
        lines.append(
            f"the device calls take {outcome.io_us:.0f} us of the {period_us:.0f} us period: these "
            f"devices allow about {most_hz:.0f} Hz"
        )
    lines.append(f"{outcome.setup.rate_hz:g} Hz {'held' if outcome.held else 'NOT held'}")
    return lines
