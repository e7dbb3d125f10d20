"""Score the diagnosis on the proof's stages.

    python -m tests.benchmarks.models.diagnosis --seeds 1000-1059        tuning set
    python -m tests.benchmarks.models.diagnosis --seeds 2000-2119 --jobs 2   report only
    python -m tests.benchmarks.models.diagnosis --seeds 5000-5039        coverage of intervals

Rows already made by the same version of the models are taken from the results folder, so an
interrupted run goes on where it stopped. Made cases are kept there too.
"""

import argparse
import hashlib
import json
import os
import pickle
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does

from tests.benchmarks.models.proof_tables import judge, tables
from tests.rigs.plants import stages as proof_stages

ROOT = Path(__file__).resolve().parents[3]
PARTIAL = 20  # rows after which tables of what is there are printed


def _digest(files: list[Path]) -> str:
    h = hashlib.sha256()
    for path in sorted(files):
        h.update(path.name.encode() + path.read_bytes())
    return h.hexdigest()[:12]


def models_digest() -> str:
    """Version of the code under test: the diagnosis and what runs its models."""
    models = ROOT / "models"
    rooms = ("diagnosis", "physics", "signals", "cascade", "hysteresis")
    return _digest([path for room in rooms for path in (models / room).rglob("*.py")])


def load_case(seed: int, folder: Path) -> proof_stages.Case:
    """The case of a seed, made once and kept."""
    version = _digest(list(Path(proof_stages.__file__).parent.glob("*.py")))
    path = folder / f"cases-{version}" / f"{seed}.pickle"
    if path.exists():
        case: proof_stages.Case = pickle.loads(path.read_bytes())
        return case
    case = proof_stages.make_case(seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}")
    part.write_bytes(pickle.dumps(case))
    part.replace(path)
    return case


def run_one(seed: int, folder: str) -> dict[str, Any]:
    """Make, diagnose and judge one case; a failure is a row too."""
    from tests.benchmarks.models.proof_score import given, judge

    from dehyst.models.diagnosis import diagnose

    case = load_case(seed, Path(folder))
    start, busy = time.perf_counter(), time.process_time()
    try:
        diagnosis = diagnose(given(case))
        seconds, busy = time.perf_counter() - start, time.process_time() - busy
        return {**judge(case, diagnosis, seconds), "cpu_s": busy}
    except Exception:  # a crash must show in the table, not end the run
        return {
            "seed": seed, "kind": case.kind, "names": list(case.names),
            "failed": traceback.format_exc(), "seconds": time.perf_counter() - start,
        }  # fmt: skip


def parse_seeds(text: str) -> list[int]:
    """ "1000-1019,1040" to a list."""
    out: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        out += range(int(first), int(last or first) + 1)
    return out


def _rows(seeds: list[int], jobs: int, folder: Path) -> Iterator[dict[str, Any]]:
    if jobs == 1:
        for seed in seeds:
            yield run_one(seed, str(folder))
        return
    with ProcessPoolExecutor(jobs) as pool:
        for done in as_completed([pool.submit(run_one, s, str(folder)) for s in seeds]):
            yield done.result()


def collect(
    seeds: list[int],
    jobs: int,
    folder: Path,
    fresh: bool = False,
    partial: Callable[[list[dict[str, Any]]], None] | None = None,
) -> list[dict[str, Any]]:
    """Rows of these seeds by this version of the models, from the results file where present.

    partial(rows so far) is called now and then, so that an interrupted run is not lost.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"rows-{models_digest()}.jsonl"
    rows = {}
    if path.exists() and not fresh:
        for line in path.read_text().splitlines():
            row = json.loads(line)
            if "failed" not in row:
                rows[row["seed"]] = row
    todo = [s for s in seeds if s not in rows]
    with path.open("a") as file:
        for number, row in enumerate(_rows(todo, jobs, folder), 1):
            rows[row["seed"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(f"{number}/{len(todo)}  {one_line(row)}", file=sys.stderr, flush=True)
            if partial and number % PARTIAL == 0:
                partial([rows[s] for s in seeds if s in rows])
    return [rows[s] for s in seeds if s in rows]


def one_line(row: dict[str, Any]) -> str:
    """A row for the eye."""
    if "failed" in row:
        return f"{row['seed']} {row['kind']} FAILED: {row['failed'].splitlines()[-1]}"
    hidden = ", ".join(f"{h['name']} {h['ratio']:.2f}" for h in row["hidden"]) or "nothing"
    said = ", ".join(
        e["name"] + (f" (or {'/'.join(e['ambiguous_with'])})" if e["ambiguous_with"] else "")
        for e in row["effects"]
    )
    return (
        f"{row['seed']} {row['kind']:7s} {row['hysteresis']:12s} hidden: {hidden} | "
        f"{row['verdict']}: {said or '-'} | removed {100 * row['removed']:.0f} % "
        f"({1e3 * row['base_um']:.0f} -> {1e3 * row['model_um']:.0f} nm, noise "
        f"{1e3 * row['noise_um']:.0f}) | {row['seconds']:.1f} s"
    )


def default_folder() -> Path:
    return Path(tempfile.gettempdir()) / "dehyst-bench"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", default="1000-1059", help="1000-1059,1070")
    parser.add_argument("--cases", type=int, help="only the first N of the seeds")
    parser.add_argument("--kinds", help="clean,single,pair,outside,own")
    parser.add_argument("--effects", help="only cases that hide one of these, by name")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, default=default_folder())
    parser.add_argument("--fresh", action="store_true", help="do not take rows from the results")
    args = parser.parse_args()
    os.nice(5)
    seeds = parse_seeds(args.seeds)
    if args.kinds:
        seeds = [s for s in seeds if proof_stages.plan(s)[0] in args.kinds.split(",")]
    if args.effects:
        wanted = set(args.effects.split(","))
        seeds = [s for s in seeds if wanted & set(proof_stages.plan(s)[1])]
    rows = collect(seeds[: args.cases], min(args.jobs, 2), args.results, args.fresh)
    print(tables(rows))
    return judge(rows).code  # the table's last lines say it in words


if __name__ == "__main__":
    sys.exit(main())
