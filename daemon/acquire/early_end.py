"""The signals that end a recording early, and the terminal that may be gone afterwards."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dehyst.drivers.system import drop_what_nobody_reads

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # SIGHUP: a closed terminal or a lost ssh


@contextmanager
def signals_noted() -> Iterator[list[int]]:
    """Record Ctrl-C, SIGTERM and SIGHUP during the block in the yielded list, so that the recording
    can end cleanly. A SIGHUP that is ignored, as under nohup, remains ignored. After the block,
    whatever is printed to a terminal or a pipe that has gone is dropped and raises no error."""
    noted: list[int] = []
    before: dict[int, Any] = {}
    for name in NAMES:
        number = getattr(signal, name, None)  # some systems have no SIGHUP
        if number is None or (name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN):
            continue
        before[number] = signal.signal(number, lambda number, _: noted.append(number))
    try:
        yield noted
    finally:
        drop_what_nobody_reads()
        for number, handler in before.items():
            signal.signal(number, handler)
