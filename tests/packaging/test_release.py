"""What a release says of itself: one version, a hash for every pinned dependency, its wording."""

import re
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version
from release.__main__ import main
from release.publication import BUILDER, URLS, lacking, maintainer
from release.steps import IMAGE, IMAGE_PYTHON, PROJECT, ROOT, SERVICE, VERSION

import dehyst

MOST_LINES = 60
HOME = {
    "urls": {name: f"https://code.institute.edu/dehyst/{name.lower()}" for name in URLS},
    "maintainers": [{"name": "A Person", "email": "person@institute.edu"}],
}
TEXTS = (".md", ".toml", ".cff", ".py", ".yml", ".service", ".conf")
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


def newest_release() -> str:
    """Return this version, or between two releases the one before: 0.3.0.dev0 follows 0.2.0."""
    releases = re.findall(r"^## \[(\d[\d.]*)\] - ", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert Version(VERSION).is_devrelease == (VERSION not in releases)
    assert Version(VERSION) >= Version(releases[0]) == max(map(Version, releases))
    return releases[0]


def test_one_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert dehyst.__version__ == VERSION
    assert cited["version"] == newest_release()
    assert {"cff-version", "message", "title", "authors"} <= cited.keys()
    assert cited["references"][0]["doi"] == "10.3390/mi8040114"
    day = cited["date-released"]
    assert f"## [{newest_release()}] - {day}" in (ROOT / "CHANGELOG.md").read_text()


def test_what_is_new_in_it_can_be_read() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    part = text[text.index(f"## [{newest_release()}]") :].split("\n## ")[0]
    assert len(part.splitlines()) <= MOST_LINES
    assert "### What you get" in part
    assert "### What breaks" in part


def test_a_tree_without_a_public_home_is_not_published(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("release.__main__.PROJECT", {})
    assert main(["--publish"]) == 1
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert all(f"[project.urls] {name}: is missing" in said for name in URLS)
    assert "docs/releases.md#publish" in said
    assert "\n## Publish\n" in (ROOT / "docs/releases.md").read_text()


@pytest.mark.parametrize("name", URLS)
def test_every_address_has_to_be_somebodys(name: str) -> None:
    assert lacking(HOME, "") == []
    for address, word in {
        "": "is missing",
        "https://example.org/dehyst": "is a placeholder",
        "https://user@example.com/dehyst": "is a placeholder",
        "mailto:person@institute.edu": "does not begin with https://",
        "https://dehyst.example/issues": "is a placeholder",
        "https://localhost:8000": "is a placeholder",
    }.items():
        (line,) = lacking({**HOME, "urls": {**HOME["urls"], name: address}}, "")  # type: ignore[dict-item]
        assert name in line
        assert word in line


def test_the_maintainer_is_the_one_in_the_metadata_or_the_machines_administrator() -> None:
    assert maintainer(HOME) == "A Person <person@institute.edu>"
    assert maintainer({}) == BUILDER
    (line,) = lacking({**HOME, "maintainers": [{"name": "A Person", "email": "me@localhost"}]}, "")
    assert "is a placeholder" in line


def test_no_text_names_a_home_that_nobody_has() -> None:
    rooms = ("daemon", "drivers", "models", "docs", "release", "systemd")
    files = [path for room in rooms for path in (ROOT / room).rglob("*") if path.suffix in TEXTS]
    files += [path for path in ROOT.iterdir() if path.suffix in TEXTS]
    link = re.compile(r"(?:https?://|mailto:|\w@)\S*example\.(?:com|net|org)\S*")
    found = [
        f"{path.relative_to(ROOT)}: {one}"
        for path in files
        for one in link.findall(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)


def test_changes_that_no_version_lists_are_not_published() -> None:
    version = "## [0.3.0] - 2027-01-01\n\n- One.\n"
    assert lacking(HOME, f"## [Unreleased]\n\n{version}") == []
    (line,) = lacking(HOME, f"## [Unreleased]\n\n- Another.\n\n{version}")
    assert line.startswith("CHANGELOG.md: ")
