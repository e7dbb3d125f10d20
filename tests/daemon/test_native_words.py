"""What a user reads is in the words of the field: a list of words that were used for others.

README, docs, the help of every command, the texts of messages, reports, set-up and physics, and the
files that come with them: examples, units, the page.
Docstrings and comments inside the code are not looked at.
"""

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import ROOT

from dehyst.daemon.main import COMMANDS, build_parser

BANNED = {
    r"foretell\w*|foretold": "predict",
    r"tell|tells|told|telling": "report, say, distinguish, show",
    r"heed|heeds|heeded|heeding": "depend on, respect",
    r"mend|mends|mended|mending": "repair, correct",
    r"reckon\w*": "compute, expect",
    r"handed out|hands out|hand out": "issue, return",
    r"so long|so many|so much": "this long, this many, as much",
    r"makes? way|gives? way": "ends, is deleted, yields",
    r"behoo?ves?|whither|thereof|therein|hitherto|henceforth": "plain words",
    r"beside": "next to, in addition to, with",
    r"stands? at|stood at|as it stands": "is at, as it is",
    r"anew|to and fro": "again, back and forth",
    r"beyond belief": "implausible",
    r"go(es)? to work": "is put to use",
    r"turn(s|ed)? round": "reverse",
    r"all the same": "nevertheless",
    r"without a word": "silently",
    r"(to|for|of) who (asks|wants)": "whoever, optional",
    r"in vain": "without success",
}
"""Pattern -> what to write instead."""
BEHIND = re.compile(r"\bbehind\b(?![^.;:|]{0,60}\b(proxy|nginx|firewall))", re.I)
"""`behind` for after; a page may be behind a proxy."""
WRITTEN = ("measured.md", "noticed.md")
"""Docs made by benchmarks and by the list of mistakes, in the words of tests."""
TEXTS = ("daemon", "models", "drivers")


def wrong_words(text: str) -> list[str]:
    """The banned words of a text, with what is around them."""
    found = [
        f"{text[max(0, m.start() - 30) : m.end() + 30]!r}: write {instead}"
        for pattern, instead in BANNED.items()
        for m in re.finditer(rf"\b({pattern})\b", text, re.I)
    ]
    return found + [
        f"{text[max(0, m.start() - 30) : m.end() + 30]!r}: write after, connected to, with"
        for m in BEHIND.finditer(text)
    ]


def prose(path: Path) -> str:
    """A page without its code."""
    text = re.sub(r"```.*?```", "", path.read_text(), flags=re.S)
    return re.sub(r"`[^`\n]*`", "", text)


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in WRITTEN], ids=lambda p: p.name)
def test_docs_are_in_the_words_of_the_field(page: Path) -> None:
    assert wrong_words(prose(page)) == []


SHIPPED = [
    *sorted((ROOT / "docs" / "examples").iterdir()),
    *sorted((ROOT / "systemd").iterdir()),
    ROOT / "daemon" / "page" / "static" / "index.html",
]


@pytest.mark.parametrize("file", [p for p in SHIPPED if p.is_file()], ids=lambda p: p.name)
def test_files_that_users_get_are_in_the_words_of_the_field(file: Path) -> None:
    assert wrong_words(file.read_text()) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_in_the_words_of_the_field(command: str) -> None:
    parser: argparse.ArgumentParser = build_parser(command).commands[command]
    assert wrong_words(parser.format_help()) == []


def messages(path: Path) -> Iterator[str]:
    """Texts of more than one word in a source file, docstrings left out; of an f-string its fixed
    parts."""
    tree = ast.parse(path.read_text())
    bare = {id(s.value) for s in ast.walk(tree) if isinstance(s, ast.Expr)}
    for node in ast.walk(tree):
        text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if text and id(node) not in bare and " " in node.value.strip():
            yield node.value


@pytest.mark.parametrize("room", TEXTS)
def test_messages_are_in_the_words_of_the_field(room: str) -> None:
    found = {
        str(path.relative_to(ROOT)): wrong
        for path in sorted((ROOT / room).rglob("*.py"))
        if (wrong := [w for text in messages(path) for w in wrong_words(text)])
    }
    assert found == {}


def test_configuration_is_described_in_the_words_of_the_field() -> None:
    """Docstrings of the configuration's keys are read: in the file, and in the reference."""
    assert wrong_words((ROOT / "daemon" / "config" / "sections.py").read_text()) == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("it foretells another one", 1),
        ("Told apart from creep", 1),
        ("the repetition makes way", 1),
        ("a page behind a reverse proxy", 0),
        ("a simulated stage behind", 1),
        ("the daemon reports the error", 0),
        ("mended for so long", 2),
        ("storytelling", 0),
        ("the drive stands at 3 V without a word", 2),
    ],
)
def test_a_wrong_word_is_found(text: str, wrong: int) -> None:
    assert len(wrong_words(text)) == wrong
