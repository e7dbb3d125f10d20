"""Every command and snippet of README and docs is run, against one real `dehyst run`.

A block of shell is run line by line in one folder, a block of Python as a program; a block of
configuration is added to a real one and read. The blocks of a tutorial share a folder. Blocks that
need a stage, another machine or root are in LEFT_OUT, with the reason; at most MOST_LEFT_OUT.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import tomli_w
from tests.rigs.axes_bench import AxesBench
from tests.rigs.gateway_bench import ROOT, STARVES_S, free_port, noted_pauses
from tests.rigs.processes import EmulatedBench, dehyst, until
from tests.rigs.stage_model import model_text

from dehyst.daemon.bench.simulated import exploring_drive
from dehyst.daemon.config import load_controller
from dehyst.daemon.files.recordings import write_recording
from dehyst.drivers.simulated.stage import SimulatedStage

MOST_LEFT_OUT = 5
LEFT_OUT = {
    ("README.md", "make demo"): "the demonstration and all tests: run by themselves, for minutes",
    ("README.md", "python3 -m venv /opt/dehyst"): "installs a service as root",
    ("docs/install.md", "pipx install"): "installs from the package index, and into the home",
    ("docs/network.md", "dehyst watch --connect tls"): "another machine, by its name; the same is "
    "tested on the loopback in tests/daemon/bus",
    ("docs/epics.md", "export EPICS_CA_ADDR_LIST"): "the command-line tools of EPICS base",
}
"""(page, beginning of the block) -> why it is not run."""
TUTORIALS = "docs/tutorials/"
NOT_PROGRAMS = ("docs/architecture.md models/", "docs/loop-states.md           target")
SECONDS = {
    "--for 10": "--for 1", "--for 60": "--for 1", "--wait 60": "--wait 1",
    "--duration 20": "--duration 10", "--repeat 10": "--repeat 3",
}  # fmt: skip
LONG = ("run", "watch", "page", "epics", "serve", "emulate", "gateway")
"""Commands that run until they are ended, like `record` and `watch` without --for."""
EXPECTED = {
    "dehyst accept": (1, 2),
    "dehyst reject": (1, 2),
    "dehyst doctor --report": (0, 2),
    "dehyst validate": (0, 1),
    "dehyst diagnose": (0, 1),
    "dehyst status": (0, 1),
    "dehyst identify": (0, 1),
}
"""Allowed exit codes: there is no offer, and a report only if a busy machine was flagged; a model
may be worse than it claims, or lack something; a busy machine misses deadlines."""


class Block(NamedTuple):
    """One block of a page; line: where it begins."""

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks() -> list[Block]:
    """Return all blocks of README and docs that are commands, programs or configurations."""
    found = []
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        text, name = path.read_text(), str(path.relative_to(ROOT))
        if path.name in ("measured.md", "noticed.md", "reference-commands.md"):
            continue  # generated from code and benchmarks; the examples in help texts follow below
        for m in re.finditer(r"^( *)```(\w*)[^\n]*\n(.*?)^ *```", text, re.S | re.M):
            body = re.sub(rf"^{m[1]}", "", m[3], flags=re.M)
            if not f"{name} {body}".startswith(NOT_PROGRAMS) and not body.startswith("{"):
                found.append(Block(name, text.count("\n", 0, m.start()) + 1, m[2], body))
    return found


def is_left_out(block: Block) -> bool:
    return any(block.page == p and block.text.startswith(begins) for p, begins in LEFT_OUT)


MY_PACKAGE = """
from dehyst.drivers.simulated.devices import SimulatedSensor

class MyGauge(SimulatedSensor):
    @classmethod
    def from_settings(cls, settings):
        own = {key: value for key, value in settings.items() if key != "port"}
        return super().from_settings({**own, "stage": "mine"})
