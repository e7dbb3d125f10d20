"""Judge the diagnosis on the proof's own stages, and print the tables and the bars.

    python -m tests.benchmarks.models.proof                         all cases, a new seed
    python -m tests.benchmarks.models.proof --families past shape --count 20 --seed 7
    python -m tests.benchmarks.models.proof --seed 7 --keep out/proof/7.jsonl    continues there
    python -m tests.benchmarks.models.proof --seed 7 --case past-3  its picture and its words

Every case follows from the seed and its own name. With --keep, each case is a line (truth, answer,
score, seconds) of that file, and cases that the same version of the code has stored there are not
run again. The exit status is 1 if a bar is missed. A run of the whole proof also reports the tool's
findings on the real recordings.
"""

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does

import numpy as np
from tests.benchmarks.models.proof.families import COUNTS, cases, parse
from tests.benchmarks.models.proof.real import real_recordings
from tests.benchmarks.models.proof.run import one_line, run_and_keep, run_case
from tests.benchmarks.models.proof.tables import bars_of, tables

ROOT = Path(__file__).resolve().parents[4]
Row = dict[str, Any]


def version() -> str:
    """Return the version of all code behind a row: the models, the judge and the plants."""
    digest = hashlib.sha256()
    for room in ("models", "tests/benchmarks/models/proof", "tests/rigs"):
        for path in sorted((ROOT / room).rglob("*.py")):
            digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def kept(path: Path | None, seed: int, code: str) -> dict[str, Row]:
    """Return finished cases of a file that this version of the code made, by name. Raises
    SystemExit if they are of another seed."""
    rows: dict[str, Row] = {}
    if path is None or not path.exists():
        return rows
    for line in path.read_text().splitlines():
        row = json.loads(line)
        if row["seed"] != seed:
            raise SystemExit(f"{path}: holds cases of seed {row['seed']}, not {seed}")
        if "failed" not in row and row["code"] == code:
            rows[row["case"]] = row
    return rows


def collect(seed: int, names: list[str], checks: int, jobs: int) -> Iterator[Row]:
    """Yield rows as they are completed."""
    if jobs == 1:
        for name in names:
            yield run_case(seed, name, checks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        for done in as_completed([pool.submit(run_case, seed, n, checks) for n in names]):
            yield done.result()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, help="of all cases; default: a new one")
    parser.add_argument("--count", type=int, help="how many cases; default: the whole proof")
    parser.add_argument("--families", nargs="+", choices=list(COUNTS), help="only these")
    parser.add_argument("--case", help="one case, with its picture: past-3")
    parser.add_argument("--limits", type=int, default=1, help="exclusion limits checked a case")
    parser.add_argument("--keep", type=Path, help="one line a case; goes on where it stopped")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "proof")
    args = parser.parse_args()
    os.nice(5)
    seed = args.seed if args.seed is not None else int(np.random.SeedSequence().entropy) % 10**8
    if args.case:
        return show(seed, args.case, args.limits, args.output)
    families = args.families or list(COUNTS)
    count = args.count or sum(COUNTS[f] for f in families)
    names = cases(count, families)
    code = version()
    rows = kept(args.keep, seed, code)
    todo = [name for name in names if name not in rows]
    print(f"seed {seed}, {len(names)} cases, {len(names) - len(todo)} of them kept", flush=True)
    if args.keep:
        args.keep.parent.mkdir(parents=True, exist_ok=True)
    for number, row in enumerate(collect(seed, todo, args.limits, args.jobs), 1):
        rows[row["case"]] = row
        if args.keep:
            with args.keep.open("a") as file:
                file.write(json.dumps(row | {"code": code}) + "\n")
        print(f"{number}/{len(todo)}  {one_line(row)}", file=sys.stderr, flush=True)
    done = [rows[name] for name in names]
    print(tables(done))
    if not args.families and not args.count:
        print("\n" + real_recordings(Path(os.environ.get("DEHYST_DATA") or ROOT.parent / "shared")))
    bars = bars_of(done)
    print(f"\nseed {seed}: {bars.table().splitlines()[-1]}")
    return bars.code


def show(seed: int, name: str, checks: int, folder: Path) -> int:
    """Show one case: its texts and its picture."""
    from tests.benchmarks.models.proof.pictures import draw
    from tests.benchmarks.models.proof.tables import wrong

    try:
        parse(name)
    except ValueError as error:
        raise SystemExit(str(error)) from None
    row, case, diagnosis = run_and_keep(seed, name, checks)
    print(one_line(row))
    if "failed" in row:
        print(row["failed"])
        return 1
    for h in row["truth"]["hidden"]:
        print(f"  hidden: {json.dumps(h)}")
    for e in row["answer"]["effects"]:
        print(f"  named: {e['name']} on the {e['acts_on']}, share {e['share']}: {e['says']}")
    print(f"  data: {row['answer']['data']['says'] or 'nothing to say'}")
    for one in row["answer"]["would_have_seen"]:
        print(f"  limit: {json.dumps(one)}")
    print(f"  next: {row['answer']['next_experiment']}")
    found = wrong(row)
    print("\n".join(f"  WRONG: {text}" for text in found) or "  nothing wrong")
    if case is not None:
        path = folder / f"{seed}-{name}.png"
        draw(case, diagnosis, path)
        print(path)
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
