"""Apply named mistakes to a copy of the code, one at a time, and check that the tests notice them.

    python -m tests.mutations [--only NAME ...] [--room ROOM ...] [--jobs N] [--list]

Each change in the lists of this folder is applied to its own copy of the tree in a temporary
folder, where the tests that should notice it run until the first failure. Before that, they run
once on an unchanged copy. A change is `noticed` when a test fails (or does not end) and `survived`
when all pass. Exit status: 1 if a change survives without a listed reason, could not be applied or
could not be judged; else 0.

No maintained tool fits: mutmut 3 copies each function into a switch and leaves out decorated
functions, so every numba kernel; cosmic-ray changes each operator and number of a file without
knowing what would hurt, in thousands of runs of kernels that compile for seconds each.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.mutations.change import ROOT, Change, copy_project, link_tree, put
from tests.mutations.rooms import ROOMS

NOTICED, SURVIVED, UNFIT = "noticed", "survived", "could not apply"
UNJUDGED = "could not be judged"
LEAST_S, TIMES = 270.0, 5.0
"""Time limit of a run on changed code: this, or this multiple of the time on unchanged code. Tests
end themselves after 120 s, some after 240 s, so that the test that noticed is named."""


@dataclass(frozen=True)
class Outcome:
    """The result of a change; by: the test that noticed it, or the reason for the result."""

    change: Change
    result: str
    by: str = ""
    seconds: float = 0.0


def run_tests(tree: Path, tests: Sequence[str], limit_s: float) -> tuple[int | None, str]:
    """Return the exit status of pytest (None if it did not end) and its output."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    data = os.environ.get("DEHYST_DATA") or str(ROOT.parent / "shared")
    path = os.pathsep.join([str(tree / "src"), str(tree)])
    env = {**os.environ, "PYTHONPATH": path, "DEHYST_DATA": data}
    env.pop("NUMBA_CACHE_DIR", None)  # each copy has the kernels next to their files
    with subprocess.Popen(
        command, cwd=tree, env=env, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as process:  # fmt: skip
        try:
            out, _ = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None, process.communicate()[0]
    return process.returncode, out


def judge(base: Path, folder: Path, change: Change, usual_s: float) -> Outcome:
    """Apply one change to a copy of the base and run its tests there."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(dir=folder) as name:
        tree = link_tree(base, Path(name) / "tree")
        try:
            put(tree, change)
        except (ValueError, OSError) as error:
            return Outcome(change, UNFIT, str(error))
        code, out = run_tests(tree, change.tests, max(LEAST_S, TIMES * usual_s))
    seconds = time.monotonic() - begun
    if code is None:
        return Outcome(change, NOTICED, "it did not end", seconds)
    if code == 0:
        return Outcome(change, SURVIVED, change.survives, seconds)
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", out, re.MULTILINE)
    if code == 1 and failed:
        return Outcome(change, NOTICED, failed[1].rpartition("::")[2], seconds)
    return Outcome(change, UNJUDGED, f"pytest ended with {code}: {out.strip()[-400:]}", seconds)


def check_unchanged(
    base: Path, changes: Sequence[Change], pool: ThreadPoolExecutor
) -> dict[tuple[str, ...], float]:
    """Return the seconds that each set of tests takes on unchanged code; sets that fail are left
    out."""

    def one(tests: tuple[str, ...]) -> tuple[tuple[str, ...], int | None, float]:
        begun = time.monotonic()
        code, out = run_tests(base, tests, 1800.0)
        print(f"unchanged: {' '.join(tests)}: {out.strip().splitlines()[-1:]}", flush=True)
        return tests, code, time.monotonic() - begun

    judged = pool.map(one, dict.fromkeys(one.tests for one in changes))
    return {tests: seconds for tests, code, seconds in judged if code == 0}


def run(changes: Sequence[Change], jobs: int) -> list[Outcome]:
    """Judge all changes, in order, and print each outcome when it is known."""
    with (
        tempfile.TemporaryDirectory(prefix="dehyst-mutations-") as name,
        ThreadPoolExecutor(jobs) as pool,
    ):
        folder = Path(name)
        base = copy_project(folder / "base")
        usual_s = check_unchanged(base, changes, pool)

        def one(change: Change) -> Outcome:
            if change.tests in usual_s:
                outcome = judge(base, folder, change, usual_s[change.tests])
            else:
                outcome = Outcome(change, UNJUDGED, "its tests fail on the code as it is")
            print(f"{outcome.result:19s} {change.name}  {outcome.by}", flush=True)
            return outcome

        return list(pool.map(one, changes))


def print_table(outcomes: Sequence[Outcome]) -> None:
    """Print a table for docs/measured.md, and the counts."""
    print("\n| change | result | by | what it would do |\n|---|---|---|---|")
    for one in outcomes:
        by = " ".join(one.by.split())[:120]
        print(f"| {one.change.name} | {one.result} | {by} | {one.change.does} |")
    counts = Counter(one.result for one in outcomes)
    print("\n" + ", ".join(f"{counts[word]} {word}" for word in counts))


def pick(rooms: Sequence[str], only: Sequence[str]) -> list[Change]:
    """Return the changes of these rooms and names. Raises ValueError for an unknown name."""
    every = {name: list(changes) for name, changes in ROOMS.items()}
    names = [one.name for changes in every.values() for one in changes]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise ValueError(f"two changes have one name: {', '.join(twice)}")
    if unknown := (set(only) - set(names)) | (set(rooms) - every.keys()):
        raise ValueError(f"no such change or room: {', '.join(sorted(unknown))}")
    chosen = [one for name in rooms or every for one in every[name]]
    return [one for one in chosen if not only or one.name in only]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(prog="tests.mutations", description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--room", nargs="+", default=[], metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="name the changes, apply none")
    args = parser.parse_args(argv)
    try:
        changes = pick(args.room, args.only)
    except ValueError as error:
        print(error)
        return 2
    if args.list:
        unfit = 0
        for change in changes:
            try:
                change.changed((ROOT / change.file).read_text(encoding="utf-8"))
                print(f"{change.name}: {change.does}")
            except (ValueError, OSError) as error:
                print(error)
                unfit += 1
        print(f"{len(changes)} changes, {unfit} can not be applied")
        return int(unfit > 0)
    outcomes = run(changes, args.jobs)
    print_table(outcomes)
    bad = [one for one in outcomes if one.result != NOTICED and not one.change.survives]
    return int(bool(bad) or any(one.result in (UNFIT, UNJUDGED) for one in outcomes))


if __name__ == "__main__":
    try:
        code = main()
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has closed the pipe, e.g. `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    sys.exit(code)
