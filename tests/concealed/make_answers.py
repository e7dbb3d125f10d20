"""Answers for a round of sealed cases: what each stage hides, and its held-out waveform predicted.

    python tests/concealed/make_answers.py ROUND_FOLDER [--all-rows] [--jobs 2] [--models DIR]

Every folder case-NN is diagnosed from its own recordings alone, all its files but the held-out
one. Writes answers.json and predictions/case-NN.csv.gz (t_s, y_base and y_model in the recordings'
unit, five significant digits; every tenth row, or all) into the folder of the round's name beside
this file.
"""

import argparse
import gzip
import io
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does

from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import read_recording
from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis, diagnose
from dehyst.models.recording import Recording

GIVEN = ("identify", "check", "hold", "recording-*")  # .csv or .csv.gz
HELD_OUT = "holdout"
EVERY = 10


def files(folder: Path, pattern: str) -> list[Path]:
    """The case's files of this name, packed or not."""
    return sorted({*folder.glob(f"{pattern}.csv"), *folder.glob(f"{pattern}.csv.gz")})


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """The case's entry in answers.json, strongest effect first."""
    said = diagnosis.to_dict()
    effects = [{k: e[k] for k in ("name", "acts_on", "ambiguous_with")} for e in said["effects"]]
    limits = said["would_have_seen"]
    return {"verdict": said["verdict"], "effects": effects, "would_have_seen": limits}


def predictions(diagnosis: Diagnosis, held: Recording, every: int) -> bytes:
    """The held-out displacement by the base and by the augmented model, as gzipped CSV."""
    base, full = (
        simulate(model, held.t_s, held.drive, held.channels)
        for model in (diagnosis.base_model, diagnosis.model)
    )
    text = io.StringIO()
    unit = diagnosis.unit
    text.write(f"t_s,y_base_{unit},y_model_{unit}\n")
    for t, b, m in zip(held.t_s[::every], base[::every], full[::every], strict=True):
        text.write(f"{t:.9g},{b:.5g},{m:.5g}\n")
    return gzip.compress(text.getvalue().encode(), mtime=0)


def one_case(
    folder: Path, every: int, models: Path | None
) -> tuple[str, dict[str, Any], bytes, float]:
    """Name, answer, predictions and seconds of one folder; the model into `models`."""
    start = time.perf_counter()
    given = [path for pattern in GIVEN for path in files(folder, pattern)]
    diagnosis = diagnose([read_recording(path, need_displacement=True) for path in given])
    table = predictions(diagnosis, read_recording(files(folder, HELD_OUT)[0]), every)
    if models is not None:
        save_model(diagnosis.model, models / f"{folder.name}.toml")
    return folder.name, answer(diagnosis), table, time.perf_counter() - start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("round", type=Path, help="folder that holds case-00, case-01, ...")
    parser.add_argument("--all-rows", action="store_true", help="predict every row")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, help="default: beside this file")
    parser.add_argument("--models", type=Path, help="keep the written models in this folder")
    args = parser.parse_args()
    cases = sorted(p for p in args.round.glob("case-*") if p.is_dir())
    if not cases:
        print(f"{args.round}: no folders case-NN in it", file=sys.stderr)
        return 2
    out = args.output or Path(__file__).resolve().parent / args.round.resolve().name
    (out / "predictions").mkdir(parents=True, exist_ok=True)
    if args.models is not None:
        args.models.mkdir(parents=True, exist_ok=True)
    every = 1 if args.all_rows else EVERY
    answers: dict[str, Any] = {}
    with ProcessPoolExecutor(args.jobs) as pool:
        for done in as_completed(
            [pool.submit(one_case, case, every, args.models) for case in cases]
        ):
            name, said, table, seconds = done.result()
            answers[name] = said
            (out / "predictions" / f"{name}.csv.gz").write_bytes(table)
            names = ", ".join(
                e["name"] + "".join(f" or {o}" for o in e["ambiguous_with"])
                for e in said["effects"]
            )
            print(f"{name}  {said['verdict']:9s}  {names or '-':40s}  {seconds:5.1f} s", flush=True)
    ordered = {name: answers[name] for name in sorted(answers)}
    (out / "answers.json").write_text(json.dumps(ordered, indent=1) + "\n")
    print(f"{out / 'answers.json'}: {len(ordered)} cases")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
