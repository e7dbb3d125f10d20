"""Print every table of the diagnosis' proof and draw its pictures into out/proof.

    python tests/benchmarks/proof.py [--cases 2000-2119] [--own 5000-5039] [--jobs 2] [--quick]

Own stages (foreign hysteresis, foreign equations, seeds never used for tuning), textbook forms
for the coverage of intervals, the loop closed, the real recordings when $DEHYST_DATA (or
../shared) has them. Cases take some seconds each; finished ones are kept, so it can be stopped.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # run as a script: the benchmarks import each other by package

from tests.benchmarks import bench_diagnosis, bench_loop_closed  # noqa: E402
from tests.benchmarks.proof_pictures import draw  # noqa: E402
from tests.benchmarks.proof_tables import tables  # noqa: E402

REPORT, OWN = "2000-2119", "5000-5039"
QUICK_REPORT, QUICK_OWN = "2000-2019", "5000-5007"


def real_recordings(folder: Path) -> str:
    """What the tool says of every real recording, or why there is nothing to say."""
    from dehyst.daemon.recordings import read_recording
    from dehyst.models.diagnosis import diagnose
    from dehyst.models.errors import DehystError

    paths = sorted((folder / "recordings").glob("*.csv"))
    if not paths:
        return f"Real recordings: none in {folder / 'recordings'} (set DEHYST_DATA)"
    lines = ["Real recordings (held-out error by blocks, before and after)"]
    for path in paths:
        try:
            one = read_recording(path, need_displacement=True)
            start = time.perf_counter()
            d = diagnose([one])
        except DehystError as error:
            lines.append(f"  {path.stem:16s} {error}")
            continue
        said = ", ".join(f"{f.name} ({100 * f.share:.0f} %)" for f in d.findings) or "-"
        before, after = d.rms.get("heldout_base"), d.rms.get("heldout_augmented")
        lines.append(
            f"  {path.stem:16s} {d.verdict:9s} {said:46s} {_number(before)} -> {_number(after)} "
            f"{d.unit}, noise {d.noise:.3g}, {time.perf_counter() - start:.0f} s"
        )
    return "\n".join(lines)


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, int | float) else "-"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--cases", default=REPORT, help=f"report seeds, default {REPORT}")
    parser.add_argument("--own", default=OWN, help=f"textbook seeds, default {OWN}")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="28 cases only")
    parser.add_argument("--results", type=Path, default=bench_diagnosis.default_folder())
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "proof")
    args = parser.parse_args()
    seeds = bench_diagnosis.parse_seeds(QUICK_REPORT if args.quick else args.cases)
    seeds += bench_diagnosis.parse_seeds(QUICK_OWN if args.quick else args.own)
    rows = bench_diagnosis.collect(seeds, args.jobs, args.results)
    report = tables(rows)
    print(report, flush=True)
    closed, floor = bench_loop_closed.collect()
    loop = bench_loop_closed.table(closed, floor)
    print("\n" + loop, flush=True)
    data = Path(os.environ.get("DEHYST_DATA") or ROOT.parent / "shared")
    real = real_recordings(data)
    print("\n" + real, flush=True)
    pictures = draw(rows, closed, floor, args.output)
    (args.output / "proof.txt").write_text(f"{report}\n\n{loop}\n\n{real}\n")
    (args.output / "rows.json").write_text(json.dumps({"cases": rows, "loop": closed}, indent=1))
    print("\n" + "\n".join(str(p) for p in pictures))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
