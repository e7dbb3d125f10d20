"""What a release says of itself: one version, every dependency pinned with a hash, its words."""

import re
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version
from release.steps import IMAGE, IMAGE_PYTHON, PROJECT, ROOT, SERVICE, VERSION

import dehyst

MOST_LINES = 60
ENTRY = re.compile(
    r"^([\w.-]+)==(\S+)(?: ; ([^\\]*))? \\\n((?:    --hash=sha256:[0-9a-f]{64}.*\n?)+)", re.M
)


def pinned(path: Path) -> dict[str, list[Version]]:
    found: dict[str, list[Version]] = {}
    for name, version, _, _ in ENTRY.findall(path.read_text()):
        found.setdefault(name, []).append(Version(version))
    return found


@pytest.mark.parametrize("path", [SERVICE, IMAGE], ids=lambda path: path.stem)
def test_every_dependency_is_pinned_to_a_version_that_it_takes(path: Path) -> None:
    extras = PROJECT["optional-dependencies"]["epics"] if path == SERVICE else []
    found = pinned(path)
    for words in [*PROJECT["dependencies"], *extras]:
        wanted = Requirement(words)
        versions = found[wanted.name.lower().replace("_", "-")]
        assert all(version in wanted.specifier for version in versions), words


@pytest.mark.parametrize("path", [SERVICE, IMAGE], ids=lambda path: path.stem)
def test_nothing_is_listed_without_a_hash(path: Path) -> None:
    listed = [line for line in path.read_text().splitlines() if line[:1].strip()]
    assert len(listed) == sum(map(len, pinned(path).values())) > 30


def test_the_image_takes_the_list_that_was_made_for_its_python() -> None:
    text = (ROOT / "Containerfile").read_text()
    assert text.count(f"python:{IMAGE_PYTHON}-slim") == text.count("FROM ") == 2
    assert "--require-hashes -r /wheels/constraints-image.txt" in text


def test_one_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert VERSION == dehyst.__version__ == cited["version"]
    assert {"cff-version", "message", "title", "authors"} <= cited.keys()
    assert cited["references"][0]["doi"] == "10.3390/mi8040114"
    day = cited["date-released"]
    assert f"## [{VERSION}] - {day}" in (ROOT / "CHANGELOG.md").read_text()


def test_what_is_new_in_it_can_be_read() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    part = text[text.index(f"## [{VERSION}]") :].split("\n## ")[0]
    assert len(part.splitlines()) <= MOST_LINES
    assert "### What you get" in part
    assert "### What breaks" in part
