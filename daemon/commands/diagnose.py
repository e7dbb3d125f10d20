"""say what physics a model leaves out of a recording, and model it"""

import argparse
import json
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from dehyst import __version__
from dehyst.daemon.files.models import load_model, save_model, write_text
from dehyst.daemon.files.outputs import check_outputs
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.report.units import pick_unit
from dehyst.models.diagnosis import Diagnosis, diagnose
from dehyst.models.errors import BadInput
from dehyst.models.model import Model, Provenance
from dehyst.models.recording import Recording

THREADS = 2  # candidates tried at once: each needs a design of all samples


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst diagnose`."""
    parser.description = (
        "Locate what the model in use leaves unexplained, name the physics, model it, and show the "
        "fit improve. The model in use is that of --model, or the plain one identified from these "
        "recordings. Give all recordings of one stage together: several "
        "waveforms, holds, and a rest tell more than one. Writes diagnosis.json, model.toml (the "
        "augmented model) and report.html into DIR. Exit status 1: something was left out."
    )
    parser.epilog = (
        "examples: dehyst diagnose sweep.csv holds.csv -o findings\n"
        "          dehyst diagnose run.csv --model stage.toml -o findings --json"
    )
    parser.add_argument("recordings", nargs="+", type=Path, metavar="REC")
    parser.add_argument(
        "--model", metavar="MODEL.toml", help="the model in use (default: identified here)"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    parser.add_argument("--json", action="store_true", help="diagnosis.json on stdout")


def run(args: argparse.Namespace) -> int:
    """Diagnose and write the three files; 1 when something was left out."""
    results = [args.output / name for name in ("diagnosis.json", "model.toml", "report.html")]
    check_outputs(results, [*args.recordings, args.model], force=False)
    recordings = _read(args.recordings)
    model = load_model(args.model) if args.model else None
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{args.output}: cannot be made: {error.strerror or error}") from None
    console = Console(stderr=True)
    with _progress(console) as say, ThreadPoolExecutor(THREADS) as threads:
        diagnosis = diagnose(recordings, model, say, threads.map)
    said = json.dumps(diagnosis.to_dict(), indent=2, allow_nan=False)
    _write(args.output / "diagnosis.json", said + "\n")
    save_model(with_provenance(diagnosis.model, recordings), args.output / "model.toml")
    from dehyst.daemon.report.diagnosis import report_diagnosis  # matplotlib takes its time

    _write(args.output / "report.html", report_diagnosis(diagnosis, [r.name for r in recordings]))
    print(said if args.json else summary(diagnosis, args.output))
    return 1 if diagnosis.found_something else 0


def with_provenance(model: Model, recordings: list[Recording]) -> Model:
    """The model with the recordings it was fitted to."""
    return replace(
        model,
        provenance=Provenance(
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            version=__version__,
            source="dehyst diagnose",
            recordings=tuple((r.name, r.sha256) for r in recordings),
        ),
    )


def summary(diagnosis: Diagnosis, folder: Path) -> str:
    """What a person reads on the terminal: the data first, then the verdict with one pair of
    figures, what was found, and what to do next."""
    before, after = diagnosis.before_after
    k, unit = pick_unit(diagnosis.unit, max(before, diagnosis.noise))
    lines = [f"data: {said}" for said in diagnosis.data.says]
    lines.append(
        f"{diagnosis.verdict}: the model in use leaves {k * before:.3g} {unit} rms, the augmented "
        f"model {k * after:.3g} (noise {k * diagnosis.noise:.3g})"
    )
    for f in diagnosis.findings:
        ties = f" (or {', '.join(f.ambiguous_with)})" if f.ambiguous_with else ""
        lines.append(f"  {f.name}{ties}, {100 * f.share:.0f} % of the explainable misfit: {f.says}")
    if diagnosis.next_experiment:
        lines.append(f"  next: {diagnosis.next_experiment}")
    lines.append(f"  {folder / 'report.html'}")
    return "\n".join(lines)


def _read(paths: list[Path]) -> list[Recording]:
    """Recordings with names of their own, also when two folders hold the same file name."""
    out: list[Recording] = []
    for i, path in enumerate(paths):
        if any(path.resolve() == other.resolve() for other in paths[:i]):
            raise BadInput(f"{path}: given twice")
        one = read_recording(path, need_displacement=True)
        if any(one.name == other.name for other in out):
            one = replace(one, name=str(path))
        out.append(one)
    return out


def _write(path: Path, text: str) -> None:
    try:
        write_text(path, text)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from None


class _Bar:
    """Progress on a terminal: diagnose() reports a text and a share."""

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
