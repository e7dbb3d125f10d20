"""Run all tests in five parts, and print one summary line for them.

    python -m tests.parts [quick] [thorough] [timing] [processes] [alone]
    python -m tests.parts --long

With --long, it runs the tests that are named in tests/long.py, and otherwise all others.

quick      tests that start no process, no zenoh session and no pty, on all processors; one worker
           runs a whole file, so that kernels are compiled and fixtures made once
thorough   the same, for tests that take longer: identification, diagnosis, mismatch, files of other
           programs, terminals
timing     tests that judge times and mostly wait, with a worker for each processor; nothing that
           computes runs at the same time
processes  tests that start something; those that share a module's rig run in one worker. There is
           one worker more than processors, because they often wait; with two more, loops and
           clients of several tests are late together
alone      tests that judge times and need a processor to themselves, one after another

The parts run one after another: computation next to `processes` would make it late, and takes as
long by itself. Not even where the system lets it run only in the gaps (SCHED_IDLE): a virtual
machine that is always busy is stopped by its host more often. Each part is given only the files
with tests of it, because every worker imports all files that it is given. The longest files of
`thorough` come first, so that no worker has one left when the others are done; by default xdist
begins with the files with most tests.

Every part runs, even after one that failed, and no test is run twice. A plain `pytest` runs the
same tests one by one, and keeps the folders of the last three runs; here they are in memory where
it has room, as some disks take 30 s to delete their ten thousand files, and go when all parts are
done. Exit status: 0 if all passed, else 1.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.long import may_hold
from tests.rigs.starts import starts_something_always, starts_something_in

TESTS = Path(__file__).resolve().parent
THOROUGH = (
    "models/identify", "models/diagnosis", "models/mismatch", "models/drive_design", "replay",
    "models/inverse/test_compensator.py", "models/physics/test_every_physics.py",
    "daemon/commands/test_diagnose.py", "daemon/commands/test_identify.py",
    "daemon/commands/test_excite.py", "daemon/commands/test_validate.py",
    "daemon/loop/test_random_life.py", "daemon/doctor/test_examination.py", "daemon/files",
    "daemon/terminal", "daemon/setup/test_moving.py", "daemon/report/test_every_picture.py",
    "daemon/paper", "daemon/imaging", "daemon/benchmark", "daemon/doctor/test_story.py",
    "daemon/doctor/test_ends.py", "daemon/api/test_functions.py", "daemon/acquire/test_outputs.py",
    "daemon/commands/test_other_files.py", "models/learning/test_trim.py",
    "models/cascade/test_reach.py", "benchmarks/models/test_proof.py",
    "models/signals/test_marks_of_pasts.py", "models/signals/test_lone.py",
    "daemon/report/test_choice.py", "daemon/epics/test_waiting.py",
    "daemon/gateway/test_case_keeper.py", "daemon/gateway/test_trial_ends.py",
    "benchmarks/models/test_whose_lag.py", "daemon/loop/test_trim_anew.py",
    "daemon/loop/test_staying.py", "packaging/test_mutations_apply.py",
    "packaging/test_systems.py", "daemon/loop/test_compiled_loop.py",
    "daemon/gateway/test_trial_motion.py",
)  # fmt: skip
"""Folders and files of the tests in `thorough`."""
LONGEST = (
    "models/diagnosis/test_hard_recordings.py", "models/inverse/test_compensator.py",
    "daemon/loop/test_random_life.py", "models/drive_design/test_excitation.py",
    "models/diagnosis/test_names.py", "daemon/doctor/test_examination.py",
    "models/identify/test_intervals.py", "models/identify/test_identify.py",
    "models/diagnosis/test_subject.py", "daemon/commands/test_diagnose.py",
    "models/diagnosis/test_data_first.py", "replay/test_diagnose_real.py",
    "replay/test_real_trajectory.py", "models/identify/test_timing.py",
    "models/diagnosis/test_intervals.py", "models/diagnosis/test_times.py",
    "daemon/commands/test_identify.py",
)  # fmt: skip
"""Files of `thorough`, by decreasing processor time: 22 to 5 s each, of 200 s in total. The first
file compiles the diagnosis; the ones that start next to it do not need it, or both workers would
compile it."""
JOBS = str(len(os.sched_getaffinity(0)))
PARTS = {
    "quick": ("not processes and not thorough", ["-n", JOBS, "--dist", "loadfile"]),
    "thorough": (
        "thorough and not processes",
        ["-n", JOBS, "--dist", "loadfile", "--no-loadscope-reorder"],
    ),
    # native: pytest's own tracebacks parse the source, and if threads do so at once, CPython 3.11
    # ends with "AST constructor recursion depth mismatch" and takes the worker with it
    "timing": ("timing and not alone", ["-n", JOBS, "--dist", "loadgroup", "--tb=native"]),
    "processes": (
        "processes and not timing",
        ["-n", str(int(JOBS) + 1), "--dist", "loadgroup", "--tb=native"],
    ),
    "alone": ("alone", []),
}
"""Each part's marks and how pytest runs it."""
MEMORY, LEAST_FREE = Path("/dev/shm"), 4_000_000_000
"""A file system in memory, and the bytes that it needs for the tests' folders: 200 MB, with room
for what the tests that fill a disk may do."""
SHOWN = ("failed", "passed", "skipped", "error")


