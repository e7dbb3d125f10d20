"""Windows and macOS: everything except the loop runs there.

The modules and names that another system lacks according to typeshed are removed from dehyst in a
fresh interpreter, and each command runs to its end. Commands that need Linux say so in one line.
"""

import ast
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.packaging.other_names import LOOKED_AT, OF_UNIX, missing
from tests.rigs.gateway_bench import Bench, free_port

from dehyst.daemon.bench.simulated import exploring_drive
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.main import COMMANDS, NEEDS_LINUX
from dehyst.drivers.simulated.stage import SimulatedStage

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("daemon", "drivers", "models")
ONLY_LINUX = (
    *("daemon/loop/", "daemon/service/", "daemon/gateway/", "daemon/latency/", "daemon/rings/"),
    *("daemon/demo/", "daemon/doctor/", "drivers/emulated/", "drivers/iio/"),
    *("daemon/commands/doctor.py", "daemon/commands/emulate.py"),
    "daemon/main.py",  # checks the system first
    "daemon/log_lines.py",  # only for long-running processes
    "daemon/notify.py",  # for systemd
    "daemon/terminal/keys.py",  # supports both consoles
    "drivers/serial_port.py",  # its ports are files
    "drivers/system.py",
)
"""Files that may use a name that Windows lacks."""
OFFLINE = (
    "identify run.csv -o found.toml --report report",
    "validate stage.toml another.csv",
    "simulate stage.toml run.csv -o out.csv",
    "invert stage.toml scan.csv -o drive.csv",
    "diagnose another.csv --model stage.toml -o findings",
    "convert run.csv run.mcap",
    "convert run.h5 from-h5.npz",
    "excite --range 0 100 --band 5 --duration 4 --slew 2000 -o excite.csv",
    "scan spiral --radius 2.5 --pitch 0.5 --center 8 8 -o path.csv",
    "config init --range 0 100 -o new.toml",
    "drivers",
    "keys certificates --controller stage --host localhost",
    "completion bash",
    "--version",
)
CLIENTS = (
    "status",
    "watch --for 1",
    "send 6 --for 0.5",
    "play scan.csv",
    "record -o recorded.csv --for 0.5",
    "doctor",
    "zero",
)
ON_BOTH = ("convert", "config", "drivers", "status", "send", "record")
MAY_END_WITH = dict.fromkeys(("validate", "diagnose", "status", "zero"), (0, 1))
"""1: a finding."""


def test_names_that_windows_does_not_have_stand_in_one_module() -> None:
    there = {name: set(found) for name, found in missing("win32").items()}
    found = []
    for path in sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(ONLY_LINUX):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                used = [alias.name for alias in node.names if alias.name in OF_UNIX]
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                used = [ast.unparse(node)] if node.attr in there.get(node.value.id, ()) else []
            else:
                continue
            found += [f"{name}:{node.lineno}: {one}" for one in used]
    assert not found, "\n".join(found)


def test_typeshed_knows_what_is_missing() -> None:
    """Otherwise the tests here would remove nothing."""
    windows, macos = missing("win32"), missing("darwin")
    assert {"geteuid", "O_NOFOLLOW", "sched_getaffinity"} <= set(windows["os"])
    assert {"SIGHUP", "SIGKILL"} <= set(windows["signal"])
    assert "memfd_create" in macos["os"]
    assert "geteuid" not in macos["os"]
    assert set(windows) == set(LOOKED_AT)


