"""Record a unit's answers, raw bytes and timings, or report the devices of a configuration."""

import argparse
import json
import math
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dehyst import __version__
from dehyst.daemon.config import load_controller
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import add_force, check_outputs, report_failures
from dehyst.daemon.service.device_report import lines_of, report_devices
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.drivers.apt.link import USB_IDS as GAUGES
from dehyst.drivers.call_times import CallTimes
from dehyst.drivers.interface import DeviceNotFound
from dehyst.drivers.kpc101 import probe as controllers
from dehyst.drivers.kpc101.kinds import ONE_CHANNEL, THREE_CHANNELS
from dehyst.drivers.kpz101 import probe as piezos
from dehyst.drivers.kpz101.driver import KIND as PIEZOS
from dehyst.drivers.ksg101 import probe as gauges
from dehyst.drivers.mdt693b import probe as amplifiers
from dehyst.drivers.mdt693b.codec import Dialect
from dehyst.drivers.mdt693b.settings import Mdt693bConfig, find_port
from dehyst.drivers.recorded import RecordedExchange
from dehyst.drivers.serial_port import SerialPort, find_usb_ports
from dehyst.models.errors import BadInput

TIMED = 100  # calls of each kind, for percentiles up to 99 %
AMPLIFIER, GAUGE, PIEZO = "mdt693b", "ksg101", "kpz101"
CONTROLLER, RACK = ONE_CHANNEL.driver, THREE_CHANNELS.driver
APT_UNITS = (GAUGE, PIEZO, CONTROLLER, RACK)
NAMES = {AMPLIFIER: "MDT693B or MDT694B", GAUGE: "KSG101", PIEZO: "KPZ101"}
NAMES |= {CONTROLLER: "KPC101 or BPC301", RACK: "BPC303"}

EPILOG = f"""\
Determines whether an MDT693B, MDT694B or KPZ101 (amplifiers), a KSG101 (gauge reader), or a KPC101,
BPC301 or BPC303 (both) is connected to the port. Sends requests, and to the MDT69xB also an empty
line and two unknown words; changes no setting and moves no output. PORT is a path or "auto" (the
MDT69xB on USB; with --unit of another kind the only APT unit). Stop all other programs that use the
unit first.

--sets V times {TIMED} sets of axis x, all to V, and only if the unit reads back V within 1 V. The
unit does not report its set-point, so give its actual set-point: otherwise the output moves by the
difference.

--config opens the devices of a configuration, with any driver, as the daemon does, and prints their
identity, range, resolution, time per call and the rate that they sustain. Nothing moves; a disabled
KPZ101 is enabled, at 0 V.

exit status: 0; 1 if another device answers, or nothing does.

examples: dehyst probe /dev/ttyACM0 -o my-amplifier.json
          dehyst probe /dev/ttyUSB0 -o my-gauge.json
          dehyst probe --config stage.toml
"""


