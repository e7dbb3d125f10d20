"""How a process ends: nothing that was begun is lost, and no thread that never ends is waited
for."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import atexit, sys, threading, time
from dehyst.daemon.interrupts import LightEnd

end = LightEnd()
def last():
    time.sleep(0.3)
    print("a thread that was waited for")

threading.Thread(target=last).start()
threading.Thread(target=threading.Event().wait, daemon=True).start()
atexit.register(print, "at exit")
print("before")
end.code = 3
"""


def test_what_was_begun_is_done_and_the_exit_status_is_as_given() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.stderr == ""
    assert done.returncode == 3
    assert done.stdout.splitlines() == ["before", "a thread that was waited for", "at exit"]


def test_an_exception_is_reported_and_no_success() -> None:
    program = "from dehyst.daemon.interrupts import LightEnd; LightEnd(); 1 / 0"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 1
    assert done.stderr.endswith("ZeroDivisionError: division by zero\n")


WRITES = """
from dehyst.daemon.interrupts import LightEnd
LightEnd().code = 0
print("kept until the end")
"""
BUFFERED = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}


def test_what_cannot_be_written_is_said_and_no_success() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", WRITES],
            env=BUFFERED,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=30,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr == "dehyst: stdout: No space left on device\n"


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("--version", 0, ""),
        ("drivers", 0, ""),
        (
            "drivers --json",
            2,
            "dehyst drivers: --json: stdout is closed; leave it open, or leave out --json\n",
        ),
    ],
)
def test_a_closed_stdout_is_no_traceback(words: str, code: int, said: str) -> None:
    done = subprocess.run(
        ["sh", "-c", f'exec "$0" -m dehyst.daemon.main {words} >&-', sys.executable],
        stderr=subprocess.PIPE,
        text=True,
        timeout=30,
        check=False,
    )
    assert (done.returncode, done.stderr) == (code, said)


def test_a_reader_that_has_gone_is_no_error() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WRITES],
        env=BUFFERED,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == ""
        assert process.wait(30.0) == 0


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("--help", "dehyst"),
        ("--version", "dehyst"),
        ("identify --help", "dehyst identify"),
        ("drivers", "dehyst drivers"),  # printed by rich
        ("drivers --json", "dehyst drivers"),  # more than fits the buffer of a stream
        ("config init --range 0 100", "dehyst config"),
        ("excite --range 0 75 --band 5 --duration 4 --json -o drive.csv", "dehyst excite"),
    ],
)
def test_a_command_whose_output_is_lost_says_so_and_is_no_success(
    words: str, name: str, unbuffered: str, tmp_path: Path
) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "dehyst.daemon.main", *words.split()],
            env=BUFFERED | {"PYTHONUNBUFFERED": unbuffered},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
            cwd=tmp_path,
        )
    assert done.stderr == f"{name}: stdout: No space left on device\n"
    assert done.returncode == 1
    assert (tmp_path / "drive.csv").exists() == ("drive.csv" in words)


@pytest.mark.parametrize("words", ["drivers", "drivers --json"])
def test_a_reader_of_a_command_that_has_gone_is_no_error(words: str) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", *words.split()],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


def test_where_nothing_can_be_said_the_exit_status_remains() -> None:
    with open("/dev/full", "w") as full:
        for words, code in (("drivers", 1), ("drivers nowhere", 2), ("drivers --nothing", 2)):
            done = subprocess.run(
                [sys.executable, "-m", "dehyst.daemon.main", *words.split()],
                env=BUFFERED,
                stdout=full,
                stderr=full,
                timeout=60,
                check=False,
            )
            assert done.returncode == code, words