"""


def recordings(folder: Path) -> tuple[str, ...]:
    """Record the simulated stage: for identification, with another drive, and with a hold."""
    made = []
    for name, seconds in (("run.csv", 12.0), ("another.csv", 10.0), ("holds.csv", 14.0)):
        t_s, volts = exploring_drive(seconds=seconds)
        _, reading = SimulatedStage(None).run(t_s, volts)
        columns = {"u_v": np.concatenate([[0.0], volts[:-1]]), "y_um": reading}
        for kind in (name, name.replace(".csv", ".npz")):
            write_recording(folder / kind, t_s, columns, {})
            made.append(kind)
    shutil.copy(folder / "another.csv", folder / "other.csv")
    beside = [path.name for path in folder.glob("*.meta.json")]
    return (*made, "other.csv", *beside)


class Desk:
    """A folder like a user's, a running daemon, and units at two ports."""

    def __init__(self, folder: Path) -> None:
        self.top, self.number = folder, 0
        self.address = f"tcp/127.0.0.1:{free_port()}"
        self.ports = {port: free_port() for port in (8080, 50000, 7447)}
        (folder / "hardware").mkdir()
        self.units = EmulatedBench(folder / "hardware")
        self.log = folder / "run.txt"
        with open(self.log, "wb") as words:
            self.daemon = dehyst("run", "--listen", self.address, stdout=words, stderr=words)
        until(lambda: "ready: clients reach" in self.log.read_text(), 240.0, "it is ready")
        self.env = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"}
        self.env |= {"DEHYST_CONNECT": self.address, "MPLBACKEND": "Agg"}
        self.env["PATH"] = f"{folder / 'bin'}:{Path(sys.executable).parent}:{self.env['PATH']}"
        (folder / "bin").mkdir()
        tool = folder / "bin" / "dehyst"
        tool.write_text(f'#!/bin/sh\nexec {sys.executable} -P -m dehyst.daemon.main "$@"\n')
        tool.chmod(0o755)
        self.stage = recordings(folder)
        self.page = ""

    def fresh(self, block: Block) -> None:
        """Make a folder with the files that the snippets assume: per block, or per tutorial."""
        before, self.page = self.page, block.page
        if block.page.startswith(TUTORIALS) and block.page == before:
            return
        self.number += 1
        self.folder = self.top / f"block-{self.number}"
        self.folder.mkdir()
        # a controller of this name only finds the units of this block
        (self.folder / "runtime").mkdir(mode=0o700)
        self.env["XDG_RUNTIME_DIR"] = str(self.folder / "runtime")
        for name in ("docs", "systemd", "daemon", "drivers", "models", ".git"):
            (self.folder / name).symlink_to(ROOT / name)
        for name in self.stage if block.language == "python" else ("other.csv",):
            shutil.copy(self.top / name, self.folder / name)
        (self.folder / "my_package.py").write_text(MY_PACKAGE)
        t_s = np.arange(0.0, 2.0, 0.01)
        um = 9.0 + 2.0 * np.sin(np.pi * t_s)
        rows = "".join(f"{t:.2f},{y:.4f}\n" for t, y in zip(t_s, um, strict=True))
        for name in ("scan.csv", "trajectory.csv"):
            (self.folder / name).write_text("t_s,target_um\n" + rows)
        for name in ("stage.model.toml", "stage-x.toml", "stage-y.toml", "model.toml"):
            (self.folder / name).write_text(model_text())
        (self.folder / "page-passwords").write_text("alice:secret-words\nbob:other-words\n")
        (self.folder / "page-passwords").chmod(0o600)

    def shell(self, line: str) -> str:
        """Return a line as it is run here: with these ports, and shorter times."""
        for old, new in (SECONDS | self._paths()).items():
            line = line.replace(old, new)
        if "setup" in line and "--until" not in line:
            until = "configuration" if self.page.startswith(TUTORIALS) else "limits"
            line += f" --until {until}"  # tests/daemon/setup continues from there
            line += "" if "--yes" in line else " --yes --range 0 100"
            if "--emulated" not in line and "--ports" not in line:
                line += f" --ports {self.units.ports['mdt693b']} {self.units.ports['ksg101']}"
        return line

    def _paths(self) -> dict[str, str]:
        return {
            "/dev/ttyACM0": self.units.ports["mdt693b"],
            "/dev/ttyUSB0": self.units.ports["ksg101"],
            "tcp/10.0.0.5:7447,tcp/10.0.0.6:7447": self.address,
            "--name stage-1": "--name bench",
            " ...": " --passwords page-passwords --operators alice",
            "config init --range 0 100 -o stage.toml": "config init --range 0 100 -o stage.toml "
            f"--set port={self.units.ports['mdt693b']} "
            f"--sensor-set port={self.units.ports['ksg101']}",
        }

    def close(self) -> None:
        """Stop the daemon and the units."""
        self.daemon.send_signal(signal.SIGTERM)
        self.daemon.wait(60.0)
        self.units.close()


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    made = Desk(tmp_path_factory.mktemp("desk"))
    try:
        yield made
    finally:
        made.close()


