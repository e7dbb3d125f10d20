"""Design the drive for a recording, or check that a recording excites enough."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from dehyst.daemon.config import load_config
from dehyst.daemon.config.plausible import check_plausible
from dehyst.daemon.files.foreign.reading import add_reading
from dehyst.daemon.files.given_recordings import read_given
from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.outputs import add_force, check_outputs, report_failures, whole_file
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.json_text import print_json
from dehyst.models.drive_design.coverage import Coverage, measure_coverage
from dehyst.models.drive_design.excitation import SINES, Excitation, design
from dehyst.models.drive_design.scans import MOST_SAMPLES
from dehyst.models.drive_design.separation import EFFECTS, SeparatingDrive, separate
from dehyst.models.drive_design.waveforms import LEAST_SEPARATING, MOST_SEPARATING, Limits
from dehyst.models.errors import BadInput
from dehyst.models.model import Model
from dehyst.models.recording import Recording
from dehyst.models.units import how_many, spell_unit

SECONDS, SPANS_PER_S = 20.0, 200.0  # defaults of --separate: duration, slew in spans per second


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst excite`."""
    parser.description = (
        "Design a drive of superimposed sines that covers the range and all rates evenly, with "
        "loops of all sizes, a gentle start and a safe end; or, with --check, report whether a "
        "recording excites enough; or, with --separate, design the drive that distinguishes "
        "two effects. Exit status 1: --check found that the recording lacks excitation."
    )
    parser.epilog = (
        "examples: dehyst excite --range 0 75 --band 10 --duration 20 -o drive.csv\n"
        "          dehyst excite --config stage.toml --band 5 --duration 20 -o drive.csv\n"
        "          dehyst excite --check run.csv --picture coverage.png\n"
        "          dehyst excite --separate delay lag --range 0 75 -o separate.csv"
    )
    parser.add_argument("--range", nargs=2, type=float, metavar=("MIN", "MAX"), help="drive range")
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="range, sampling and slew of this stage; other options must lie within these",
    )
    parser.add_argument(
        "--unit",
        default="v",
        choices=("v", "um", "nm", "counts"),
        help="unit of the range (default v)",
    )
    parser.add_argument("--band", type=float, metavar="HZ", help="fastest sine")
    parser.add_argument("--duration", type=float, metavar="S", help="length of the drive")
    parser.add_argument(
        "--sampling",
        type=float,
        metavar="HZ",
        help="samples per second (default: --config's, else 1000)",
    )
    parser.add_argument(
        "--sines", type=int, default=SINES, metavar="N", help=f"number of sines (default {SINES})"
    )
    parser.add_argument("--slew", type=float, metavar="PER_S", help="largest rate allowed, unit/s")
    parser.add_argument("-o", "--output", type=Path, metavar="DRIVE.csv")
    parser.add_argument(
        "--check",
        nargs="+",
        type=Path,
        metavar="REC",
        help="check these recordings instead of designing a drive",
    )
    parser.add_argument(
        "--separate",
        nargs=2,
        metavar=("A", "B"),
        help=f"design the drive that distinguishes effect A from B: {', '.join(EFFECTS)}",
    )
    parser.add_argument("--model", metavar="MODEL.toml", help="the stage's model, for --separate")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="plot the coverage of the drive-rate plane"
    )
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Design or check; return 1 if a check finds something missing."""
    check_outputs([args.output, args.picture], [*(args.check or []), args.model], args.force)
    if args.check:
        return _check(args)
    _take_config(args)
    return _separate(args) if args.separate else _design(args)


def _take_config(args: argparse.Namespace) -> None:
    """Take range, sampling and slew from the configuration unless they are given. Raises BadInput
    if given values exceed its limits."""
    if args.config is not None:
        config = load_config(args.config)
        gain, limits = config.actuator.gain, config.limits
        low, high, slew = limits.min_v / gain, limits.max_v / gain, limits.slew_v_per_s / gain
        args.range = args.range or [low, high]
        args.slew = slew if args.slew is None else args.slew
        args.sampling = config.loop.rate_hz if args.sampling is None else args.sampling
        if min(args.range) < low or max(args.range) > high or args.slew > slew:
            raise BadInput(
                f"{args.config} allows {low:g} to {high:g} {spell_unit(args.unit)} at {slew:g} "
                f"{spell_unit(args.unit)}/s; "
                "--range and --slew must lie within"
            )
    args.sampling = 1000.0 if args.sampling is None else args.sampling


def _design(args: argparse.Namespace) -> int:
    absent = [
        f"--{name}"
        for name in ("range", "band", "duration", "output")
        if getattr(args, name) is None
    ]
    if absent:
        raise BadInput(
            f"{', '.join(absent)} missing; a drive needs --range, --band, --duration, -o"
        )
    low, high = args.range
    _check_sizes(args, args.duration, MOST_SAMPLES)
    drive = design(
        low, high, args.band, args.duration, args.sampling, sines=args.sines, slew_per_s=args.slew
    )
    write_recording(args.output, drive.t_s, {f"u_{args.unit}": drive.u}, _notes(drive, args.unit))
    covered = measure_coverage([Recording(drive.t_s, drive.u, drive_unit=args.unit)])
    _picture(covered, args.unit, args.picture)
    sines = [
        {"amplitude": a, "frequency_hz": f}
        for a, f in zip(drive.amplitudes, drive.frequencies_hz, strict=True)
    ]
    if args.json:
        facts = {"sines": sines, "rate_max": drive.rate_max, **_facts(covered)}
        print_json({"output": str(args.output), **facts})
        return 0
    print(f"{args.output}: {how_many(drive.t_s.size, 'sample')}, {drive.t_s[-1]:.4g} s")
    for sine in sines:
        print(
            f"  {sine['amplitude']:8.4g} {spell_unit(args.unit)} at {sine['frequency_hz']:.4g} Hz"
        )
    print(
        f"rates up to {drive.rate_max:.4g} {spell_unit(args.unit)}/s, "
        f"{covered.covered:.0%} of the drive-rate plane covered; starts and ends at rest at "
        f"{drive.u[0]:g} {spell_unit(args.unit)}"
    )
    return 0


def _check_sizes(args: argparse.Namespace, seconds: float, most: int) -> None:
    """Raise BadInput, which names the option, if no stage has such a range, or the drive would have
    more than `most` samples."""
    if args.range is not None:
        check_plausible("--range", args.range, args.unit)
    if seconds * args.sampling > most:
        raise BadInput(
            f"--duration {seconds:g}: {seconds * args.sampling:.3g} samples at {args.sampling:g} "
            f"Hz; at most {most} are written, so at most "
            f"{most / args.sampling:.3g} s: shorten the drive, or lower --sampling"
        )


def _notes(drive: Excitation, unit: str) -> dict[str, str]:
    notes = {"made_by": "dehyst excite"}
    for i, (a, f) in enumerate(zip(drive.amplitudes, drive.frequencies_hz, strict=True), 1):
        notes[f"sine{i}"] = f"{a:.6g} {unit} at {f:.6g} Hz"
    return notes


def _check(args: argparse.Namespace) -> int:
    recordings = read_given(args.check, args, need_displacement=False)
    covered = measure_coverage(recordings)
    unit = recordings[0].drive_unit
    _picture(covered, unit, args.picture)
    missing = [*covered.missing, *covered.missing_rate]
    defects = [text for one in recordings if (text := one.defects())]
    if args.json:
        print_json({**_facts(covered), "defects": defects})
        return 1 if missing else 0
    low, high = covered.drive_edges[0], covered.drive_edges[-1]
    print(
        f"drive {low:.4g} to {high:.4g} {spell_unit(unit)}, "
        f"range traversed {covered.cycles:.1f} times, "
        f"rates up to {covered.rate_max:.4g} {spell_unit(unit)}/s, "
        f"{covered.covered:.0%} of the drive-rate plane covered, {covered.rest_s:.3g} s at rest"
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
    from dehyst.daemon.report import coverage as covers  # importing matplotlib takes long
    from dehyst.daemon.report.plotting import draw_side_by_side

    draws = (
        partial(covers.draw_drive_and_rate, covered, unit),
        partial(covers.draw_loop_sizes, covered),
    )
    with report_failures(path), whole_file(path) as file:
        file.write(draw_side_by_side(draws, (1.2, 1.0)))


def _separate(args: argparse.Namespace) -> int:
    """Design and write the drive (`t_s`, `u_<unit>`), and print how well it separates the effects.

    Range and unit come from --range and --unit, otherwise from the model. Raises BadInput for
    unknown names, or limits that allow no drive.
    """
    a, b = args.separate
    model = load_model(args.model) if args.model else None
    if args.output is None:
        raise BadInput("--output missing; --separate needs -o DRIVE.csv")
    if args.range is None and model is None:
        raise BadInput("--range missing; --separate needs the drive's range or --model")
    valid = model.validity if model else None
    low, high = args.range or (valid.drive_min, valid.drive_max)  # type: ignore[union-attr]
    if not args.sampling > 0:
        raise BadInput(f"--sampling: must be greater than 0, not {args.sampling:g}")
    rate = SPANS_PER_S * (high - low) if args.slew is None else args.slew
    seconds = SECONDS if args.duration is None else args.duration
    _check_sizes(args, seconds, MOST_SEPARATING)
    if seconds * args.sampling < LEAST_SEPARATING:
        raise BadInput(
            f"--duration {seconds:g}: {seconds * args.sampling:.3g} samples at {args.sampling:g} "
            f"Hz; at least {LEAST_SEPARATING} distinguish effects: lengthen the drive, or raise "
            "--sampling"
        )
    limits = Limits(low, high, rate, 1.0 / args.sampling, seconds)
    experiment = separate(a, b, limits, model)
    unit = model.drive_unit if model else args.unit
    notes = {"made_by": "dehyst excite", "purpose": f"separate {a} from {b}"}
    notes["waveform"] = experiment.chosen.waveform.name
    write_recording(args.output, experiment.t_s, {f"u_{unit}": experiment.drive}, notes)
    if args.json:
        print_json(_separation_facts(args, experiment, model))
        return 0
    print(experiment.says)
    print(
        f"{args.output}: {how_many(experiment.t_s.size, 'sample')}, {limits.seconds:g} s, "
        f"{low:g} to {high:g} {spell_unit(unit)}, at most {rate:g} {spell_unit(unit)}/s"
    )
    return 0


def _separation_facts(
    args: argparse.Namespace, experiment: SeparatingDrive, model: Model | None
) -> dict[str, object]:
    a, b = args.separate
    return {
        "output": str(args.output),
        "separate": [a, b],
        "waveform": experiment.chosen.waveform.name,
        "says": experiment.says,
        "unit": model.displacement_unit if model else "um",
        "tried": [
            {"waveform": s.waveform.name, f"left_{a}": s.left_a, f"left_{b}": s.left_b}
            for s in experiment.tried
        ],
    }
