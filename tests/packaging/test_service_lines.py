"""The README's commands that install and remove the service, run as root in a private mount
namespace: /etc and /var are overlays, /opt and /run are empty, and nothing outlives the test.

pip's own installation and the compilation of the kernels take minutes and are tested separately
(test_wheel.py, test_kernel_cache.py); a namespace has neither udev nor systemd, so nothing is
started (`--now`). Everything else is the real tool.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()
TOOLS = ("unshare", "setpriv", "systemctl", "systemd-sysusers", "systemd-tmpfiles", "userdel")
PRIVATE = """
set -eu
mount -t tmpfs private "$1"
for place in etc var; do
    mkdir "$1/$place" "$1/$place-work"
    layers="lowerdir=/$place,upperdir=$1/$place,workdir=$1/$place-work"
    mount -t overlay "$place" -o "$layers" "/$place"
done
mount -t tmpfs private /opt
mount -t tmpfs private /run
"""
PLACES = {
    "python3 -m venv /opt/dehyst && /opt/dehyst/bin/pip install .": "mkdir -p /opt/dehyst/bin && "
    'printf \'#!/bin/sh\\nexec "$PYTHON" -P -m dehyst.daemon.main "$@"\\n\''
    " > /opt/dehyst/bin/dehyst && chmod 0755 /opt/dehyst/bin/dehyst",
    "/opt/dehyst/bin/dehyst warm": "/opt/dehyst/bin/dehyst warm --help > /dev/null",
    "udevadm control --reload && udevadm trigger": "true",
    "enable --now": "enable",
}
CHECKS = """
[ "$(stat -c '%U %G %a' /etc/dehyst/stage.toml)" = "root dehyst 640" ]
[ "$(stat -c '%U %G %a' /run/dehyst)" = "dehyst dehyst 700" ]
setpriv --reuid dehyst --regid dehyst --clear-groups cat /etc/dehyst/*.toml > /dev/null
setpriv --reuid nobody --regid nogroup --clear-groups cat /etc/dehyst/stage.toml && exit 8
[ -L /etc/systemd/system/multi-user.target.wants/dehyst.service ]
cmp systemd/70-dehyst.rules /etc/udev/rules.d/70-dehyst.rules
systemd-analyze verify --man=no /etc/systemd/system/dehyst*.service 2>&1 | grep dehyst && exit 9
"""
GONE = """
[ -z "$(find /etc /opt /var/lib -name '*dehyst*')" ]
! getent passwd dehyst
"""


def why_not() -> str:
    """Return why it cannot be tried here, or "" if it can."""
    if lacking := [tool for tool in TOOLS if shutil.which(tool) is None]:
        return f"no {', '.join(lacking)} here"
    if os.geteuid() != 0:
        return "a mount namespace needs root"
    tried = subprocess.run(
        ["unshare", "--mount", "sh", "-c", PRIVATE, "-", "/mnt"], capture_output=True, text=True
    )
    return tried.stderr.strip()


REASON = why_not()


def install() -> str:
    """Return the README's block, with the steps that take minutes or need udev replaced."""
    found = re.search(r"## Run it as a service\n\n```\n(.*?)```", README, re.S)
    assert found
    text = found[1]
    for old, new in PLACES.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def recorder() -> str:
    """Return commands that add the unit of docs/record.md to the others."""
    found = re.search(r"```ini\n(.*?)```", (ROOT / "docs" / "record.md").read_text(), re.S)
    assert found
    return f"cat > /etc/systemd/system/dehyst-record.service << 'END'\n{found[1]}END"


def remove() -> str:
    """Return the README's instructions for removing the service, as commands."""
    found = re.search(r"To remove the service, (.*?)\n\n", README, re.S)
    assert found
    disable, *places, last = re.findall(r"`([^`]*)`", found[1])
    whole = [place for place in places if place.endswith("/dehyst")]
    below = [place for place in places if place.startswith("/") and place not in whole]
    assert len(whole) == 2
    assert len(below) == 4
    return "\n".join(
        [
            disable.replace(" --now", ""),
            f"rm -r {' '.join(whole)}",
            f"find {' '.join(below)} -name '*dehyst*' -delete",
            last,
        ]
    )


@pytest.mark.skipif(bool(REASON), reason=REASON)
def test_the_lines_of_the_readme_install_the_service_and_remove_it(tmp_path: Path) -> None:
    (tmp_path / "systemd").symlink_to(ROOT / "systemd")
    (tmp_path / "stage-1").mkdir()
    for name in ("stage.toml", "stage.model.toml"):
        (tmp_path / "stage-1" / name).write_text(f'name = "{name}"\n')
    lines = [PRIVATE, "set -x", install(), recorder(), CHECKS, remove(), GONE]
    path = os.pathsep.join([*os.environ["PATH"].split(os.pathsep), "/usr/sbin", "/sbin"])
    done = subprocess.run(
        ["unshare", "--mount", "bash", "-c", "\n".join(lines), "-", "/mnt"],
        cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False,
        env={
            "PATH": path, "PYTHON": sys.executable, "PYTHONPATH": str(ROOT / "src"),
            "SYSTEMD_OFFLINE": "1", "LANG": "C",
        },
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
