"""Print every table of the diagnosis' proof and draw its pictures into out/proof.

    python tests/benchmarks/models/proof.py [--cases 2000-2099] [--clean 2100-2199] [--own
    5000-5023] [--jobs 2] [--quick]

Own stages (foreign hysteresis, foreign equations, seeds never used for tuning; of the second
range only the clean ones), textbook forms for the coverage of intervals, the loop closed, the
real recordings when $DEHYST_DATA (or ../shared) has them. Whatever is finished is kept under
out/proof/kept by version of the models: a run that was stopped goes on where it stopped, and
tables of what is there are printed and written on the way.
"""

import argparse
import json
import os
import random
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as the command line does
ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))  # run as a script: the benchmarks import each other by package

from tests.benchmarks.daemon import loop_closed as bench_loop_closed  # noqa: E402
from tests.benchmarks.models import diagnosis as bench_diagnosis  # noqa: E402
from tests.benchmarks.models.proof_pictures import draw  # noqa: E402
from tests.benchmarks.models.proof_tables import judge, tables  # noqa: E402
from tests.rigs.plants.stages import plan  # noqa: E402

REPORT, CLEAN, OWN = "2000-2099", "2100-2199", "5000-5023"
QUICK_REPORT, QUICK_CLEAN, QUICK_OWN = "2000-2019", "2100-2119", "5000-5007"
Rows = list[dict[str, Any]]


def kept(path: Path, make: Callable[[], Any]) -> Any:
    """What a file holds, else what `make` gives, kept there."""
    if path.exists():
        return json.loads(path.read_text())
    value = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))
    return value


def one_real(path: Path) -> str:
    """What the tool says of one real recording, as a line of the table."""
    from dehyst.daemon.files.recordings import read_recording
    from dehyst.models.diagnosis import diagnose
    from dehyst.models.errors import DehystError

    try:
        one = read_recording(path, need_displacement=True)
        start = time.perf_counter()
        d = diagnose([one])
    except DehystError as error:
        return f"  {path.stem:16s} {error}"
    said = ", ".join(f"{f.name} ({100 * f.share:.0f} %)" for f in d.findings) or "-"
    before, after = d.rms.get("heldout_model"), d.rms.get("heldout_augmented")
    return (
        f"  {path.stem:16s} {d.verdict:9s} {said:46s} {_number(before)} -> {_number(after)} "
        f"{d.unit}, noise {d.noise:.3g}, {time.perf_counter() - start:.0f} s"
    )


def real_recordings(folder: Path, keep: Path) -> str:
    """What the tool says of every real recording, or why there is nothing to say."""
    paths = sorted((folder / "recordings").glob("*.csv"))
    if not paths:
        return f"Real recordings: none in {folder / 'recordings'} (set DEHYST_DATA)"
    lines = ["Real recordings (held-out error by blocks, before and after)"]
    lines += [kept(keep / f"real-{p.stem}.json", partial(one_real, p)) for p in paths]
    return "\n".join(lines)


def loop_closed(keep: Path, jobs: int) -> tuple[Rows, float]:
    """Rows of the closed loop, and the error of the undisturbed stage [nm]."""
    rows = []
    with ProcessPoolExecutor(jobs) as pool:
        paths = {
            t.name: keep / f"loop-{t.name.replace(' ', '-')}.json" for t in bench_loop_closed.TRIALS
        }
        trials = [t for t in bench_loop_closed.TRIALS if not paths[t.name].exists()]
        running = {t.name: pool.submit(bench_loop_closed.one, t) for t in trials}
        for name, path in paths.items():
            try:
                rows.append(kept(path, lambda name=name: running[name].result()))
            except Exception as error:  # the other tables are wanted all the same
                print(f"the loop closed, {name}: {error!r}", flush=True)
    return rows, kept(keep / "loop-floor.json", bench_loop_closed.perfect)


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, int | float) else "-"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--cases", default=REPORT, help=f"report seeds, default {REPORT}")
    parser.add_argument("--clean", default=CLEAN, help=f"clean ones of these, default {CLEAN}")
    parser.add_argument("--own", default=OWN, help=f"textbook seeds, default {OWN}")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="34 cases only")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "proof")
    args = parser.parse_args()
    ranges = (args.cases, args.clean, args.own)
    if args.quick:
        ranges = (QUICK_REPORT, QUICK_CLEAN, QUICK_OWN)
    cases, clean, own = (bench_diagnosis.parse_seeds(r) for r in ranges)
    seeds = cases + [s for s in clean if plan(s)[0] == "clean"] + own
    random.Random(0).shuffle(seeds)  # so that tables on the way show something of everything
    keep = args.output / "kept"
    args.output.mkdir(parents=True, exist_ok=True)

    def tell(rows: Rows) -> None:
        report = tables(rows)
        (args.output / "proof.txt").write_text(report + "\n")
        print(f"\n--- {len(rows)} of {len(seeds)} cases\n{report}", flush=True)

    rows = bench_diagnosis.collect(seeds, args.jobs, keep, partial=tell)
    report = tables(rows)
    print("\n" + report, flush=True)
    keep /= bench_diagnosis.models_digest()
    closed, floor = loop_closed(keep, args.jobs)
    loop = bench_loop_closed.table(closed, floor)
    print("\n" + loop, flush=True)
    data = Path(os.environ.get("DEHYST_DATA") or ROOT.parent / "shared")
    real = real_recordings(data, keep)
    print("\n" + real, flush=True)
    pictures = draw(rows, closed, floor, args.output)
    (args.output / "proof.txt").write_text(f"{report}\n\n{loop}\n\n{real}\n")
    (args.output / "rows.json").write_text(json.dumps({"cases": rows, "loop": closed}, indent=1))
    print("\n" + "\n".join(str(p) for p in pictures))
    bars = judge(rows)
    bars.rows += bench_loop_closed.judge(closed, floor).rows
    return bars.end()


if __name__ == "__main__":
    raise SystemExit(main())
