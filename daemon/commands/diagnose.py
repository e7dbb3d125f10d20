"""Say what physics a model leaves out of a recording, and model it."""

import argparse
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from dehyst.daemon.files.foreign.reading import add_reading
from dehyst.daemon.files.given_recordings import read_given, say_converted
from dehyst.daemon.files.outputs import add_force, check_outputs
from dehyst.daemon.json_text import print_json
from dehyst.models.errors import BadInput
from dehyst.models.recording import Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst diagnose`."""
    parser.description = (
        "Find the physics that the model in use lacks, model it, and show by how much the error "
        "falls. The model in use is that of --model, or a plain model identified from these "
        "recordings. Give all recordings of one stage together: several "
        "waveforms, with holds and rests, reveal more than a single one. Writes diagnosis.json, "
        "model.toml (the augmented model) and report.html to DIR. Exit status 1: the "
        "model in use lacks something."
    )
    parser.epilog = (
        "examples: dehyst diagnose sweep.csv holds.csv -o findings\n"
        "          dehyst diagnose run.csv --model stage.toml -o findings --json"
    )
    parser.add_argument(
        "recordings", nargs="+", type=Path, metavar="REC", help="recordings of one stage"
    )
    parser.add_argument(
        "--model", metavar="MODEL.toml", help="the model in use (default: identified here)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="where the results go"
    )
    add_reading(parser)
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="diagnosis.json on stdout")


def run(args: argparse.Namespace) -> int:
    """Diagnose and write the three files; return 1 if the model lacks something."""
    # slow imports, which help does not need
    from dehyst.daemon.api.functions import diagnose, load_model
    from dehyst.daemon.api.results import DIAGNOSIS_FILES

    results = [args.output / name for name in DIAGNOSIS_FILES]
    check_outputs(results, [*args.recordings, args.model], args.force)
    recordings = _read(args)
    model = load_model(args.model) if args.model else None
    if model is not None:
        say_converted(recordings, model.displacement_unit)
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{args.output}: cannot be made: {error.strerror or error}") from None
    with _progress(Console(stderr=True)) as say:
        found = diagnose(recordings, model=model, progress=say)
    report = found.save(args.output, force=args.force)
    if args.json:
        print_json(found.to_dict())
    else:
        print(f"{found}\n  {report}")
    return 1 if found.details.found_something else 0


def _read(args: argparse.Namespace) -> list[Recording]:
    for i, path in enumerate(args.recordings):
        if any(path.resolve() == other.resolve() for other in args.recordings[:i]):
            raise BadInput(f"{path}: given twice")
    return read_given(args.recordings, args)


class _Bar:
    """Progress bar on a terminal; diagnose() reports a text and the share done."""

    def __init__(self, console: Console) -> None:
        columns = (TextColumn("{task.description:28s}"), BarColumn(), TimeElapsedColumn())
        self._bar = Progress(*columns, console=console, transient=True)

    def __enter__(self) -> Callable[[str, float], None]:
        self._bar.start()
        task = self._bar.add_task("reading", total=1.0)
        return lambda text, share: self._bar.update(task, description=text, completed=share)

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


def _progress(console: Console) -> "_Bar | nullcontext[None]":
    return _Bar(console) if sys.stderr.isatty() else nullcontext(None)
