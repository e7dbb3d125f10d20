"""Recovery when the log is unusable: full, closed, slow, on a full disk, or its terminal gone.

Each run starts `dehyst run`, makes its log unusable, and then does two things while the output is
high. First it kills the loop and measures the seconds until the amplifier reaches a safe output,
and until the next loop accepts a client's set-point. Then it sends SIGTERM and measures the seconds
until a safe output, and from a new start with the same log until a set-point is accepted.

example: python -m tests.benchmarks.daemon.bad_logs             (5 runs of each log)
         python -m tests.benchmarks.daemon.bad_logs --runs 1 --only "a slow reader"
"""

import argparse
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.bad_logs import BAD_LOGS
from tests.rigs.processes import dehyst, until
from tests.rigs.service import SAFE_V, Service
from tests.rigs.stage_model import kept_model

from dehyst.daemon.client.client import Client
from dehyst.daemon.files.models import save_model
from dehyst.models.errors import DehystError

MOST_SAFE_S, MOST_SERVING_S = 5.0, 12.0
START_S = 300.0
"""How long a first start may take: it compiles the kernels."""
FIGURES = ("killed, safe", "killed, serving", "SIGTERM, safe", "SIGTERM, serving")


def start(service: Service, file: int) -> Client:
    """Run the supervisor with this log; return when a set-point is accepted."""
    service.supervisor = dehyst("run", "--config", str(service.config), stdout=file, stderr=file)
    client = service.client()
    until(lambda: taken(client), START_S, "a set-point that is taken")
    return client


def taken(client: Client) -> bool:
    """Return whether a set-point is accepted."""
    try:
        return client.send(4.0).ok
    except DehystError:
        return False


def safe(service: Service) -> bool:
    """Return whether the output is in its safe state, as the amplifier reports it."""
    return service.output() < SAFE_V + 0.02


def once(kind: str) -> tuple[float, ...]:
    """Return seconds, in the order of FIGURES. AssertionError if something never happened."""
    with tempfile.TemporaryDirectory(prefix="dehyst-logs-") as name:
        folder = Path(name)
        save_model(kept_model(), folder / "model.toml")
        service = Service(folder, folder / "model.toml")
        try:
            with BAD_LOGS[kind](folder) as (file, spoil):
                client = start(service, file)
                service.high()
                spoil()
                first, begun = service.core_pid(), time.monotonic()
                os.kill(first, signal.SIGKILL)
                until(lambda: safe(service), 60.0, "a safe output")
                killed_safe = time.monotonic() - begun
                until(lambda: service.core_pid() not in (0, first), 60.0, "the next loop")
                until(lambda: taken(client), 60.0, "a set-point that is taken")
                killed_serving = time.monotonic() - begun
                client.close()

                service.high()
                assert service.supervisor is not None
                begun = time.monotonic()
                service.supervisor.send_signal(signal.SIGTERM)
                until(lambda: safe(service), 60.0, "a safe output")
                ended_safe = time.monotonic() - begun
                assert service.supervisor.wait(60.0) == 0
                begun = time.monotonic()
                start(service, file).close()
                return killed_safe, killed_serving, ended_safe, time.monotonic() - begun
        finally:
            service.close()


def main() -> int:
    """Print the table, and the bars."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=BAD_LOGS, default=list(BAD_LOGS))
    o = parser.parse_args()
    busy, bars = too_busy(), Bars()
    print(f"| log, median / largest of {o.runs} in s | {' | '.join(FIGURES)} |")
    print(f"|---|{'---|' * len(FIGURES)}", flush=True)
    for kind in o.only:
        try:
            runs = np.array([once(kind) for _ in range(o.runs)])
        except PermissionError as error:
            bars.cannot(kind, str(error))
            continue
        medians, largest = np.median(runs, axis=0), runs.max(axis=0)
        cells = (f"{m:.2f} / {x:.2f}" for m, x in zip(medians, largest, strict=True))
        print(f"| {kind} | {' | '.join(cells)} |", flush=True)
        for figure, median in zip(FIGURES, medians, strict=True):
            if busy:
                bars.cannot(f"{kind}: {figure}", busy)
            else:
                most = MOST_SAFE_S if figure.endswith("safe") else MOST_SERVING_S
                bars.most(f"{kind}: {figure}", float(median), most, "s")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
