"""Apply named mistakes to a copy of the code, one at a time, and check that the tests notice them.

    python -m tests.mutations [--only NAME ...] [--room ROOM ...] [--jobs N] [--list]

Each change in the lists of this folder is applied to its own copy of the tree in a temporary
folder, where the tests that should notice it run until the first failure; the test that noticed it
before, as docs/noticed.md says, runs first. A change that survives beside another is judged once
more alone, because some tests need an idle machine to tell. All tests that failed then run on an
unchanged copy. A change is `noticed` when a test fails that passes there (or does not end) and
`survived` when all pass. Exit status: 1 if a change survives without a listed reason, could not be
applied or could not be judged; else 0.

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
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.mutations.change import ROOT, Change, copy_project, link_tree, put
from tests.mutations.order import FIRST
from tests.mutations.rooms import ROOMS
from tests.parts import memory_folder

NOTICED, SURVIVED, UNFIT = "noticed", "survived", "could not apply"
UNJUDGED = "could not be judged"
LIMIT_S = 900.0
"""Time limit of a run on changed code. Tests end themselves after 120 s, some after 240 s, so that
the test that noticed is named; the longest files take 250 s on unchanged code."""
RECORDED = ROOT / "docs" / "noticed.md"
"""Where the test that noticed each change is recorded."""


@dataclass(frozen=True)
class Outcome:
    """The result of a change; by: the test that noticed it, or the reason for the result; node:
    the failed test as pytest takes it."""

    change: Change
    result: str
    by: str = ""
    node: str = ""


def recorded_tests() -> dict[str, str]:
    """Return for each change the name of the test that noticed it before."""
    text = RECORDED.read_text(encoding="utf-8")
    return dict(re.findall(r"^\| [\w ]+: ([\w-]+) \|.*\| `(test_\w+)[^|]*\|$", text, re.MULTILINE))


def run_tests(
    tree: Path, tests: Sequence[str], *options: str, first: str = ""
) -> tuple[int | None, str]:
    """Return the exit status of pytest (None if it did not end) and its output."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    command += ["-p", "tests.mutations.order", *options, *tests]
    data = os.environ.get("DEHYST_DATA") or str(ROOT.parent / "shared")
    path = os.pathsep.join([str(tree / "src"), str(tree)])
    env = {**os.environ, "PYTHONPATH": path, "DEHYST_DATA": data, FIRST: first}
    env.pop("NUMBA_CACHE_DIR", None)  # each copy has the kernels next to their files
    with tempfile.TemporaryDirectory(prefix="t-", dir=tree.parent) as files:
        command += ["--basetemp", f"{files}/all"]
        process = subprocess.Popen(
            command, cwd=tree, env=env, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            out, _ = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None, process.communicate()[0]
        return process.returncode, out


def failed_in(out: str) -> list[str]:
    """Return the tests that pytest's summary names as failed."""
    return re.findall(
        r"^(?:FAILED|ERROR) (\S+?\.py(?:::\w+)*(?:\[.*?\])?)(?: - .*)?$", out, re.MULTILINE
    )


def judge(base: Path, folder: Path, change: Change, first: str) -> Outcome:
    """Apply one change to a copy of the base and run its tests there."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        tree = link_tree(base, Path(name) / "tree")
        try:
            put(tree, change)
        except (ValueError, OSError) as error:
            return Outcome(change, UNFIT, str(error))
        code, out = run_tests(tree, change.tests, "-x", first=first)
    if code is None:
        return Outcome(change, NOTICED, "it did not end")
    if code == 0:
        return Outcome(change, SURVIVED, change.survives)
    if code == 1 and (failed := failed_in(out)):
        return Outcome(change, NOTICED, failed[0].rpartition("::")[2], failed[0])
    return Outcome(change, UNJUDGED, f"pytest ended with {code}: {out.strip()[-400:]}")


def fail_unchanged(base: Path, nodes: Sequence[str], pool: ThreadPoolExecutor) -> set[str]:
    """Return which of these tests do not pass on unchanged code."""
    files: dict[str, list[str]] = {}
    for node in nodes:
        files.setdefault(node.partition("::")[0], []).append(node)

    def one(of_a_file: list[str]) -> list[str]:
        code, out = run_tests(base, of_a_file)
        return [] if code == 0 else failed_in(out) or of_a_file

    return {node for failed in pool.map(one, files.values()) for node in failed}


def run(changes: Sequence[Change], jobs: int) -> list[Outcome]:
    """Judge all changes, in order, and print each outcome when it is known."""
    recorded = recorded_tests()
    with (
        tempfile.TemporaryDirectory(prefix="dehyst-mutations-", dir=memory_folder()) as name,
        ThreadPoolExecutor(jobs) as pool,
    ):
        folder = Path(name)
        base = copy_project(folder / "base")

        def one(change: Change) -> Outcome:
            outcome = judge(base, folder, change, recorded.get(change.name, ""))
            print(f"{outcome.result:19s} {change.name}  {outcome.by}", flush=True)
            return outcome

        outcomes = [
            outcome
            if jobs == 1 or outcome.result != SURVIVED or outcome.by
            else one(outcome.change)
            for outcome in list(pool.map(one, changes))
        ]
        nodes = list(dict.fromkeys(one.node for one in outcomes if one.node))
        print(f"{len(nodes)} tests noticed them; they run on unchanged code", flush=True)
        broken = fail_unchanged(base, nodes, pool)
    reason = "the test that failed also fails on the code as it is"
    return [
        Outcome(one.change, UNJUDGED, f"{reason}: {one.by}") if one.node in broken else one
        for one in outcomes
    ]


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
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
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
