"""Who may look and who may command: passwords, sessions, same origin. As on the bus: operators and
observers; loopback alone asks for nothing, beyond it TLS and a password are asked for.

A request of another site's page is told by its Origin, and a name that was bent to this machine
(DNS rebinding) by its Host: without passwords only this machine's own names are answered.
"""

import base64
import binascii
import hmac
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dehyst.daemon import clock
from dehyst.daemon.bus.security import read_passwords
from dehyst.models.errors import BadInput

Role = Literal["operator", "observer"]
COOKIE = "dehyst"
SESSION_S = 12 * 3600.0
MOST_SESSIONS = 256
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")


@dataclass(frozen=True)
class Person:
    """Somebody at a browser; name "": anybody on this machine."""

    name: str
    role: Role

    @property
    def commands(self) -> bool:
        """May move the stage."""
        return self.role == "operator"


class People:
    """Who is let in. passwords: file of name:password lines, "": everybody on this machine, as an
    operator or, with observe, as an observer. Raises BadInput where names and file do not fit."""

    def __init__(
        self,
        passwords: str,
        operators: Sequence[str] = (),
        observers: Sequence[str] = (),
        observe: bool = False,
    ) -> None:
        self.open = not passwords
        self._everybody = Person("", "observer" if observe else "operator")
        self._people: dict[str, tuple[str, Person]] = {}
        self._sessions: dict[str, tuple[Person, int]] = {}
        if self.open:
            if operators or observers:
                raise BadInput("page: operators and observers need `passwords`")
            return
        known = read_passwords(Path(passwords), "page.passwords")
        roles: dict[str, Role] = dict.fromkeys(observers, "observer")
        roles |= dict.fromkeys(() if observe else operators, "operator")
        if not roles:
            raise BadInput("page: name the operators and observers; nobody could log in")
        missing = sorted(set(roles) - set(known))
        if missing:
            raise BadInput(f"page: {', '.join(missing)}: no password in {passwords}")
        self._people = {n: (known[n], Person(n, role)) for n, role in roles.items()}

    def check(self, name: str, password: str) -> Person | None:
        """The person with this password; None: there is none."""
        known, person = self._people.get(name, ("", None))
        right = hmac.compare_digest(known.encode(), password.encode())
        return person if right and person is not None else None

    def begin(self, person: Person) -> str:
        """A new session's token."""
        now_ns = clock.monotonic_ns()
        self._sessions = {t: s for t, s in self._sessions.items() if s[1] > now_ns}
        while len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        token = secrets.token_urlsafe(32)
        self._sessions[token] = person, now_ns + round(SESSION_S * clock.NS)
        return token

    def finish(self, token: str) -> None:
        """End a session."""
        self._sessions.pop(token, None)

    def who(self, headers: Mapping[str, str], token: str) -> Person | None:
        """Who asks: by session, or by name and password in the header (`curl -u`, Prometheus)."""
        if self.open:
            return self._everybody
        person, until_ns = self._sessions.get(token, (None, 0))
        if person is not None and until_ns > clock.monotonic_ns():
            return person
        kind, _, text = headers.get("authorization", "").partition(" ")
        if kind.lower() != "basic":
            return None
        try:
            name, _, password = base64.b64decode(text, validate=True).decode().partition(":")
        except (binascii.Error, UnicodeDecodeError):
            return None
        return self.check(name, password)

    def knows_host(self, host: str) -> bool:
        """Whether a request's Host is one that this page may be called by."""
        return not self.open or host_name(host) in LOOPBACK_NAMES


def host_name(host: str) -> str:
    """A Host header without its port."""
    name, colon, port = host.rpartition(":")
    return name.lower() if colon and port.isdigit() else host.lower()


def same_origin(headers: Mapping[str, str]) -> bool:
    """Whether a request comes from this page itself: its Origin is the Host that it asks."""
    origin, host = headers.get("origin", ""), headers.get("host", "")
    _, slashes, place = origin.partition("://")
    return bool(host and slashes) and place.lower() == host.lower()
