"""All tests in four parts, and one closing line for them.

    python -m tests.parts [quick] [thorough] [processes] [timing]

quick      what starts no process, no zenoh session and no pty, on all processors; a file's tests in
           one worker, which compiles their kernels and makes their fixtures once
thorough   the same where it takes longer: identification, diagnosis, the mismatch watch, recordings
processes  what does, on all processors; tests that share a rig of their module in one worker
timing     what judges times, alone

Every part is run, also behind one that failed. A plain `pytest` runs the same tests one by one.
Real processes on a machine that stands still for a second now and then miss a time-out now and
then: in the two latter parts a test that fails is run again, twice at most, and is named RERUN in
the summary and counted in the closing line. Exit status: 0 where all passed, else 1.
"""

import os
import re
import subprocess
import sys
import time
from collections import Counter

JOBS = str(len(os.sched_getaffinity(0)))
AGAIN = ["--reruns", "2", "--reruns-delay", "3", "-rfER"]
PARTS = {
    "quick": ["-n", JOBS, "--dist", "loadfile", "-m", "not processes and not thorough"],
    "thorough": ["-n", JOBS, "--dist", "loadfile", "-m", "thorough and not processes"],
    # native: pytest's own tracebacks parse the source, and where threads do so at once, CPython
    # 3.11 ends with "AST constructor recursion depth mismatch" and takes the worker with it
    "processes": [
        *("-n", JOBS, "--dist", "loadgroup", "--tb=native"),
        *("-m", "processes and not timing"),
        *AGAIN,
    ],
    "timing": ["-m", "timing", *AGAIN],
}
SHOWN = ("failed", "passed", "skipped", "error", "rerun")


def run(part: str) -> tuple[int, Counter[str]]:
    """(exit status of pytest, counts of its closing line); its output goes on as it comes."""
    print(f"--- {part}", flush=True)
    command = [sys.executable, "-m", "pytest", "-q", *PARTS[part]]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        last = ""
        for line in process.stdout:
            print(line, end="", flush=True)
            last = line if line.strip() else last
    found = re.findall(r"(\d+) (failed|passed|skipped|error|rerun)", last)
    return process.returncode, Counter({word: int(count) for count, word in found})


def main(parts: list[str]) -> int:
    """Run these parts, all of them where none is named."""
    if unknown := set(parts) - PARTS.keys():
        print(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
        return 2
    begun, counts, failed = time.monotonic(), Counter[str](), False
    for part in parts or PARTS:
        code, found = run(part)
        counts += found
        failed = failed or code != 0
    words = ", ".join(f"{counts[word]} {word}" for word in SHOWN if counts[word]) or "no tests ran"
    print(f"===== {words} in {time.monotonic() - begun:.0f} s =====")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
