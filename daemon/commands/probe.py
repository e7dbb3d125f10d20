"""record a unit's raw bytes and timings into a fixture file"""

import argparse
import json
from contextlib import closing
from typing import Any

from dehyst import __version__
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.drivers.call_times import CallTimes
from dehyst.drivers.mdt693b import probe
from dehyst.drivers.mdt693b.codec import Dialect
from dehyst.drivers.mdt693b.settings import Mdt693bConfig, find_port
from dehyst.drivers.serial_port import SerialPort
from dehyst.models.errors import BadInput

TIMED = 100

EPILOG = f"""\
Sends queries, an empty line and two unknown words; changes no setting and moves no output.
PORT is a path or "auto" (the MDT69xB on USB). Stop everything else that uses the unit first.

--sets V times {TIMED} sets of axis x, all to V, and only if the unit reads back V within 1 V. The
unit cannot tell its set-point, so give the one that it really has: otherwise the output moves
by the difference.

exit status: 0; 1 when what answers is no MDT693B or nothing answers.

example: dehyst probe /dev/ttyACM0 -o my-unit.json
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Fill in the arguments."""
    parser.epilog = EPILOG
    parser.add_argument("port", metavar="PORT", help="serial port, or auto")
    parser.add_argument("-o", "--output", metavar="FILE", help="write the recording (JSON)")
    parser.add_argument("--baud", type=int, default=115200, help="default: %(default)s")
    parser.add_argument(
        "--sets", type=float, metavar="V", help="also time sets, at the set-point V"
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")


def run(args: argparse.Namespace) -> int:
    """Record, interpret, time, report."""
    check_outputs([args.output], [], args.force)
    config = Mdt693bConfig(port=args.port, baud=args.baud)
    with closing(SerialPort(find_port(config), config.baud)) as port:
        with progress_bar("queries") as progress:
            exchanges = probe.record_exchanges(port, progress)
        unit = probe.interpret(exchanges)
        timings: dict[str, Any] = {}
        if unit.dialect:
            dialect = Dialect.named(unit.dialect)
            timings["query"] = _figures(probe.time_queries(port, dialect, TIMED))
            if args.sets is not None:
                times = probe.time_sets(port, dialect, args.sets, TIMED)
                timings["set"] = _figures(times)
    fixture = {
        "format": 1,
        "made_by": f"dehyst {__version__}",
        "baud": args.baud,
        "encoding": "latin-1",
        "dialect": unit.dialect,
        "firmware": unit.firmware,
        "timings": timings,
        "exchanges": [exchange.to_dict() for exchange in exchanges],
    }
    if args.output:
        try:
            write_text(args.output, json.dumps(fixture, indent=1) + "\n")
        except OSError as error:
            raise BadInput(f"{args.output}: cannot be written: {error.strerror}") from None
    if args.json:
        found = {"port": port.path, "model": unit.model, "serial": unit.serial_number}
        found |= {k: fixture[k] for k in ("dialect", "firmware", "timings")}
        print(json.dumps(found | {"answers": unit.answers}, indent=2))
    else:
        print("\n".join(_report(port.path, unit, timings, exchanges)))
    return 0 if unit.dialect else 1


def _figures(times: CallTimes) -> dict[str, float]:
    figures = {f"p{p}_s": round(times.percentile_s(p), 6) for p in (50, 90, 99)}
    return figures | {"count": times.count, "rate_hz": round(1.0 / figures["p90_s"], 1)}


def _report(
    path: str,
    unit: probe.ProbedUnit,
    timings: dict[str, Any],
    exchanges: list[probe.RecordedExchange],
) -> list[str]:
    if not unit.dialect:
        raw = b"".join(exchange.reply for exchange in exchanges)
        heard = f"answers {raw[:60]!r}, which is no MDT693B" if raw else "does not answer"
        return [f"{path}: {heard}; check port, power and baud rate"]
    lines = [
        f"{path}: {unit.model or 'unknown model'}, firmware {unit.firmware or 'unknown'}, "
        f"serial number {unit.serial_number or 'blank'}",
        f"dialect: {unit.dialect}",
    ]
    for kind, figures in timings.items():
        lines.append(
            f"{kind}: {1e3 * figures['p50_s']:.2f} ms median, {1e3 * figures['p99_s']:.2f} ms at "
            f"99 %; {figures['rate_hz']:.0f} per second are safe"
        )
    unclear = [q for q, a in unit.answers.items() if a.startswith(("unclear", "no answer"))]
    if unclear:
        lines.append(f"not understood: {', '.join(unclear)}; please share the file made with -o")
    return lines
