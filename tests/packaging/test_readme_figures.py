"""Each figure of the README's table stands in the section of docs/ that its row links to."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TABLE = re.search(r"^## Figures$(.*?)^## ", (ROOT / "README.md").read_text(), re.S | re.M)
assert TABLE is not None
ROWS = re.findall(r"^\| (.*?) \| (.*?) \|$", TABLE[1], re.M)[2:]
NUMBER = re.compile(r"\d+(?: \d{3})*(?:\.\d+)?")


def section(link: str) -> str:
    """Return the text behind a link: a page, or from a heading to the next of the same level."""
    page, _, anchor = link.partition("#")
    text = (ROOT / page).read_text()
    if not anchor:
        return text
    for part in re.split(r"^## ", text, flags=re.M):
        if re.sub(r"[^a-z0-9-]", "", part.partition("\n")[0].lower().replace(" ", "-")) == anchor:
            return part
    raise AssertionError(f"{page} has no section {anchor}")


def test_the_table_has_rows() -> None:
    assert len(ROWS) >= 5
    assert all(NUMBER.search(figures) for _, figures in ROWS)


@pytest.mark.parametrize(("what", "figures"), ROWS, ids=[what[:40] for what, _ in ROWS])
def test_each_figure_is_one_that_was_measured(what: str, figures: str) -> None:
    link = re.search(r"\]\((docs/[^)]*)\)", what)
    assert link is not None, "the row does not say where its figures are from"
    known = set(NUMBER.findall(section(link[1])))
    assert [n for n in NUMBER.findall(figures) if n not in known] == []
