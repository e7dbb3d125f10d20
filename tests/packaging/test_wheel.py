"""The wheel: built, installed in a clean environment, and compared with the tree."""

import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = {"daemon": ROOT / "daemon", "drivers": ROOT / "drivers", "models": ROOT / "models"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build from a copy of the tree: setuptools would pack files that an older build/ contains."""
    folder = tmp_path_factory.mktemp("wheel")
    tree = folder / "tree"
    unwanted = shutil.ignore_patterns(".*", "build", "dist", "out", "tests", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=unwanted)
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(tree)],
        check=True,
        capture_output=True,
        timeout=300,
    )
    return next(folder.glob("*.whl"))


def expected_files() -> set[str]:
    faces = ("__init__.py", "__init__.pyi", "bluesky.py", "client.py", "ophyd.py", "py.typed")
    files = {f"dehyst/{name}" for name in faces}
    for name, folder in ROOMS.items():
        for path in [*folder.rglob("*.py"), *folder.rglob("*.toml"), *folder.glob("*/static/*")]:
            if "__pycache__" not in path.parts:
                files.add(f"dehyst/{name}/{path.relative_to(folder).as_posix()}")
    return files


@pytest.mark.timeout(400)
def test_the_wheel_holds_the_tree_and_nothing_at_top_level_but_dehyst(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = {n for n in archive.namelist() if not n.endswith("/")}
    modules = {n for n in names if ".dist-info/" not in n}
    assert modules == expected_files()
    assert {n.split("/")[0] for n in names} == {
        "dehyst",
        next(n for n in names if ".dist-info/" in n).split("/")[0],
    }
    assert any(n.endswith("licenses/LICENSE") for n in names)


@pytest.mark.timeout(400)
def test_it_runs_from_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    """A new environment sees the libraries of this one, but only the wheel's dehyst."""
    venv.create(tmp_path / "env")
    python = tmp_path / "env/bin/python"
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps",
         "--no-index", str(wheel)],
        check=True,
        capture_output=True,
        timeout=200,
    )  # fmt: skip
    site = next((tmp_path / "env/lib").glob("python3*/site-packages"))
    top = {p.name for p in site.iterdir()}
    assert not top & {"daemon", "drivers", "models"}
    # the libraries, without this environment's editable dehyst
    libraries = Path(pytest.__file__).resolve().parents[1]
    code = (
        f"import sys; sys.path.append({str(libraries)!r}); import dehyst.models.modelfile as m; "
        f"import dehyst.daemon.main as d; print(m.__file__); "
        f"print(m.shipped('paper-eq12').hysteresis.n); d.main(['drivers'])"
    )
    done = subprocess.run(
        [str(python), "-I", "-c", code],
        cwd=tmp_path, capture_output=True, text=True, timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert str(tmp_path) in done.stdout.splitlines()[0]
    assert done.stdout.splitlines()[1] == "10"
    for driver in ("mdt693b", "ksg101", "simulated", "nidaqmx", "labjack", "iio", "python"):
        assert driver in done.stdout
