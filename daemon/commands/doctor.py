"""Show what the doctor found about mismatches; with --config, run its process (for the service)."""

import argparse
import logging
import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

from dehyst.daemon.client.connection import add_connection, connect_axes, say
from dehyst.daemon.files.outputs import add_force
from dehyst.daemon.json_text import print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dehyst.daemon.bus.messages import DoctorReport

EPILOG = """\
When the mismatch watch raises a flag, the doctor diagnoses the kept recording and offers a better
model if it finds one: `dehyst accept`, `dehyst reject`. With --config FILE this command runs the
doctor itself, as the service does, at the lowest priority, without devices or network.
Exit 0: no decision is pending; 1: an offer waits for a decision; 2: no daemon.

examples: dehyst doctor
          dehyst doctor --report report.html
          dehyst doctor --config /etc/dehyst/stage.toml
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst doctor`."""
    parser.epilog = EPILOG
    parser.add_argument("--config", metavar="FILE", help="run as the doctor of this configuration")
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write the newest report (HTML)"
    )
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print all kept reports as JSON")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Print the findings, or run the doctor's process."""
    return _be_doctor(args.config) if args.config else _print_report(args)


def _be_doctor(path: str) -> int:
    from dehyst.daemon.config import load_controller
    from dehyst.daemon.doctor.process import run_doctor
    from dehyst.daemon.loop.timing import realtime
    from dehyst.daemon.rings import run_folder

    realtime.die_with_parent(signal.SIGTERM)
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    controller = load_controller(path)
    os.nice(19)
    with run_folder.at_work(controller.directory, run_folder.DOCTOR, "doctor", path):
        return run_doctor(controller)


def _print_report(args: argparse.Namespace) -> int:
    from dehyst.daemon.files.outputs import check_outputs, whole_file

    check_outputs([args.report], [args.credentials], args.force)
    with connect_axes(args, "doctor") as stage:
        by_name = {client.name: client.doctor() for client in stage.clients.values()}
        if args.report:
            newest = max(
                stage.clients.values(), key=lambda one: newest_report_ns(by_name[one.name])
            )
            page = newest.doctor_page()
            with whole_file(args.report) as file:
                file.write(page)
    several = len(by_name) > 1
    if args.json:
        print_json(by_name if several else next(iter(by_name.values())))
    for name, reports in {} if args.json else by_name.items():
        whose = f"{name}: " if several else ""
        if not reports:
            print(f"{whose}the doctor has no report: no mismatch was recorded")
        for report in reports[-3:]:
            print(whose + "\n".join(describe_doctor(report)))
    if args.report:
        say(f"report: {args.report}")
    open_offers = [r[-1] for r in by_name.values() if r and r[-1].state == "found" and r[-1].offer]
    return 1 if open_offers else 0


def newest_report_ns(reports: "Sequence[DoctorReport]") -> int:
    """Return when the newest mismatch was detected [ns], or -1 if there is none."""
    return reports[-1].time_ns if reports else -1


def describe_doctor(report: "DoctorReport") -> list[str]:
    """Return a report as lines of text."""
    from dehyst.daemon.printable import printable

    lines = [f"{report.case}: {report.state}. {report.says}"]
    for effect in report.effects:
        ties = f" (or {', '.join(effect.ambiguous_with)})" if effect.ambiguous_with else ""
        lines.append(f"  {effect.name}{ties}, {100 * effect.share:.0f} %: {effect.says}")
    if report.offer is not None:
        o, unit = report.offer, report.unit
        trial = f"on trial for {o.trial_s:g} s of motion"
        if o.trial_limit_s:
            trial += f", at most {o.trial_limit_s:g} s in all"
        then = {
            "found": f"; `dehyst accept` puts it {trial}",
            "waiting": f"; then it is {trial}",
            "trial": f"; {trial}",
        }
        lines.append(
            f"  offer {o.number}: {o.rms_in_use:.3g} {unit} becomes {o.rms_offered:.3g} on "
            f"{o.seconds:.0f} s of later telemetry (noise {o.noise:.3g})"
            f"{then.get(report.state, '')}"
        )
    if report.experiment:
        lines.append(f"  next experiment: dehyst {' '.join(report.experiment)}")
    return [printable(line) for line in lines]
