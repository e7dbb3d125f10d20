"""design the drive for a recording, or check that a recording excites enough"""

import argparse
import json
from pathlib import Path
from typing import Any

from dehyst.daemon import separation
from dehyst.daemon.recordings import read_recording, write_recording
from dehyst.models.coverage import Coverage, coverage
from dehyst.models.errors import BadInput
from dehyst.models.excitation import SINES, Excitation, design
from dehyst.models.recording import Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst excite`."""
    parser.description = (
        "Design a drive of superimposed sines that covers the range and all rates evenly, with "
        "loops of all sizes, a gentle start and a safe end; or, with --check, say whether a "
        "recording excites enough; or, with --separate, design the drive that tells two effects "
        "apart. Exit status 1: --check found something missing."
    )
    parser.epilog = (
        "examples: dehyst excite --range 0 75 --band 10 --duration 20 -o drive.csv\n"
        "          dehyst excite --check run.csv --picture coverage.png\n"
        "          dehyst excite --separate delay lag --range 0 75 -o tell-apart.csv"
    )
    parser.add_argument("--range", nargs=2, type=float, metavar=("MIN", "MAX"), help="drive range")
    parser.add_argument("--unit", default="v", choices=("v", "um", "nm", "counts"),
                        help="unit of the range (default v)")  # fmt: skip
    parser.add_argument("--band", type=float, metavar="HZ", help="fastest sine")
    parser.add_argument("--duration", type=float, metavar="S", help="length of the drive")
    parser.add_argument("--sampling", type=float, default=1000.0, metavar="HZ",
                        help="samples per second (default 1000)")  # fmt: skip
    parser.add_argument("--sines", type=int, default=SINES, metavar="N",
                        help=f"how many (default {SINES})")  # fmt: skip
    parser.add_argument("--slew", type=float, metavar="PER_S", help="largest rate allowed, unit/s")
    parser.add_argument("-o", "--output", type=Path, metavar="DRIVE.csv")
    parser.add_argument("--check", nargs="+", type=Path, metavar="REC",
                        help="judge these recordings together instead")  # fmt: skip
    separation.add_arguments(parser)
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="what is covered")
    parser.add_argument("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Design or check; 1 when a check finds something missing."""
    if args.separate:
        return separation.write_separation(args)
    return _check(args) if args.check else _design(args)


def _design(args: argparse.Namespace) -> int:
    absent = [f"--{name}" for name in ("range", "band", "duration", "output")
              if getattr(args, name) is None]  # fmt: skip
    if absent:
        raise BadInput(
            f"{', '.join(absent)} missing; a drive needs --range, --band, --duration, -o"
        )
    low, high = args.range
    drive = design(low, high, args.band, args.duration, args.sampling, sines=args.sines,
                   slew_per_s=args.slew)  # fmt: skip
    write_recording(args.output, drive.t_s, {f"u_{args.unit}": drive.u}, _notes(drive, args.unit))
    covered = coverage([Recording(drive.t_s, drive.u, drive_unit=args.unit)])
    _picture(covered, args.unit, args.picture)
    sines = [{"amplitude": a, "frequency_hz": f}
             for a, f in zip(drive.amplitudes, drive.frequencies_hz, strict=True)]  # fmt: skip
    if args.json:
        print(json.dumps({"output": str(args.output), "sines": sines, "rate_max": drive.rate_max,
                          **_facts(covered)}, indent=2))  # fmt: skip
        return 0
    print(f"{args.output}: {drive.t_s.size} samples, {drive.t_s[-1]:.4g} s")
    for sine in sines:
        print(f"  {sine['amplitude']:8.4g} {args.unit} at {sine['frequency_hz']:.4g} Hz")
    print(
        f"rates up to {drive.rate_max:.4g} {args.unit}/s, {covered.covered:.0%} of drive and rate "
        f"covered; starts and ends at rest at {drive.u[0]:g} {args.unit}"
    )
    return 0


def _notes(drive: Excitation, unit: str) -> dict[str, str]:
    notes = {"made_by": "dehyst excite"}
    for i, (a, f) in enumerate(zip(drive.amplitudes, drive.frequencies_hz, strict=True), 1):
        notes[f"sine{i}"] = f"{a:.6g} {unit} at {f:.6g} Hz"
    return notes


def _check(args: argparse.Namespace) -> int:
    recordings = [read_recording(path) for path in args.check]
    covered = coverage(recordings)
    unit = recordings[0].drive_unit
    _picture(covered, unit, args.picture)
    missing = [*covered.missing, *covered.missing_rate]
    defects = [text for one in recordings if (text := one.defects())]
    if args.json:
        print(json.dumps({**_facts(covered), "defects": defects}, indent=2))
        return 1 if missing else 0
    low, high = covered.drive_edges[0], covered.drive_edges[-1]
    print(
        f"drive {low:.4g} to {high:.4g} {unit}, {covered.cycles:.1f} times through the range, "
        f"rates up to {covered.rate_max:.4g} {unit}/s, {covered.covered:.0%} of drive and rate "
        f"covered, {covered.rest_s:.3g} s at rest"
    )
    for text in [*missing, *defects]:
        print(f"missing: {text}" if text in missing else f"note: {text}")
    if not missing:
        print("enough for a static and for a rate-dependent model")
    elif not covered.missing:
        print("enough for a static model")
    return 1 if missing else 0


def _facts(covered: Coverage) -> dict[str, Any]:
    return {
        "drive_min": float(covered.drive_edges[0]),
        "drive_max": float(covered.drive_edges[-1]),
        "largest_rate": covered.rate_max,
        "covered": covered.covered,
        "cycles": covered.cycles,
        "rest_s": covered.rest_s,
        "missing": list(covered.missing),
        "missing_for_rate": list(covered.missing_rate),
    }


def _picture(covered: Coverage, unit: str, path: Path | None) -> None:
    if path is None:
        return
    from dehyst.daemon.report_identify_pictures import coverage as draw  # matplotlib is slow

    try:
        path.write_bytes(draw(covered, unit))
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from None
