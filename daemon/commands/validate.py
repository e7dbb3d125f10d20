"""Report how well a model predicts recordings that it has not seen."""

import argparse
from pathlib import Path
from typing import Any

from dehyst.daemon.api.functions import validate
from dehyst.daemon.files.foreign.reading import add_reading
from dehyst.daemon.files.given_recordings import read_given
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.json_text import print_json
from dehyst.models.errors import BadInput
from dehyst.models.identify.validation import CLAIM, Validation


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst validate`."""
    parser.description = (
        "Run models on the drives of recordings and report the error, its share of the span, "
        "whether the residual is white and whether it follows the drive. A recording may begin "
        "anywhere in the stage's history; a new zero of the sensor is reported as an offset. Exit "
        "status 1: a model is worse than it claims (its error is more than "
        f"{CLAIM:g} times its held-out error). Where this gauge is noisier than that of the "
        "model's own recordings, the power of the additional noise is first subtracted from that "
        "of the error."
    )
    parser.epilog = (
        "examples: dehyst validate stage.toml another-run.csv\n"
        "          dehyst validate old.toml new.toml run-*.csv --report findings"
    )
    parser.add_argument(
        "inputs", nargs="+", metavar="MODEL.toml... REC...", help="models first, then recordings"
    )
    parser.add_argument("--report", type=Path, metavar="DIR", help="write DIR/validation.html")
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="the result as JSON on stdout")


def run(args: argparse.Namespace) -> int:
    """Validate; return 0, or 1 if a model is worse than it claims."""
    models = [name for name in args.inputs if _is_model(name)]
    paths = [Path(name) for name in args.inputs if not _is_model(name)]
    if not models or not paths:
        raise BadInput("at least one model (.toml, or a shipped one) and one recording are needed")
    page = args.report / "validation.html" if args.report else None
    check_outputs([page], [*map(Path, models), *paths], args.force)
    recordings = read_given(paths, args, defects=True)
    found = validate(models, recordings)
    if page is not None:
        found.report(page, force=args.force)
    if args.json:
        print_json([_summary(name, v) for name, _, v in found.rows])
    else:
        print(found)
        if page is not None:
            print(f"report: {page}")
    return 1 if found.worse else 0


def _is_model(name: str) -> bool:
    from dehyst.models.modelfile import SHIPPED

    return name.endswith(".toml") or name in SHIPPED


def _summary(model: str, v: Validation) -> dict[str, Any]:
    return {
        "model": model,
        "recording": v.name,
        "unit": v.unit,
        "rms": v.rms,
        "share_of_span": v.share,
        "offset": v.offset,
        "noise_rms": v.noise,
        "claim_rms": v.claim,
        "gauge_noise_not_counted_rms": v.noisier,
        "worse_than_claimed": v.worse,
        "white": v.white,
        "correlation_with_drive": v.tied_to_drive,
        "by_chance": v.chance,
        "start": v.start,
        "late_rows": v.late,
        "repeated_rows": v.repeats,
        "stuck_rows": v.stuck,
        "outside_validity": v.outside,
        "within_band": v.within,
        "band_unstated": v.unstated,
        "band_is": v.interval_is,
    }
