"""Check whether this tree has a public home. One file has all of its addresses: pyproject.toml.

The metadata of the package and of the Debian package take them from there, and CONTRIBUTING.md and
SECURITY.md refer their readers to that metadata. A release without them is complete for whoever
builds it, but nobody else could report a vulnerability in it.
"""

import re
from collections.abc import Mapping
from typing import Any

URLS = ("Homepage", "Source", "Issues", "Security")
"""Required in [project.urls]; Security: where a vulnerability is reported in private."""
RESERVED = re.compile(
    r"(^|[/@.])(example\.(com|net|org)|localhost|[\w-]+\.(example|invalid|test|localhost))([:/]|$)"
)
"""Names reserved for documentation and tests (RFC 2606 and 6761)."""
BUILDER = "The dehyst authors <root@localhost>"
"""Maintainer of a package built only for this machine: its administrator."""


def lacking(project: Mapping[str, Any], changes: str) -> list[str]:
    """Return what [project] of pyproject.toml and CHANGELOG.md (changes: its text) lack for a
    publication, one line each."""
    urls = project.get("urls", {})
    found = [_judge(f"[project.urls] {name}", urls.get(name, ""), "https://") for name in URLS]
    people = project.get("maintainers", [])
    email = people[0].get("email", "") if people else ""
    found.append(_judge("[project] maintainers, an email", email, ""))
    if re.search(r"^## \[Unreleased\]\s+(?!## )\S", changes, re.M):
        found.append("CHANGELOG.md: lines under [Unreleased] belong to the version")
    return [line for line in found if line]


def _judge(key: str, address: str, begins: str) -> str:
    """Return "" if the address may be published, else what is wrong with it."""
    if not address:
        return f"{key}: is missing"
    if not address.startswith(begins):  # package indexes refuse mailto:
        return f"{key}: {address} does not begin with {begins}"
    if RESERVED.search(address):
        return f"{key}: {address} is a placeholder"
    return ""


def maintainer(project: Mapping[str, Any]) -> str:
    """Return the first of [project] maintainers as `name <email>`; BUILDER if there is none."""
    for one in project.get("maintainers", []):
        return f"{one['name']} <{one['email']}>"
    return BUILDER
