"""The Debian package: dpkg itself installs it below another root, its units' commands run there,
and it is removed again. Its environment is a light one: this tree's wheel, and the libraries of the
test environment; `make release` includes all of them."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from release import debian
from release.publication import maintainer
from release.steps import PROJECT
from tests.packaging.test_wheel import wheel  # noqa: F401
from tests.rigs.gateway_bench import free_port
from tests.rigs.stage_model import model_text

ROOT = Path(__file__).resolve().parents[2]
SYSTEM = debian.interpreter()
TOOLS = ("dpkg", "dpkg-deb", "systemd-sysusers", "systemd-tmpfiles")


def why_not() -> str:
    """Return why it cannot be tried here, or "" if it can."""
    if lacking := [tool for tool in TOOLS if shutil.which(tool) is None]:
        return f"no {', '.join(lacking)} here"
    if os.geteuid() != 0:
        return "dpkg --root has to be root"
    if not SYSTEM.endswith(f"python3.{sys.version_info.minor}"):
        return f"the libraries here are not those of {SYSTEM or 'a Python in /usr/bin'}"
    return ""


pytestmark = [pytest.mark.skipif(bool(why_not()), reason=why_not()), pytest.mark.timeout(600)]
DPKG = ("--force-script-chrootless", "--force-depends")
CONFIG = """
name = "bench"
model = {{file = "stage.model.toml"}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 95.0, slew_v_per_s = 10000.0}}
loop = {{rate_hz = 100.0}}
bus = {{listen = ["tcp/127.0.0.1:{port}"]}}
"""


@pytest.fixture(scope="module")
def package(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: F811
    folder = tmp_path_factory.mktemp("debian")
    place = folder / "root/opt/dehyst"
    subprocess.run([SYSTEM, "-m", "venv", "--without-pip", str(place)], check=True)
    own = place / "bin/python3"
    pip = [sys.executable, "-m", "pip", "--python", str(own), "install", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--no-compile", "--no-index", str(wheel)], check=True)
    (site,) = place.glob("lib/python3.*/site-packages")
    libraries = Path(pytest.__file__).resolve().parents[1]
    (site / "libraries.pth").write_text(f"{libraries}\n")
    return debian.package(folder / "root", own, folder)


@pytest.fixture(scope="module")
def target(package: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a root that contains only the package."""
    root = tmp_path_factory.mktemp("target")
    for name in ("var/lib/dpkg/updates", "var/lib/dpkg/info", "etc"):
        (root / name).mkdir(parents=True)
    for name in ("var/lib/dpkg/status", "etc/passwd", "etc/group"):
        (root / name).touch()
    dpkg(root, "--install", package)
    return root


def dpkg(root: Path, *words: str | Path) -> str:
    command = ["dpkg", f"--root={root}", *DPKG, *map(str, words)]
    # dpkg needs root's PATH, even if a user runs the tests
    own = {**os.environ, "PATH": f"{os.environ['PATH']}:/usr/local/sbin:/usr/sbin:/sbin"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=own)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_file_of_the_service_is_where_the_system_looks_for_it(target: Path) -> None:
    for unit in (ROOT / "systemd").glob("*.service"):
        text = (target / "usr/lib/systemd/system" / unit.name).read_text()
        assert text == unit.read_text()
        (command,) = set(re.findall(r"^ExecStart=(\S+)", text, re.M))
        assert os.access(target / command.lstrip("/"), os.X_OK)
    rules = (target / "usr/lib/udev/rules.d/70-dehyst.rules").read_text()
    assert rules == (ROOT / "systemd/70-dehyst.rules").read_text()
    assert "dehyst" in (target / "usr/share/bash-completion/completions/dehyst").read_text()
    assert os.readlink(target / "usr/bin/dehyst") == "/opt/dehyst/bin/dehyst"


def test_its_maintainer_and_home_are_those_of_the_metadata(package: Path) -> None:
    words = ["dpkg-deb", "--field", str(package)]
    control = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    fields = dict(line.split(": ", 1) for line in control.splitlines() if line[0] != " ")
    assert fields["Maintainer"] == maintainer(PROJECT)
    assert fields.get("Homepage") == PROJECT.get("urls", {}).get("Homepage")


def test_its_user_exists_and_its_configuration_is_kept_from_others(target: Path) -> None:
    users = (target / "etc/passwd").read_text().splitlines()
    (user,) = [line.split(":") for line in users if line.startswith("dehyst:")]
    found = (target / "etc/dehyst").stat()
    assert user[6].endswith("nologin")
    assert (found.st_uid, found.st_gid, found.st_mode & 0o777) == (0, int(user[3]), 0o750)
    run = (target / "run/dehyst").stat()
    assert (run.st_uid, run.st_mode & 0o777) == (int(user[2]), 0o700)


def test_nothing_in_it_names_the_place_where_it_was_built(package: Path, target: Path) -> None:
    built = str(package.parent / "root").encode()
    for path in (target / "opt").rglob("*"):
        if path.is_file() and not path.is_symlink():
            assert built not in path.read_bytes(), path
    assert (target / "opt/dehyst/bin/dehyst").read_text().startswith("#!/opt/dehyst/bin/python3")


def run(target: Path, words: str, **environment: str) -> "subprocess.Popen[str]":
    """Start a unit's command, with the root's own Python and configuration."""
    command = words.replace("/etc/dehyst", str(target / "etc/dehyst")).split()
    return subprocess.Popen(
        [str(target / "opt/dehyst/bin/python3"), "-m", "dehyst.daemon.main", *command],
        cwd=target, env={"PATH": os.environ["PATH"], **environment}, text=True,
        stdin=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def commands(target: Path, unit: str, key: str) -> str:
    text = (target / f"usr/lib/systemd/system/{unit}.service").read_text()
    (words,) = re.findall(rf"^{key}=/opt/dehyst/bin/dehyst (.*)$", text, re.M)
    return str(words)


def test_the_commands_of_its_units_run(target: Path, tmp_path: Path) -> None:
    """Run the gateway, with a socket in place of systemd, and the command that makes the output
    safe: both compile little. The loop runs in the demonstration of `make release`."""
    (target / "etc/dehyst/stage.toml").write_text(CONFIG.format(port=free_port()))
    (target / "etc/dehyst/stage.model.toml").write_text(model_text())
    folder, reported = str(tmp_path / "run"), str(tmp_path / "reported")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(reported)
        manager.settimeout(200.0)
        words = commands(target, "dehyst-gateway", "ExecStart")
        gateway = run(target, words, RUNTIME_DIRECTORY=folder, NOTIFY_SOCKET=reported)
        try:
            while b"READY=1" not in manager.recv(4096):
                assert gateway.poll() is None
        finally:
            gateway.send_signal(signal.SIGTERM)
            _, said = gateway.communicate(timeout=60)
    assert gateway.returncode == 0, said
    safe = run(target, commands(target, "dehyst", "ExecStopPost"), RUNTIME_DIRECTORY=folder)
    _, said = safe.communicate(timeout=120)
    assert safe.returncode == 0, said


def test_removed_it_leaves_what_is_the_users(target: Path) -> None:
    mine = target / "etc/dehyst/mine.toml"
    mine.write_text("# mine\n")
    dpkg(target, "--remove", "dehyst")
    assert mine.exists()
    assert not list((target / "usr").rglob("*dehyst*"))
    assert not list((target / "opt").rglob("*.py"))
