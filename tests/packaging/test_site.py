"""The site of the pages: a broken link fails the build, and the README is its first page."""

import html
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.rigs.chromium import Chromium, needs_chromium

import dehyst

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("material") is None, reason="no mkdocs-material"
)


def build(folder: Path, extra: str) -> "subprocess.CompletedProcess[str]":
    """Build the site of these pages and one more, with this text."""
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


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a site built from pages whose links are valid."""
    folder = tmp_path_factory.mktemp("site")
    good = "[a](record.md) [b](record.md#for-weeks) [c](../daemon/main.py) [d](../README.md)"
    done = build(folder, good)
    assert done.returncode == 0, done.stderr
    return folder / "out" / "site"


def test_links_that_lead_somewhere(site: Path) -> None:
    assert (
        "The position of a piezo stage is not proportional to its voltage"
        in (site / "index.html").read_text()
    )
    page = (site / "extra.html").read_text()
    assert 'href="record.html#for-weeks"' in page
    assert "c (<code>daemon/main.py</code>)" in page
    assert 'href="index.html"' in page
    assert (site / "layouts" / "foxglove.json").exists()


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    for path in site.rglob("*.html"):
        loaded = re.findall(r"<(?:script|img|iframe)[^>]* src=\"(\w+:)?//", path.read_text())
        styles = re.findall(r"<link[^>]* href=\"\w*:?//[^>]*stylesheet", path.read_text())
        assert not loaded + styles, path


def test_the_reference_has_every_public_name_with_its_words(site: Path) -> None:
    page = (site / "api.html").read_text()
    for name in set(dehyst.__all__) - {"__version__"}:
        full = f"{dehyst.HOMES[name]}.{name}"
        assert f'id="{full}"' in page, full
    words = html.unescape(re.sub(r"<[^>]+>", "", page))
    assert "Identify one model from one or more recordings of a stage." in words
    assert "progress: Say" in words


@needs_chromium
@pytest.mark.processes
def test_the_search_finds_from_a_folder(site: Path) -> None:
    browser = Chromium()
    try:
        browser.chrome.get((site / "index.html").as_uri())
        fields = lambda: browser.chrome.find_elements("name", "query")  # noqa: E731
        (field,) = browser.until("the page has its search field", fields)
        browser.ask("document.querySelector('[for=__search]').click()")
        browser.until("the field is there", field.is_displayed)
        field.send_keys("coercive field")
        found = "Array.from(document.querySelectorAll('.md-search-result__link'), a => a.href)"
        links = browser.until("something is found", lambda: browser.ask(found))
        assert any(link.startswith("file:") and "html" in link for link in links)
    finally:
        browser.close()


def test_each_of_four_that_lead_nowhere_fails_it(tmp_path: Path) -> None:
    """One build ends with the number of its warnings, and any warning fails it."""
    links = ("record.md#no-such-heading", "../daemon/no_such.py", "nowhere.md", "/docs/record.md")
    done = build(tmp_path, " ".join(f"[a]({link})" for link in links))
    assert done.returncode != 0
    assert "Aborted with 4 warnings in strict mode" in done.stdout
    for link in links:
        place, _, heading = link.partition("#")
        assert any(
            "extra.md" in line and place in line and heading in line
            for line in done.stderr.splitlines()
        ), link