@dataclass(frozen=True)
class _Probed:
    """Result of a probe. unit: a key of NAMES, "" if no unit was recognised; facts: for --json and
    the fixture; lines: for the user."""

    unit: str
    exchanges: list[RecordedExchange]
    facts: dict[str, Any]
    timings: dict[str, Any]
    lines: list[str]


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst probe`."""
    parser.epilog = EPILOG
    parser.add_argument("port", nargs="?", metavar="PORT", help="serial port, or auto")
    parser.add_argument(
        "--config", metavar="FILE", type=Path, help="open the devices of this configuration"
    )
    parser.add_argument("--unit", choices=tuple(NAMES), help="probe for this unit only")
    parser.add_argument("-o", "--output", metavar="FILE", help="write the recording (JSON)")
    parser.add_argument("--baud", type=int, default=115200, help="default: %(default)s")
    parser.add_argument(
        "--sets", type=float, metavar="V", help="also time sets of an MDT693B, at the set-point V"
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")


def run(args: argparse.Namespace) -> int:
    """Record, interpret, time, report."""
    if (args.port is None) is (args.config is None):
        raise BadInput("give a PORT, or --config FILE")
    if args.config is not None:
        return _report(args)
    check_outputs([args.output], [], args.force)
    with closing(SerialPort(_path(args), args.baud)) as port:
        found = _probe(port, args)
        path = port.path
    fixture = {
        "format": 1,
        "made_by": f"dehyst {__version__}",
        "unit": found.unit,
        "baud": args.baud,
        "encoding": "latin-1",
        "dialect": found.facts.get("dialect", ""),
        "firmware": found.facts.get("firmware", ""),
        "timings": found.timings,
        "exchanges": [exchange.to_dict() for exchange in found.exchanges],
    }
    if args.output:
        with report_failures(args.output):
            write_text(args.output, json.dumps(fixture, indent=1) + "\n")
    if args.json:
        facts = {"port": path, "unit": found.unit, **found.facts, "timings": found.timings}
        print(json.dumps(facts, indent=2))
    else:
        print("\n".join([f"{path}: {found.lines[0]}", *found.lines[1:], *_times(found.timings)]))
    return 0 if found.unit else 1


def _report(args: argparse.Namespace) -> int:
    for option in ("unit", "output", "sets"):
        if getattr(args, option) is not None:
            raise BadInput(f"--{option} goes with a PORT, not with --config")
    configs = load_controller(args.config).axes
    reports = {config.axis: report_devices(config) for config in configs}
    if args.json:
        print(json.dumps(reports if len(configs) > 1 else reports[configs[0].axis], indent=2))
        return 0
    for axis, devices in reports.items():
        for which, device in devices.items():
            named = f"axis {axis} {which}" if len(configs) > 1 else which
            print("\n".join(lines_of(named, device)))
    return 0


def _path(args: argparse.Namespace) -> str:
    if args.port != "auto":
        return str(args.port)
    if args.unit not in APT_UNITS:
        return find_port(Mdt693bConfig(baud=args.baud))
    ports = find_usb_ports(GAUGES)
    if len(ports) != 1:
        raise DeviceNotFound(f"auto: {len(ports)} APT units on USB; give the port by its path")
    return ports[0].path


def _probe(port: SerialPort, args: argparse.Namespace) -> _Probed:
    """Probe for APT units first, then for an amplifier. APT requests have no line end, so an
    amplifier takes them as half a command, which its own probe discards before it asks."""
    asked = args.unit or (AMPLIFIER if args.sets is not None else "")
    heard: list[RecordedExchange] = []
    for units, probe in ((APT_UNITS, _probe_apt), ((AMPLIFIER,), _probe_amplifier)):
        if asked in ("", *units):
            found = probe(port, args.sets)
            if found.unit:
                return found
            heard += found.exchanges
    raw = b"".join(exchange.reply for exchange in heard)
    what = NAMES[asked] if asked else "MDT693B, MDT694B, KPZ101, KSG101, KPC101 or BPC303"
    says = f"answers {raw[:60]!r}, which is not an {what}" if raw else "does not answer"
    return _Probed("", heard, {}, {}, [f"{says}; check port, power and baud rate"])


def _probe_piezo(port: SerialPort, unit: gauges.ProbedGauge) -> _Probed:
    with progress_bar("requests") as progress:
        exchanges = gauges.record_requests(port, progress, requests=piezos.REQUESTS)
    piezo = piezos.interpret_driver_requests(exchanges)
    facts = {"model": unit.model, "serial": unit.serial_number, "firmware": unit.firmware}
    facts |= asdict(piezo)
    lines = [
        f"{unit.model}, firmware {unit.firmware}, serial number {unit.serial_number}",
        f"voltage limit {piezo.limit_v:g} V; set-point {piezo.output_v:.3f} V; output "
        f"{'enabled' if piezo.enabled else 'disabled'}",
    ]
    if not piezo.open_loop:
        lines.append("it is not in open loop: the driver refuses it")
    if not piezo.software_only:
        lines.append("its voltage source is not software only: the driver refuses it")
    return _Probed(PIEZO, exchanges, facts, {}, lines)


def _probe_controller(port: SerialPort, kind: str, heard: list[RecordedExchange]) -> _Probed:
    """Probe a controller with an output and perhaps a gauge per channel. heard: the exchanges so
    far, which are returned as well if no unit is found here."""
    requests = controllers.RACK_REQUESTS if kind == RACK else controllers.REQUESTS
    with progress_bar("requests") as progress:
        exchanges = gauges.record_requests(port, progress, requests=requests)
    unit = gauges.interpret_gauge_requests(exchanges)
    if not unit.model:
        return _Probed("", heard + exchanges, {}, {}, [])
    channels = controllers.interpret_channels(exchanges)
    facts = {"model": unit.model, "serial": unit.serial_number, "firmware": unit.firmware}
    found = [asdict(channel) | {"roles": list(channel.roles)} for channel in channels]
    lines = [
        f"{unit.model}, firmware {unit.firmware}, serial number {unit.serial_number}; driver {kind}"
    ]
    for channel in channels:
        lines += _lines_of_channel(channel)
    if not channels:
        lines.append("no channel answers: every bay is empty")
    return _Probed(kind, exchanges, facts | {"channels": found}, {}, lines)


def _lines_of_channel(channel: controllers.ProbedChannel) -> list[str]:
    reads = "out of range" if channel.position_um is None else f"{channel.position_um:.4f} um"
    travel = f"{channel.travel_um:g} um" if channel.travel_um else "not known: set max_travel_um"
    gauge = f"100 % is {travel}; it reads {reads}" if channel.gauge_connected else "no gauge"
    named = f"channel {channel.number}"
    lines = [
        f"{named}, {' and '.join(channel.roles)}: voltage limit {channel.limit_v:g} V; set-point "
        f"{channel.output_v:.3f} V; output {'enabled' if channel.enabled else 'disabled'}; {gauge}"
    ]
    if not channel.open_loop:
        lines.append(f"{named} is not in open loop: the driver refuses it")
    if not channel.software_only:
        lines.append(f"{named}: its voltage source is not software only: the driver refuses it")
    return lines


def _probe_apt(port: SerialPort, sets: float | None) -> _Probed:
    with progress_bar("requests") as progress:
        exchanges = gauges.record_requests(port, progress)
    unit = gauges.interpret_gauge_requests(exchanges)
    if not unit.model:
        return _probe_controller(port, RACK, exchanges)
    if unit.model.startswith(PIEZOS.models):
        return _probe_piezo(port, unit)
    if unit.model.startswith(ONE_CHANNEL.models):
        return _probe_controller(port, CONTROLLER, [])
    facts = {
        "model": unit.model,
        "serial": unit.serial_number,
        "firmware": unit.firmware,
        "travel_um": unit.travel_um,
        "reading_um": unit.reading_um if math.isfinite(unit.reading_um) else None,
        "gauge_connected": unit.gauge_connected,
        "zeroed": unit.zeroed,
        "answers": unit.answers,
    }
    travel = f"{unit.travel_um:g} um" if unit.travel_um else "not known to it: set max_travel_um"
    reads = f"{unit.reading_um:.4f} um" if math.isfinite(unit.reading_um) else "out of range"
    lines = [
        f"{unit.model}, firmware {unit.firmware}, serial number {unit.serial_number}",
        f"100 % is {travel}; it reads {reads}; {'' if unit.gauge_connected else 'no '}gauge "
        f"connected, {'' if unit.zeroed else 'not '}zeroed",
    ]
    if "tsg_get_reading" not in unit.answers:
        return _Probed(GAUGE, exchanges, facts, {}, [*lines, "it gives no reading: no KSG101?"])
    timings = {"reading": _figures(gauges.time_readings(port, TIMED))}
    return _Probed(GAUGE, exchanges, facts, timings, lines)


def _probe_amplifier(port: SerialPort, sets: float | None) -> _Probed:
    with progress_bar("queries") as progress:
        exchanges = amplifiers.record_exchanges(port, progress)
    unit = amplifiers.interpret(exchanges)
    if not unit.dialect:
        return _Probed("", exchanges, {}, {}, [])
    dialect = Dialect.named(unit.dialect)
    timings = {"query": _figures(amplifiers.time_queries(port, dialect, TIMED))}
    if sets is not None:
        timings["set"] = _figures(amplifiers.time_sets(port, dialect, sets, TIMED))
    facts: dict[str, Any] = {"model": unit.model, "serial": unit.serial_number}
    lines = [
        f"{unit.model or 'unknown model'}, firmware {unit.firmware or 'unknown'}, "
        f"serial number {unit.serial_number or 'blank'}",
        f"dialect: {unit.dialect}",
    ]
    unclear = [q for q, a in unit.answers.items() if a.startswith(("unclear", "no answer"))]
    if unclear:
        lines.append(f"not understood: {', '.join(unclear)}; please share the file made with -o")
    facts |= {"firmware": unit.firmware, "dialect": unit.dialect, "answers": unit.answers}
    return _Probed(AMPLIFIER, exchanges, facts, timings, lines)


def _times(timings: dict[str, Any]) -> list[str]:
    return [
        f"{kind}: {1e3 * figures['p50_s']:.2f} ms median, {1e3 * figures['p99_s']:.2f} ms at "
        f"99 %; {figures['rate_hz']:.0f} per second are safe"
        for kind, figures in timings.items()
    ]


def _figures(times: CallTimes) -> dict[str, float]:
    figures = {f"p{p}_s": round(times.percentile_s(p), 6) for p in (50, 90, 99)}
    return figures | {"count": times.count, "rate_hz": round(1.0 / figures["p90_s"], 1)}
