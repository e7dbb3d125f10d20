"""`dehyst watch` on a real terminal: on one that cannot redraw its screen it prints lines."""

import os
import pty
import subprocess
import sys

import pytest
from tests.rigs.gateway_bench import ROOT, Bench

ENTERS_SCREEN = b"\x1b[?1049h"


def watched(bench: Bench, term: str | None) -> bytes:
    """Run `dehyst watch` for 3 s on a pseudo terminal with this TERM; return what it printed."""
    ours, theirs = pty.openpty()
    env = {name: value for name, value in os.environ.items() if name != "TERM"}
    command = [sys.executable, "-P", "-m", "dehyst.daemon.main", "watch", "--for", "3"]
    process = subprocess.Popen(
        [*command, "--connect", bench.address], cwd=ROOT, stdin=theirs, stdout=theirs,
        stderr=theirs, env=env if term is None else env | {"TERM": term},
    )  # fmt: skip
    os.close(theirs)
    said = b""
    try:
        while data := os.read(ours, 65536):
            said += data
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert process.wait(60.0) == 0, said
    return said


@pytest.mark.parametrize("term", ["dumb", "unknown", "", None])
def test_a_terminal_that_cannot_redraw_gets_lines(shared: Bench, term: str | None) -> None:
    said = watched(shared, term)
    assert said.count(b"measured ") >= 1
    assert b"\x1b" not in said


def test_another_terminal_gets_the_screen(shared: Bench) -> None:
    assert ENTERS_SCREEN in watched(shared, "xterm-256color")
