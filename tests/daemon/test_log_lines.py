"""The log blocks nobody: lines that cannot be written are dropped, counted and reported later."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.rigs.bad_logs import BAD_LOGS

WRITER = """
import os, sys, time
from dehyst.daemon import log_lines
log_lines.keep_going("run")
for part in range(40):
    for n in range(200):
        print("a line of the log " + "x" * 200, file=sys.stderr)
    try:
        os.write(2, b"from compiled code\\n" * 200)
    except BlockingIOError:
        pass  # the pipe never blocks; compiled code does not look whether its line was taken
    print("on stdout")
time.sleep(0.3)
with open(sys.argv[1], "w") as said:
    said.write(str(log_lines.dropped()))
log_lines.last_words()
os._exit(7)
"""


@pytest.mark.parametrize("kind", BAD_LOGS)
def test_a_writer_ends_as_it_wants_whatever_becomes_of_its_log(kind: str, tmp_path: Path) -> None:
    """A process ends as it wants although it writes more than any queue holds, through Python and
    directly to the descriptor, into a log that cannot be written."""
    try:
        with BAD_LOGS[kind](tmp_path) as (file, spoil):
            spoil()
            command = [sys.executable, "-c", WRITER, str(tmp_path / "dropped")]
            with subprocess.Popen(command, stdout=file, stderr=file) as writer:
                assert writer.wait(30.0) == 7
    except PermissionError as error:
        pytest.skip(str(error))
    assert int((tmp_path / "dropped").read_text()) > 1000


def test_what_was_dropped_is_said_when_it_can_be_again() -> None:
    program = """
import os, sys
from dehyst.daemon import log_lines
log_lines.keep_going("run")
for n in range(3000):
    print(n, "x" * 200, file=sys.stderr)
os.write(3, b"!")
os.read(4, 1)
log_lines._log.flush()
print("the last line", file=sys.stderr)
log_lines.last_words()
print(log_lines.dropped(), file=sys.stderr)
log_lines.last_words()
os._exit(0)
"""
    full, empty = os.pipe(), os.pipe()
    os.set_inheritable(full[1], True)
    shell = f"exec 3>&{full[1]} 4<&{empty[0]}; exec {sys.executable} -c '{program}'"
    with subprocess.Popen(
        ["bash", "-c", shell], stderr=subprocess.PIPE, pass_fds=(full[1], empty[0])
    ) as writer:
        os.read(full[0], 1)  # nothing was read so far: it has dropped lines
        os.write(empty[1], b"!")
        assert writer.stderr is not None
        lines = writer.stderr.read().decode().splitlines()
    for file in (*full, *empty):
        os.close(file)
    said = [line for line in lines if "could not be written" in line]
    dropped = int(lines[-1])
    assert dropped > 500
    assert sum(int(line.split()[2]) for line in said) == dropped
    assert lines[-2].endswith("the last line")
    assert len(lines) - 2 - len(said) + dropped == 3000


def test_a_log_that_takes_all_gets_all_in_order(tmp_path: Path) -> None:
    program = """
import sys
from dehyst.daemon import log_lines
log_lines.keep_going("run")
for n in range(500):
    print(n, end=" ", file=sys.stderr)
    print("line", file=sys.stderr)
log_lines.last_words()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stderr.decode().splitlines() == [f"{n} line" for n in range(500)]


def test_a_process_without_stdout_and_stderr_goes_on() -> None:
    program = (
        "import os, sys; from dehyst.daemon import log_lines; log_lines.keep_going('run'); "
        "print('lost', file=sys.stderr); log_lines.last_words(); os._exit(7)"
    )
    shell = f'exec "{sys.executable}" -c "{program}" >&- 2>&-'
    assert subprocess.run(["bash", "-c", shell], check=False).returncode == 7


CRASH = """
import ctypes
from dehyst.daemon import log_lines
log_lines.keep_going("page")
ctypes.string_at(0)
"""


def test_where_a_process_crashed_is_written_though_no_thread_is_left_to_write_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", CRASH], capture_output=True, text=True, check=False, timeout=60.0,
        env=os.environ | {"PYTHONFAULTHANDLER": "1"},
    )  # fmt: skip
    assert done.returncode == -signal.SIGSEGV
    assert "Fatal Python error: Segmentation fault" in done.stderr
