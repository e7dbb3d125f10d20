"""What mkdocs does not know of this project: the README is the site's first page, and pages link to
files of the source tree, which the site does not hold.

A link to a page stays a link. A link to another file of the tree becomes the file's name; one to a
file that is not there is a warning, which fails a strict build.
"""

import logging
import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

log = logging.getLogger("mkdocs.hooks.dehyst")
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
DECISIONS = "# Decisions\n\nWhy it is built as it is.\n\n"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made: the tour, the change log, the list of decisions."""
    root = Path(config.config_file_path).parent
    files.append(File.generated(config, "index.md", content=(root / "README.md").read_text()))
    files.append(
        File.generated(config, "changelog.md", content=(root / "CHANGELOG.md").read_text())
    )
    lines = [
        f"- [{path.read_text().splitlines()[0].lstrip('# ')}]({path.name})\n"
        for path in sorted((root / "docs" / "decisions").glob("0*.md"))
    ]
    text = DECISIONS + "".join(lines)
    files.append(File.generated(config, "decisions/index.md", content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point every link of a page at what the site has."""
    root = Path(config.config_file_path).parent
    made = {"index.md": "", "changelog.md": ""}
    home = made.get(page.file.src_uri, posixpath.dirname(f"docs/{page.file.src_uri}"))

    def pointed(link: re.Match[str]) -> str:
        image, text, target = link.groups()
        path, mark, anchor = target.partition("#")
        if "://" in target or not path:
            return link[0]
        place = posixpath.normpath(posixpath.join(home, path))
        if place == "docs/decisions":
            place = "docs/decisions/index.md"
        names = {"README.md": "docs/index.md", "CHANGELOG.md": "docs/changelog.md"}
        place = names.get(place, place)
        inside = place.removeprefix("docs/")
        if place != inside and files.get_file_from_path(inside) is not None:
            start = posixpath.dirname(page.file.src_uri) or "."
            return f"{image}[{text}]({posixpath.relpath(inside, start)}{mark}{anchor})"
        if not (root / place).exists():
            log.warning("%s: a link to %s, which is not there", page.file.src_uri, target)
        return text if "`" in text or text == place else f"{text} (`{place}`)"

    inside_code = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
    parts = inside_code.split(markdown)
    return "".join(p if i % 2 else LINK.sub(pointed, p) for i, p in enumerate(parts))
