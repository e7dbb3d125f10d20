"""identify a model from a recording"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from dehyst import __version__
from dehyst.daemon.files import save_model, write_text
from dehyst.daemon.recordings import read_recording
from dehyst.models.coverage import Coverage, coverage
from dehyst.models.errors import BadInput
from dehyst.models.identify import Identification, Options, identify
from dehyst.models.recording import Recording

Z95 = 1.96


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst identify`."""
    parser.description = (
        "Identify one invertible hysteresis model from one or more recordings of a stage. "
        "Thresholds, weights, rate-dependence and saturation are all found from the data; what "
        "is not given below is chosen on held-out rows and reported."
    )
    parser.epilog = (
        "examples: dehyst identify run.csv -o stage.toml --report findings\n"
        "          dehyst identify slow.csv fast.csv -o stage.toml --static --order 12"
    )
    parser.add_argument("recordings", nargs="+", type=Path, metavar="REC")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="MODEL.toml")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--static", action="store_true", help="no rate-dependence")
    kind.add_argument("--rate", action="store_true", help="rate-dependent weights")
    parser.add_argument("--order", type=int, metavar="N", help="number of play operators")
    parser.add_argument("--saturation", type=int, metavar="M", help="degree of the saturation")
    parser.add_argument(
        "--bias",
        action=argparse.BooleanOptionalAction,
        help="with or without even powers in the saturation (a loop that is not symmetric)",
    )
    parser.add_argument("--report", type=Path, metavar="DIR", help="write DIR/report.html")
    parser.add_argument("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Identify, write the model and the report; 0."""
    rate = True if args.rate else False if args.static else None
    options = Options(args.order, rate, args.saturation, args.bias)
    _check_places(args)
    started = time.monotonic()
    with working() as say:
        recordings = []
        for path in args.recordings:
            say(f"reading {path.name}")
            recordings.append(read_recording(path, need_displacement=True))
        result = identify(recordings, options, say)
        seconds = time.monotonic() - started
        model = replace(
            result.model,
            provenance=replace(
                result.model.provenance,
                created=datetime.now(UTC).isoformat(timespec="seconds"),
                version=__version__,
            ),
        )
        save_model(model, args.output)
        covered = coverage(recordings)
        report = None
        if args.report:
            say("writing the report")
            report = _write_report(result, recordings, covered, args)
    if args.json:
        print(json.dumps(summary(result, covered, args.output, seconds, report), indent=2))
    else:
        print(_words(result, covered, args.output, report))
    return 0


def _check_places(args: argparse.Namespace) -> None:
    if not args.output.resolve().parent.is_dir():
        raise BadInput(f"{args.output}: the folder does not exist")


@contextmanager
def working() -> Iterator[Callable[[str], None]]:
    """A line on a terminal that says what is being done; nothing in a pipe."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("starting") as status:
        yield lambda text: status.update(text)


def _write_report(
    result: Identification, recordings: list[Recording], covered: Coverage, args: argparse.Namespace
) -> Path:
    from dehyst.daemon.report_identify import page  # matplotlib takes its time

    path: Path = args.report / "report.html"
    try:
        args.report.mkdir(parents=True, exist_ok=True)
        write_text(path, page(result, recordings, covered, args.output.name))
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _missing(result: Identification, covered: Coverage) -> list[str]:
    return [*covered.missing, *(covered.missing_rate if result.shape.rate else ())]


def summary(
    result: Identification, covered: Coverage, output: Path, seconds: float, report: Path | None
) -> dict[str, Any]:
    """The result for machines."""
    fit, v = result.model.fit, result.model.validity
    return {
        "model": str(output),
        "report": str(report) if report else None,
        "structure": result.shape.name,
        "static": not result.shape.rate,
        "order": result.model.hysteresis.n,
        "saturation": max((1, *result.shape.powers)),
        "bias": result.shape.even,
        "unit": result.model.displacement_unit,
        "rms": fit.rms,
        "holdout_rms": fit.holdout_rms,
        "noise_rms": fit.noise_rms,
        "validity": {
            "drive_min": v.drive_min,
            "drive_max": v.drive_max,
            "rate_max": v.rate_max,
            "band_hz": v.band_hz,
            "period_s": v.period_s,
            "drive_unit": result.model.drive_unit,
        },
        "tried": [
            {
                "structure": c.shape.name,
                "drive_offset": c.offset,
                "holdout_rms": c.held_rms,
                "invertible": c.invertible,
            }
            for c in result.tried
        ],
        "orders": [{"order": n, "holdout_rms": rms} for n, rms in result.orders],
        "parameters": intervals(result),
        "notes": list(result.notes),
        "missing": _missing(result, covered),
        "seconds": round(seconds, 3),
    }


def intervals(result: Identification) -> dict[str, Any]:
    """Every number that the data determine, with its 95 % interval, by threshold and by power.

    slopes: dz/du after each operator has joined in, at the rates +rate_max and -rate_max (static:
    one for all rates); low and high are null where a slope stands on its bound.
    """
    h, n = result.model.hysteresis, result.model.hysteresis.n
    names = ("at_rate_max", "at_minus_rate_max") if result.shape.rate else ("at_all_rates",)
    slopes, errors, bound = result.params.slopes, result.errors.slopes, result.at_bound
    return {
        "slopes": [
            {"threshold": float(h.r[i])}
            | {
                name: _interval(slopes[i + j * n], errors[i + j * n], bool(bound[i + j * n]))
                for j, name in enumerate(names)
            }
            for i in range(n)
        ],
        "saturation": [
            {"power": power} | _interval(h.c[power], error)
            for power, error in zip(result.shape.powers, result.errors.c, strict=True)
        ],
        "offsets": [
            {"recording": i + 2} | _interval(value, error)
            for i, (value, error) in enumerate(
                zip(result.params.shifts, result.errors.shifts, strict=True)
            )
        ],
    }


def _interval(value: float, error: float, on_bound: bool = False) -> dict[str, Any]:
    value, half = float(value), Z95 * float(error)
    low, high = (None, None) if on_bound else (value - half, value + half)
    return {"value": value, "low": low, "high": high}


def _words(result: Identification, covered: Coverage, output: Path, report: Path | None) -> str:
    from dehyst.daemon.verdict import verdict

    fit, unit, v = result.model.fit, result.model.displacement_unit, result.model.validity
    drive = result.model.drive_unit
    n = result.model.hysteresis.n
    lines = [
        f"{output}: {result.shape.name}, {n} operator{'s' if n > 1 else ''}",
        f"fit {fit.rms:.4g} {unit} rms, held out {fit.holdout_rms:.4g}, noise {fit.noise_rms:.4g}",
        verdict(result),
        f"valid from {v.drive_min:.4g} to {v.drive_max:.4g} {drive}"
        + (f", up to {v.rate_max:.4g} {drive}/s" if v.rate_max else ""),
    ]
    lines += [f"note: {note}" for note in result.notes]
    lines += [f"missing: {text}" for text in _missing(result, covered)]
    if report:
        lines.append(f"report: {report}")
    return "\n".join(lines)
