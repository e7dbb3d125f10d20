"""Whether this tree names a public home. One file has all of its addresses: pyproject.toml.

The metadata of the package and of the Debian package take them from there, and CONTRIBUTING.md and
SECURITY.md send their readers to that metadata. A release without them is complete for whoever
builds it, but nobody else could report a weakness of it.
"""

import re
from collections.abc import Mapping
from typing import Any

URLS = ("Homepage", "Source", "Issues", "Security")
"""Required in [project.urls]; Security: where a weakness is reported in private."""
RESERVED = re.compile(
    r"(^|[/@.])(example\.(com|net|org)|localhost|[\w-]+\.(example|invalid|test|localhost))([:/]|$)"
)
"""Names that belong to nobody (RFC 2606 and 6761)."""
BUILDER = "The dehyst authors <root@localhost>"
"""Maintainer of a package that was built for this machine alone: its administrator."""


def lacking(project: Mapping[str, Any], changes: str) -> list[str]:
    """What [project] of pyproject.toml and CHANGELOG.md (changes: its text) lack for a publication,
    a line each."""
    urls = project.get("urls", {})
    found = [_judge(f"[project.urls] {name}", urls.get(name, ""), "https://") for name in URLS]
    people = project.get("maintainers", [])
    email = people[0].get("email", "") if people else ""
    found.append(_judge("[project] maintainers, an email", email, ""))
    if re.search(r"^## \[Unreleased\]\s+(?!## )\S", changes, re.M):
        found.append("CHANGELOG.md: lines under [Unreleased] belong to the version")
    return [line for line in found if line]


def _judge(key: str, address: str, begins: str) -> str:
    """ "" where the address may be published, else what is wrong with it."""
    if not address:
        return f"{key}: is missing"
    if not address.startswith(begins):  # package indexes refuse mailto:
        return f"{key}: {address} does not begin with {begins}"
    if RESERVED.search(address):
        return f"{key}: {address} is a placeholder"
    return ""


def maintainer(project: Mapping[str, Any]) -> str:
    """The first of [project] maintainers as `name <email>`; BUILDER where there is none."""
    for one in project.get("maintainers", []):
        return f"{one['name']} <{one['email']}>"
    return BUILDER
