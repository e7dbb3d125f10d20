"""The site of the pages: a link that leads nowhere fails it, and the README is its first page."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("material") is None, reason="no mkdocs-material"
)


def build(folder: Path, extra: str) -> "subprocess.CompletedProcess[str]":
    """The site of these pages and one more, with this text."""
    for name in ("docs", "mkdocs.yml"):
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    for path in ROOT.iterdir():
        if not (folder / path.name).exists() and path.name[:1] != "." and path.name != "out":
            (folder / path.name).symlink_to(path)
    (folder / "docs" / "extra.md").write_text(f"# Extra\n\n{extra}\n")
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build"],
        cwd=folder, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def test_links_that_lead_somewhere(tmp_path: Path) -> None:
    good = "[a](record.md) [b](record.md#for-weeks) [c](../daemon/main.py) [d](../README.md)"
    done = build(tmp_path, good)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "out" / "site"
    assert "A piezo stage does not go where its voltage says" in (site / "index.html").read_text()
    page = (site / "extra.html").read_text()
    assert 'href="record.html#for-weeks"' in page
    assert "c (<code>daemon/main.py</code>)" in page
    assert 'href="index.html"' in page
    assert (site / "layouts" / "foxglove.json").exists()


@pytest.mark.parametrize(
    "link", ["record.md#no-such-heading", "../daemon/no_such.py", "nowhere.md", "/docs/record.md"]
)
def test_one_that_does_not(tmp_path: Path, link: str) -> None:
    done = build(tmp_path, f"[a]({link})")
    assert done.returncode != 0
    assert "extra.md" in done.stderr
    assert "strict" in done.stderr
