"""Several threads read a configuration at once, as the page does for each of its axes."""

import subprocess
import sys
from pathlib import Path

from tests.rigs.gateway_bench import environment
from tests.rigs.processes import simulated_config

CODE = """
import sys, threading
from dehyst.daemon.config.file import parse_config
sys.setswitchinterval(1e-6)
text, gate = open(sys.argv[1]).read(), threading.Barrier(8)
def read():
    gate.wait()
    parse_config(text)
threads = [threading.Thread(target=read) for _ in range(8)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
"""
ANEW = """
import sys, threading, msgspec
from dehyst.daemon.prepared import resolve_classes
sys.setswitchinterval(1e-6)
for round in range(400):
    part = msgspec.defstruct("Part", [(f"x{i}", dict[str, list[int]], {}) for i in range(20)])
    whole = msgspec.defstruct("Whole", [(f"part{i}", part | None, None) for i in range(20)])
    resolve_classes(whole)
    gate = threading.Barrier(8)
    def read():
        gate.wait()
        msgspec.json.decode(b'{"part3": {"x1": {}}}', type=whole)
    threads = [threading.Thread(target=read) for _ in range(8)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
"""
RUNS = 10
"""Without the preparation, about three of four runs end with a segmentation fault."""


def test_threads_that_read_their_first_configuration_end_no_process(tmp_path: Path) -> None:
    path = simulated_config(tmp_path, 200.0, tmp_path / "model.toml")
    for _ in range(RUNS):
        done = subprocess.run(
            [sys.executable, "-c", CODE, str(path)],
            env=environment(), capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-300:]


def test_threads_that_first_use_a_prepared_class_at_once_end_no_process() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ANEW], env=environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-300:]
