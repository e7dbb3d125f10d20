"""Run all tests in five parts, and print one summary line for them.

    python -m tests.parts [quick] [timing] [processes] [thorough] [alone]

quick      tests that start no process, no zenoh session and no pty, on all processors; one worker
           runs a whole file, so that kernels are compiled and fixtures made once
thorough   the same, for tests that take longer: identification, diagnosis, mismatch, recordings
timing     tests that judge times and mostly wait, with a worker for each processor
processes  tests that start something; those that share a module's rig run in one worker. There is
           one worker more than processors, because they often wait; with two more, loops and
           clients of several tests are late together
alone      tests that judge times and need a processor to themselves, one after another

The parts run one after another, except `thorough`: it only computes, and does so in the time that
the processors have nothing else to do, while the tests of `timing` and `processes` wait. The system
stops it whenever another process wants the processor (SCHED_IDLE), so that those are not late.
Computation at an ordinary or a low priority next to them would make them late.

Each part is given only the files with tests of it, because every worker imports all files that it
is given. The longest files of `thorough` come first, so that no worker has one left when the others
are done; by default xdist begins with the files with most tests.

Every part runs, even after one that failed, and no test is run twice. A plain `pytest` runs the
same tests one by one. Exit status: 0 if all passed, else 1.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.rigs.starts import starts_something_always, starts_something_in

TESTS = Path(__file__).resolve().parent
THOROUGH = (
    "models/identify", "models/diagnosis", "models/mismatch", "models/drive_design", "replay",
    "models/inverse/test_compensator.py", "models/physics/test_every_physics.py",
    "daemon/commands/test_diagnose.py", "daemon/commands/test_identify.py",
    "daemon/commands/test_excite.py", "daemon/commands/test_validate.py",
    "daemon/loop/test_random_life.py", "daemon/doctor/test_examination.py",
    "daemon/setup/test_moving.py", "daemon/report/test_every_picture.py", "daemon/paper",
    "daemon/imaging", "daemon/benchmark", "daemon/doctor/test_story.py",
    "daemon/doctor/test_ends.py", "daemon/api/test_functions.py",
    "daemon/acquire/test_outputs.py", "daemon/files/test_recorder.py",
    "daemon/commands/test_other_files.py", "models/learning/test_trim.py",
    "models/cascade/test_reach.py", "benchmarks/models/test_proof.py",
    "models/signals/test_marks_of_pasts.py", "models/signals/test_lone.py",
    "daemon/report/test_choice.py", "daemon/epics/test_waiting.py",
    "daemon/gateway/test_case_keeper.py", "daemon/gateway/test_trial_ends.py",
    "benchmarks/models/test_whose_lag.py", "daemon/loop/test_trim_anew.py",
    "daemon/loop/test_staying.py",
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
    "quick": ["-n", JOBS, "--dist", "loadfile", "-m", "not processes and not thorough"],
    # native: pytest's own tracebacks parse the source, and if threads do so at once, CPython 3.11
    # ends with "AST constructor recursion depth mismatch" and takes the worker with it
    "timing": [
        *("-n", JOBS, "--dist", "loadgroup", "--tb=native"),
        *("-m", "timing and not alone"),
    ],
    "processes": [
        *("-n", str(int(JOBS) + 1), "--dist", "loadgroup", "--tb=native"),
        *("-m", "processes and not timing"),
    ],
    "thorough": [
        *("-n", JOBS, "--dist", "loadfile", "--no-loadscope-reorder"),
        *("-m", "thorough and not processes"),
        "--timeout=1800",  # s: in the gaps of a busy machine a test takes many times as long
    ],
    "alone": ["-m", "alone"],
}
IN_THE_GAPS, HAVE_GAPS = "thorough", ("timing", "processes")
"""The part that computes while the tests of those two wait."""
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


def files_of(part: str) -> tuple[Path, ...]:
    """Return the files with tests of this part, the longest first; they may have others too."""
    files = [path for path in sorted(TESTS.rglob("test_*.py")) if is_of(path, part)]
    if part == "thorough":
        places = {name: place for place, name in enumerate(LONGEST)}
        files.sort(key=lambda path: places.get(str(path.relative_to(TESTS)), len(LONGEST)))
    return tuple(files)


class Run:
    """A run of one part that has been started. in_the_gaps: only while no other process wants the
    processor; its output is then kept until it has ended."""

    def __init__(self, part: str, in_the_gaps: bool = False) -> None:
        self.part = part
        command = [sys.executable, "-m", "pytest", "-q", *PARTS[part]]
        command += [os.path.relpath(path) for path in files_of(part)]
        self._kept = tempfile.TemporaryFile("w+") if in_the_gaps else None  # noqa: SIM115
        self._process = subprocess.Popen(
            command, stdout=self._kept or subprocess.PIPE, text=True, stdin=subprocess.DEVNULL
        )
        if in_the_gaps:  # before pytest starts its workers, which inherit it
            os.sched_setscheduler(self._process.pid, os.SCHED_IDLE, os.sched_param(0))

    def stop(self) -> None:
        """End the run; pytest ends its workers itself."""
        self._process.terminate()

    def show(self) -> tuple[int, Counter[str]]:
        """Show the output until the end; return pytest's exit status and the counts of its last
        line."""
        print(f"--- {self.part}", flush=True)
        last = ""
        for line in self._lines():
            print(line, end="", flush=True)
            last = line if line.strip() else last
        found = re.findall(r"(\d+) (failed|passed|skipped|error)", last)
        return self._process.wait(), Counter({word: int(count) for count, word in found})

    def _lines(self) -> Iterator[str]:
        if self._kept is None:
            assert self._process.stdout is not None
            yield from self._process.stdout
        else:
            self._process.wait()
            self._kept.seek(0)
            yield from self._kept


def main(parts: list[str]) -> int:
    """Run these parts, or all of them if none is named."""
    if unknown := set(parts) - PARTS.keys():
        print(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
        return 2
    wanted = [name for name in PARTS if not parts or name in parts]
    begun, counts, failed = time.monotonic(), Counter[str](), False
    in_gaps = IN_THE_GAPS in wanted and hasattr(os, "SCHED_IDLE")
    runs: dict[str, Run] = {}
    try:
        for name in wanted:
            if name in HAVE_GAPS and in_gaps and IN_THE_GAPS not in runs:
                runs[IN_THE_GAPS] = Run(IN_THE_GAPS, in_the_gaps=True)
            if name not in runs:
                runs[name] = Run(name)
            code, found = runs[name].show()
            counts, failed = counts + found, failed or code != 0
    except BaseException:
        for run in runs.values():
            run.stop()
        raise
    words = ", ".join(f"{counts[word]} {word}" for word in SHOWN if counts[word]) or "no tests ran"
    print(f"===== {words} in {time.monotonic() - begun:.0f} s =====")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