def is_thorough(path: Path) -> bool:
    """Return whether this file's tests are `thorough`."""
    return str(path.relative_to(TESTS)).startswith(THOROUGH)


def is_of(path: Path, part: str) -> bool:
    """Return whether this file has tests of this part; it may have tests of others too."""
    if part == "quick":
        return not is_thorough(path) and not starts_something_always(path)
    if part == "thorough":
        return is_thorough(path)
    if part == "processes" and starts_something_in(path):
        return True
    return f"mark.{part}" in path.read_text(encoding="utf-8")


def files_of(part: str, long: bool) -> tuple[Path, ...]:
    """Return the files with tests of this part, the longest first; they may have others too."""
    files = [path for path in sorted(TESTS.rglob("test_*.py")) if is_of(path, part)]
    files = [path for path in files if may_hold(str(path.relative_to(TESTS)), long)]
    if part == "thorough":
        places = {name: place for place, name in enumerate(LONGEST)}
        files.sort(key=lambda path: places.get(str(path.relative_to(TESTS)), len(LONGEST)))
    return tuple(files)


def memory_folder() -> Path | None:
    """Return the file system in memory; None if there is none that has room and runs programs."""
    if not MEMORY.is_dir() or os.statvfs(MEMORY).f_flag & os.ST_NOEXEC:
        return None
    return MEMORY if shutil.disk_usage(MEMORY).free > LEAST_FREE else None


def run(part: str, long: bool, folder: str) -> tuple[int, Counter[str]]:
    """Run one part, with its files in the folder, and show its output; return pytest's exit status
    and the counts of its last line."""
    print(f"--- {part}", flush=True)
    marks, options = PARTS[part]
    chosen = f"{marks} and {'long' if long else 'not long'}"
    command = [sys.executable, "-m", "pytest", "-q", *options, "-m", chosen]
    command += ["--basetemp", f"{folder}/{part}"]
    command += [os.path.relpath(path) for path in files_of(part, long)]
    last = ""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                print(line, end="", flush=True)
                last = line if line.strip() else last
        except BaseException:
            process.terminate()  # pytest ends its workers itself
            raise
    found = re.findall(r"(\d+) (failed|passed|skipped|error)", last)
    return process.returncode, Counter({word: int(count) for count, word in found})


def main(arguments: list[str]) -> int:
    """Run these parts, or all of them if none is named."""
    long, names = "--long" in arguments, [one for one in arguments if one != "--long"]
    if unknown := set(names) - PARTS.keys():
        print(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
        return 2
    begun, counts, failed = time.monotonic(), Counter[str](), False
    with tempfile.TemporaryDirectory(prefix="dt-", dir=memory_folder()) as folder:
        for part in names or PARTS:
            if part != "quick" or not long:
                code, found = run(part, long, folder)
                counts, failed = counts + found, failed or code != 0
    words = ", ".join(f"{counts[word]} {word}" for word in SHOWN if counts[word]) or "no tests ran"
    print(f"===== {words} in {time.monotonic() - begun:.0f} s =====")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