class Elsewhere:
    """A folder with recordings and a model, and dehyst on another system."""

    def __init__(self, platform: str, folder: Path) -> None:
        self.platform, self.folder = platform, folder
        what = {
            "platform": platform,
            "modules": OF_UNIX if platform == "win32" else (),
            "names": missing(platform),
        }
        path = (ROOT / "tests/packaging/other_system", ROOT / "src")
        self.env = os.environ | {
            "OTHER_SYSTEM": json.dumps(what),
            "PYTHONPATH": os.pathsep.join(map(str, path)),
            "MPLBACKEND": "Agg",
        }

    def start(self, *arguments: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-P", *arguments],
            cwd=self.folder, env=self.env, text=True, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def run(self, *arguments: str) -> tuple[int, str]:
        """Return the exit status and all printed output."""
        process = self.start(*arguments)
        out, err = process.communicate(timeout=250)
        return process.returncode, out + err

    def dehyst(self, command: str) -> tuple[int, str]:
        return self.run("-m", "dehyst.daemon.main", *command.split())


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Yield a daemon on Linux, with the files that offline commands read."""
    made = Bench(tmp_path_factory.mktemp("systems"))
    folder = made.path.parent
    for name, seconds in (("run", 12.0), ("another", 6.0)):
        t_s, volts = exploring_drive(seconds=seconds)
        _, reading = SimulatedStage(None).run(t_s, volts)
        columns = {"u_v": np.concatenate([[0.0], volts[:-1]]), "y_um": reading}
        write_recording(folder / f"{name}.csv", t_s, columns, {})
    with h5py.File(folder / "run.h5", "w") as file:
        for name, values in {"t_s": t_s, **columns}.items():
            file[name] = values
    (folder / "model.toml").rename(folder / "stage.toml")
    (folder / "model.toml").write_text((folder / "stage.toml").read_text())
    t_s = np.arange(0.0, 1.0, 0.01)
    um = 5.0 + 2.0 * np.sin(np.pi * t_s)
    rows = "".join(f"{t:.2f},{y:.4f}\n" for t, y in zip(t_s, um, strict=True))
    (folder / "scan.csv").write_text("t_s,target_um\n" + rows)
    try:
        made.start_gateway()
        made.client().close()
        yield made
    finally:
        made.close()


@pytest.fixture(scope="module", params=["win32", "darwin"])
def elsewhere(request: pytest.FixtureRequest, bench: Bench) -> Elsewhere:
    given, folder = bench.path.parent, bench.path.parent / request.param
    folder.mkdir()
    for path in given.iterdir():
        if path.is_file():
            shutil.copy(path, folder)
    made = Elsewhere(request.param, folder)
    made.env |= {"DEHYST_CONNECT": bench.address}
    return made


def test_what_is_taken_away_is_away(elsewhere: Elsewhere) -> None:
    """They are missing for dehyst only."""
    program = (
        "import fcntl, os, sys\n"
        "import dehyst.drivers.system as system\n"
        "print(sys.platform, system.sys.platform, system.LINUX, system.MODES,\n"
        "      hasattr(os, 'memfd_create'), hasattr(system.os, 'memfd_create'))\n"
    )
    modes = elsewhere.platform == "darwin"
    expected = f"linux {elsewhere.platform} False {modes} True False\n"
    assert elsewhere.run("-c", program) == (0, expected)


def test_all_of_the_library_is_imported(elsewhere: Elsewhere) -> None:
    program = "import dehyst; print([getattr(dehyst, name) for name in dehyst.__all__] and 'all')"
    assert elsewhere.run("-c", program) == (0, "all\n")


def test_a_configuration_names_its_run_folder_without_a_users_number(elsewhere: Elsewhere) -> None:
    """The default of `run_dir` holds the number of the user, which Windows does not have."""
    assert elsewhere.dehyst("config init --range 0 100 -o named.toml")[0] == 0
    program = (
        "import os\n"
        "from pathlib import Path\n"
        "from dehyst.daemon.config import load_config\n"
        "for name in ('RUNTIME_DIRECTORY', 'XDG_RUNTIME_DIR'):\n"
        "    os.environ.pop(name, None)\n"
        "print(load_config(Path('named.toml')).directory.name)\n"
    )
    number = 0 if elsewhere.platform == "win32" else os.geteuid()
    code, said = elsewhere.run("-c", program)
    assert (code, said.startswith(f"dehyst-{number}-")) == (0, True), said


@pytest.mark.parametrize("command", [*OFFLINE, *CLIENTS])
def test_a_command_runs_to_its_end(elsewhere: Elsewhere, command: str) -> None:
    if elsewhere.platform == "darwin" and command.split()[0] not in ON_BOTH:
        pytest.skip("macOS has what Windows has not, but for what these use")
    code, said = elsewhere.dehyst(command)
    assert code in MAY_END_WITH.get(command.split()[0], (0,)), said
    assert "Traceback" not in said
    for name in re.findall(r"-o (\S+)", command):
        assert (elsewhere.folder / name).exists()


def test_the_page_is_served(elsewhere: Elsewhere) -> None:
    port = free_port()
    page = elsewhere.start("-m", "dehyst.daemon.main", "page", "--listen", f"127.0.0.1:{port}")
    try:
        assert page.stderr is not None
        said = page.stderr.readline()
        assert said.startswith("dehyst page: http"), said + page.stderr.read()
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=30) as answer:
            assert b"dehyst" in answer.read()
    finally:
        page.send_signal(signal.SIGTERM)
        _, said = page.communicate(timeout=60)
    assert page.returncode == 0
    assert "Traceback" not in said


def test_what_needs_linux_says_so_in_one_line(elsewhere: Elsewhere) -> None:
    """All of them run in one interpreter."""
    lines = [*([name] for name in sorted(NEEDS_LINUX)), ["config", "pin"]]
    lines.append(["doctor", "--config", "stage.toml"])
    program = (
        "import sys\nfrom dehyst.daemon.main import main\n"
        f"print([main(line) for line in {lines!r}])\n"
    )
    code, said = elsewhere.run("-c", program)
    assert code == 0
    refused, codes = said.splitlines()[1:], said.splitlines()[0]
    assert codes == str([2] * len(lines))
    assert len(refused) == len(lines)
    for (name, *_), line in zip(lines, refused, strict=True):
        assert line.startswith(f"dehyst {name}: needs Linux, for the loop's deadlines")


def test_every_command_runs_or_says_that_it_needs_linux() -> None:
    """The page and the servers of other protocols are excluded: they run until they are ended."""
    run = {command.split()[0] for command in (*OFFLINE, *CLIENTS)}
    served = {"page", "epics", "serve"}
    decided = {"accept", "reject", "warm", "paper", "image", "bench"}  # like the similar commands
    assert set(COMMANDS) <= run | served | decided | NEEDS_LINUX
