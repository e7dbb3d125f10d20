"""Check `dehyst record` at 10 kHz: every sample is in the file, and all kinds of file agree.

    python -m tests.benchmarks.daemon.record_rate [--rate 10000] [--seconds 20]

The real loop on the simulated stage, the real gateway, and one recorder for each kind of file run
at the same time, each in its own process. The .mcap is read back by the reader of that format.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from datetime import datetime
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from tests.benchmarks.bars import Bars
from tests.rigs.gateway_bench import Bench, environment

from dehyst.daemon.files.recordings import read_columns

KINDS = ("csv", "mcap")


def main() -> int:
    """Record, compare, and print one row per kind of file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=10_000.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        return run(Path(name), args.rate, args.seconds)


def run(folder: Path, rate_hz: float, seconds: float) -> int:
    """Run in a separate folder; return 1 if a sample is missing."""
    bench = Bench(folder, **{"rate_hz = 200.0": f"rate_hz = {rate_hz}"})
    try:
        bench.start_gateway()
        bench.client()
        recorders = {kind: start(bench, folder / f"run.{kind}", seconds) for kind in KINDS}
        results = {kind: finish(recorder) for kind, recorder in recorders.items()}
    finally:
        bench.close()
    paths = [folder / f"run.{kind}" for kind in KINDS]
    bars, tables = Bars(), {kind: by_reader(path) for kind, path in zip(KINDS, paths, strict=True)}
    print("| file | samples | periods | lost | fetched | CPU s | B a sample |")
    print("|---|---|---|---|---|---|---|")
    for kind, (result, cpu_s) in results.items():
        size = (folder / f"run.{kind}").stat().st_size
        print(
            f"| .{kind} | {result['samples']} | {seconds * rate_hz:.0f} | {result['lost_samples']} "
            f"| {result['fetched_from_history']} | {cpu_s:.1f} | {size / result['samples']:.0f} |"
        )
        bars.none(f".{kind}: samples lost, gaps", result["lost_samples"] + result["gaps"])
    begun_s = [datetime.fromisoformat(read_columns(p)[1]["started"]).timestamp() for p in paths]
    shift = round((begun_s[1] - begun_s[0]) * rate_hz)
    compared, wrong = differing(tables["csv"], tables["mcap"], shift, rate_hz)
    bars.least("samples compared", compared, 0.8 * seconds * rate_hz)
    bars.none("samples that differ between .csv and .mcap", wrong)
    return bars.end()


def start(bench: Bench, path: Path, seconds: float) -> "subprocess.Popen[str]":
    """Start `dehyst record` into a file, at the lowest priority."""
    command = [sys.executable, "-m", "dehyst.daemon.main", "record", "-o", str(path), "--json"]
    command += ["--for", str(seconds), "--connect", bench.address]
    return subprocess.Popen(
        ["nice", "-n", "19", *command], env=environment(), stdout=subprocess.PIPE, text=True
    )


def finish(recorder: "subprocess.Popen[str]") -> tuple[dict[str, object], float]:
    """Return (its result, its CPU time)."""
    assert recorder.stdout is not None
    said = recorder.stdout.read()
    _, _, used = os.wait4(recorder.pid, 0)
    return json.loads(said), used.ru_utime + used.ru_stime


def by_reader(path: Path) -> dict[str, np.ndarray]:
    """Return the columns; for an .mcap read by its format's own reader."""
    if path.suffix == ".csv":
        return read_columns(path)[0]
    rows = []
    with path.open("rb") as file:
        for schema, _, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            rows.append(json.loads(message.data))
    names = list(json.loads(schema.data)["properties"])
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}


def differing(
    one: dict[str, np.ndarray], other: dict[str, np.ndarray], shift: int, rate_hz: float
) -> tuple[int, int]:
    """Return (number of rows that both have, number of those that differ); the other began `shift`
    periods later. The drive before a first row is unknown, so the first rows are skipped."""
    places = [np.rint(table["t_s"] * rate_hz).astype(int)[1:] for table in (one, other)]
    _, first, second = np.intersect1d(places[0], places[1] + shift, return_indices=True)
    wrong = np.zeros(first.size, bool)
    for name in set(one) - {"t_s"}:
        a, b = one[name][1:][first], other[name][1:][second]
        wrong |= ~((a == b) | (np.isnan(a) & np.isnan(b)))
    return first.size, int(np.count_nonzero(wrong))


if __name__ == "__main__":
    sys.exit(main())