def run_shell(desk: Desk, text: str) -> None:
    """Run the lines of a block, and check the exit code of each."""
    for line in text.replace("\\\n", " ").splitlines():
        command = re.sub(r"\s+#.*", "", line).strip()
        if not command or command.startswith("#"):
            continue
        if re.fullmatch(r"dehyst run( --listen \S+| --config stage-1/\S+)?", command):
            continue  # the daemon of this desk is used instead
        command = desk.shell(command)
        words = shlex.split(command) if "'" not in command and "|" not in command else []
        if words[:2] and words[0] == "dehyst" and words[1] in ("page", "serve", "epics"):
            command += {
                "page": f" --listen 127.0.0.1:{free_port()}",
                "serve": f" --listen 127.0.0.1:{free_port()}",
                "epics": f" --port {free_port()}",
            }[words[1]]
        lasting = (
            words[1:2]
            and (words[1] in LONG or words[1] == "record")
            and "--for" not in words
            and "--list" not in words
        ) or "router.py" in command
        allowed = next((c for b, c in EXPECTED.items() if command.startswith(b)), (0,))
        # in its own session: a signal of the test ends the command, not the test
        process = subprocess.Popen(
            ["bash", "-c", f"exec {command}" if lasting else command],
            cwd=desk.folder, env=desk.env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        if lasting:
            time.sleep(4.0)
            said = process.poll()
            if said is None:
                process.send_signal(signal.SIGINT)
            allowed = (*allowed, -signal.SIGINT, 130)
            assert said is None, f"{command}: ended by itself: {process.communicate()[0][-800:]}"
        out, _ = process.communicate(timeout=120)
        assert process.returncode in allowed, f"{command}: {process.returncode}: {out[-800:]}"
        assert "Traceback" not in out, out[-2000:]


PRELUDES = {
    "docs/axes.md": "import numpy as np\nt_s = np.arange(0.0, 1.0, 0.01)\n"
    "x_um = y_um = 4.0 + t_s\n",
    "docs/recording-columns.md": "import numpy, pandas\n",
    "docs/python.md": "import numpy as np\nt_s = np.arange(0.0, 1.0, 0.01)\n"
    "target_um = 9.0 + np.sin(2 * np.pi * t_s)\n",
}


def run_python(desk: Desk, block: Block, tmp_path: Path) -> None:
    """Run a program, after the server or controller that its page starts first."""
    env, text = dict(desk.env), PRELUDES.get(block.page, "") + block.text
    with ExitStack() as held:
        if "Group(" in text:
            bench = AxesBench(tmp_path, "xy")
            held.callback(bench.close)
            bench.start_gateway()
            env["DEHYST_CONNECT"] = bench.address
            bench.group("xy").close()
        port = free_port()
        if "50000" in text:
            text = text.replace("50000", str(port))
            serve(desk, held, "serve", "--as", "gcs", "--listen", f"127.0.0.1:{port}")
        if "epics.motor" in text:
            text = text.replace("dehyst:stage-1", "dehyst:bench")
            env |= {"EPICS_CA_ADDR_LIST": "127.0.0.1", "EPICS_CA_AUTO_ADDR_LIST": "NO"}
            env |= {"EPICS_CA_SERVER_PORT": str(port)}
            serve(desk, held, "epics", "--port", str(port))
        program = [sys.executable, "-c", text]
        if "SensorContract" in text:
            (desk.folder / "test_mine.py").write_text(text)
            program = [
                sys.executable,
                "-m",
                "pytest",
                "-q",
                "-p",
                "no:cacheprovider",
                "test_mine.py",
            ]
        for _ in range(3):
            with noted_pauses() as pauses:
                done = subprocess.run(
                    program,
                    cwd=desk.folder,
                    env=env | {"PYTHONPATH": f"{env['PYTHONPATH']}:{desk.folder}"},
                    capture_output=True, text=True, timeout=240, check=False,
                )  # fmt: skip
            if done.returncode == 0 or max(pauses) <= STARVES_S:
                break  # else this machine stood still for so long that a flight starves
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-2000:]


def serve(desk: Desk, held: ExitStack, *command: str) -> None:
    """Run one of the product's servers until the program has ended."""
    process = dehyst(
        *command, "--connect", desk.address, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    held.callback(process.stderr.close)
    held.callback(process.wait, 30.0)
    held.callback(process.send_signal, signal.SIGTERM)
    process.stderr.readline()  # wait for the line that says where it listens


def read_configuration(desk: Desk, block: Block) -> None:
    """Read a whole configuration as it is, or a section added to the running one."""
    given = tomllib.loads(block.text)
    if "project" in given:
        return
    if "name" not in given:
        said = desk.log.read_text()
        path = re.search(r"its configuration is (\S+);", said)
        assert path, said
        base = tomllib.loads(Path(path[1]).read_text())
        for section, keys in given.items():
            base[section] = {**base.get(section, {}), **keys}
        given = base
    path_here = desk.folder / "read.toml"
    path_here.write_text(tomli_w.dumps(given))
    assert load_controller(path_here).axes


@pytest.mark.parametrize("block", [b for b in blocks() if not is_left_out(b)], ids=str)
def test_a_snippet_works(desk: Desk, block: Block, tmp_path: Path) -> None:
    desk.fresh(block)
    if block.language in ("", "bash", "sh"):
        run_shell(desk, block.text)
    elif block.language == "python":
        run_python(desk, block, tmp_path)
    elif block.language == "toml":
        read_configuration(desk, block)
    elif block.language == "ini":
        (line,) = re.findall(r"^ExecStart=\S+/(dehyst .*)$", block.text, re.M)
        run_shell(desk, line.replace("/var/lib/dehyst/", ""))
    else:
        import yaml

        assert yaml.safe_load(block.text)


def test_few_snippets_are_left_out() -> None:
    left = [b for b in blocks() if is_left_out(b)]
    assert len(left) == len(LEFT_OUT) <= MOST_LEFT_OUT
