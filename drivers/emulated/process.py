"""The process of the emulated bench: serves its units and control socket until it is stopped."""

import json
import threading
from collections.abc import Callable
from pathlib import Path

from dehyst.drivers.emulated.bench import Bench, BenchLog, BenchSettings
from dehyst.drivers.emulated.control import Control
from dehyst.drivers.emulated.pty_device import serve
from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.simulated.axes import compile_stage

LOG_SUFFIXES = (".npz", ".csv")


def run_bench(
    directory: str | Path,
    settings: BenchSettings,
    stop: threading.Event,
    ready: Callable[[dict[str, str]], None],
    started: Callable[[Bench], None] = lambda bench: None,
    log: Path | None = None,
) -> None:
    """Serve an emulated bench in this thread until `stop` is set (wake it with a server's wake()).

    started: called with the bench before anything can be opened, so that the caller can wake it;
    ready: called with the ports when they can be opened. log: where the log is written at the end
    (.npz or .csv). Raises DriverConfigError.
    """
    if log is not None and log.suffix not in LOG_SUFFIXES:
        raise DriverConfigError(f"the log {log} must end in {' or '.join(LOG_SUFFIXES)}")
    if log is not None and not log.parent.is_dir():
        raise DriverConfigError(f"the log's folder {log.parent} does not exist")
    compile_stage()
    kept = BenchLog() if log is not None else None
    bench = Bench(directory, settings, kept)
    control = Control(bench, log)
    started(bench)
    try:
        for server in bench.servers:
            server.plug()
        ready(bench.ports())
        serve(bench.servers, stop, [(control.fileno(), control.take)])
    finally:
        for server in bench.servers:
            server.stop()
        control.close()
        if log is not None and kept is not None:
            kept.save(log)


def ready_line(ports: dict[str, str]) -> str:
    """Return the ports as one line of JSON."""
    return json.dumps(ports)
