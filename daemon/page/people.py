"""Decide who may view and who may command: passwords, sessions, same origin.

As on the bus, there are operators and observers. Only on loopback is nothing required; elsewhere
TLS and a password are. A request from another site's page is recognised by its Origin, and DNS
rebinding by its Host: without passwords, only this machine's own names are accepted.
"""

import base64
import hmac
import math
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dehyst.daemon import clock
from dehyst.daemon.bus.security import read_passwords, split_public_url
from dehyst.daemon.page.guesses import Guesses
from dehyst.models.errors import BadInput, NotNow

Role = Literal["operator", "observer"]
COOKIE = "dehyst"
SESSION_S = 12 * 3600.0  # a login outlasts a working day
MOST_SESSIONS = 256  # limits the memory; the oldest is dropped first
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")


class TooManyGuesses(NotNow):
    """This address sent too many wrong passwords. wait_s: time until its next one is checked."""

    def __init__(self, address: str, wait_s: float) -> None:
        self.wait_s = wait_s
        super().__init__(
            f"too many wrong passwords from {address}: try again in {math.ceil(wait_s)} s"
        )


@dataclass(frozen=True)
class Person:
    """A user of the page; name "": anyone on this machine."""

    name: str
    role: Role

    @property
    def commands(self) -> bool:
        """Whether the person may move the stage."""
        return self.role == "operator"


class People:
    """The users who are admitted. passwords: file of name:password lines, "": everyone on this
    machine, as an operator or, with observe, as an observer. Raises BadInput if the names and the
    file do not match."""

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
        self._guesses = Guesses()
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

    def check(self, name: str, password: str, address: str) -> Person | None:
        """Return the person with this name and password, or None. Raises TooManyGuesses, whether
        the password is right or not, if this address sent too many wrong ones."""
        now_ns = clock.monotonic_ns()
        if wait_s := self._guesses.wait_s(address, now_ns):
            raise TooManyGuesses(address, wait_s)
        known, person = self._people.get(name, ("", None))
        right = hmac.compare_digest(known.encode(), password.encode("utf-8", "replace"))
        if right and person is not None:
            return person
        self._guesses.wrong(address, now_ns)
        return None

    def begin(self, person: Person) -> str:
        """Begin a session and return its token."""
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

    def lasts(self, token: str) -> bool:
        """Return whether a session is valid."""
        _, until_ns = self._sessions.get(token, (None, 0))
        return until_ns > clock.monotonic_ns()

    def who(self, headers: Mapping[str, str], token: str, address: str) -> Person | None:
        """Return who sent a request, identified by session or by name and password in the header
        (`curl -u`, Prometheus); None: unknown. Raises TooManyGuesses."""
        if self.open:
            return self._everybody
        if self.lasts(token):
            return self._sessions[token][0]
        kind, _, text = headers.get("authorization", "").partition(" ")
        if kind.lower() == "basic":
            try:
                name, _, password = base64.b64decode(text, validate=True).decode().partition(":")
            except ValueError:  # invalid text counts as a wrong guess
                name = password = ""
            return self.check(name, password, address)
        if token or kind:
            self.check("", "", address)  # an unknown token counts as a wrong guess
        return None

    def knows_host(self, host: str) -> bool:
        """Return whether a request's Host is a permitted name of this page."""
        return not self.open or host_name(host) in LOOPBACK_NAMES


@dataclass(frozen=True)
class Public:
    """The public address of the page at a reverse proxy. origin, path: "" without one."""

    origin: str = ""
    path: str = ""

    @classmethod
    def of(cls, url: str) -> "Public":
        """Return the public address of a `page.public_url`."""
        return cls(*split_public_url(url)) if url else cls()

    def called(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request was made through this address, according to its Origin."""
        return bool(self.origin) and headers.get("origin", "").lower() == self.origin

    @property
    def host(self) -> str:
        """Host of the public address, without the port."""
        return host_name(self.origin.partition("://")[2])


def host_name(host: str) -> str:
    """Return a Host header without its port, in lower case."""
    name, colon, port = host.rpartition(":")
    return name.lower() if colon and port.isdigit() else host.lower()


def same_origin(headers: Mapping[str, str]) -> bool:
    """Return whether a request comes from this page itself: its Origin matches its Host."""
    origin, host = headers.get("origin", ""), headers.get("host", "")
    _, slashes, place = origin.partition("://")
    return bool(host and slashes) and place.lower() == host.lower()
