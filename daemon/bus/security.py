"""Authentication and access control, as settings of the daemon's own zenoh session.

On loopback, no authentication is required. Beyond loopback it must be configured ([bus.auth]):
either user and password, or certificates (mutual TLS). Everything is denied except what the two
roles need. Observers: telemetry, status, events, model, configuration, history. Operators: the
same, plus commands. The daemon's process enforces these rules.

If clients connect through a router, they all share one link, on which the daemon cannot distinguish
them. The router then checks credentials and enforces the roles (docs/examples/router-secured.json5
by certificate, router-passwords.json5 by user name); the daemon has credentials of its own and
does not listen on any address.
"""

import ipaddress
import os
import re
import secrets
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.drivers import system
from dehyst.models.errors import BadInput

CA, CERTIFICATE, KEY = "ca.pem", "certificate.pem", "key.pem"
LARGEST_BYTES = 1 << 20  # a certificate, key or password file has a few kB
PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws")
PUBLISHED = ("telemetry", "status", "event", "rejection", "doctor")
QUESTIONS = ("status", "model", "configuration", "history", "events", "doctor", "report")


def check_address(endpoint: str, what: str) -> None:
    """Raise BadInput if this is not an address that a session could use."""
    protocol, slash, rest = endpoint.partition("/")
    address = rest.partition("?")[0].partition("#")[0]
    if slash and protocol.startswith("unix") and address:
        return
    host, _, port = address.rpartition(":")
    good = protocol in PROTOCOLS and host and port.isascii() and port.isdigit()
    if not good or len(port) > 5 or not 0 < int(port) < 65536:
        raise BadInput(
            f"{what}: {endpoint[:80]!r} is not an address; write PROTOCOL/HOST:PORT, such as "
            f"tcp/127.0.0.1:7447 (protocols: {', '.join(PROTOCOLS)})"
        )


def is_loopback(endpoint: str) -> bool:
    """Return True for a zenoh endpoint that only this machine can reach."""
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unix"):
        return True
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_open(listen: Sequence[str], authenticated: bool) -> None:
    """Raise BadInput if the daemon would listen beyond loopback without authentication."""
    for endpoint in listen:
        check_address(endpoint, "bus.listen")
        if not authenticated and not is_loopback(endpoint):
            raise BadInput(
                f"bus.listen: {endpoint} can be reached from the network and [bus.auth] is not "
                "configured: anybody could move the stage. Configure it (`dehyst keys` makes "
                "certificates), or listen on 127.0.0.1"
            )


def check_page(
    listen: str, certificate: str, key: str, passwords: str, public_url: str = ""
) -> None:
    """Raise BadInput if the browser page would be open to the network."""
    host, _, port = listen.rpartition(":")
    if not host:
        raise BadInput(f"page.listen: {listen[:80]!r} is not an address; write HOST:PORT")
    if not (port.isascii() and port.isdigit() and len(port) < 20 and 0 < int(port) < 65536):
        raise BadInput(
            f"page.listen: {listen[:80]!r} is not an address: {port[:20]!r} is not a port; a port "
            "is a number from 1 to 65535"
        )
    if bool(certificate) != bool(key):
        raise BadInput("page: `certificate` and `key` go together")
    if public_url:
        origin, _ = split_public_url(public_url)
        if not is_loopback(f"tcp/{with_port(origin)}"):
            if not passwords:
                raise BadInput(
                    f"page.public_url: anybody who reaches {public_url} could move the stage. Give "
                    "passwords, with operators or observers"
                )
            if not origin.startswith("https:"):
                raise BadInput(
                    f"page.public_url: {public_url} would carry passwords in the clear; have the "
                    "proxy serve https, and write https:// here"
                )
    if is_loopback(f"tcp/{listen}") or (certificate and passwords):
        return
    lacks = [] if certificate else ["certificate and key (TLS)"]
    lacks += [] if passwords else ["passwords (with operators or observers)"]
    raise BadInput(
        f"page.listen: {listen} can be reached from the network: anybody could move the stage. "
        f"Give {' and '.join(lacks)}; or listen on 127.0.0.1"
    )


PORTS = {"http": 80, "https": 443}


def split_public_url(url: str) -> tuple[str, str]:
    """Split the address that people type for a page behind a reverse proxy into (origin as a
    browser sends it, path without a trailing slash). Raises BadInput if it is not an address."""
    wrong = BadInput(
        f"page.public_url: {url[:120]!r} is not the address of a page; write it as people type "
        "it, such as https://lab.example/stage/"
    )
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        raise wrong from None
    plain = not (parts.query or parts.fragment or "@" in parts.netloc)
    if not url.isprintable() or parts.scheme not in PORTS or not parts.hostname or not plain:
        raise wrong
    if not re.fullmatch(r"[A-Za-z0-9._~/-]*", parts.path) or "//" in parts.path:
        raise wrong
    if not re.fullmatch(r"[a-z0-9.-]+|[0-9a-f:.]+", parts.hostname):
        raise wrong
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    place = host if port in (None, PORTS[parts.scheme]) else f"{host}:{port}"
    return f"{parts.scheme}://{place}", parts.path.rstrip("/")


def with_port(origin: str) -> str:
    """Return HOST:PORT of an origin."""
    scheme, _, place = origin.partition("://")
    return place if re.search(r":\d+$", place) else f"{place}:{PORTS[scheme]}"


def check_routers(listen: Sequence[str], connect: Sequence[str], auth: Any) -> None:
    """Raise BadInput if a connection through a router would bypass authentication. auth: an
    AuthConfig or None."""
    credentials = auth is not None and auth.credentials
    for endpoint in connect:
        check_address(endpoint, "bus.connect")
        if not credentials and not is_loopback(endpoint):
            raise BadInput(
                f"bus.connect: {endpoint} is on the network and bus.auth.credentials is not given: "
                "anybody at that router could move the stage"
            )
    if credentials and not connect:
        raise BadInput("bus.auth.credentials: are for the routers in bus.connect; name them")
    if credentials and listen:
        raise BadInput(
            "bus.auth.credentials: with a router that enforces the roles the daemon itself "
            "listens on nothing: set bus.listen = []"
        )
    roles = auth is not None and (auth.operators or auth.observers)
    if roles and connect:
        raise BadInput(
            "bus.auth: the clients of a router cannot be distinguished here: name operators and "
            "observers in the router's configuration, and bus.auth.credentials here"
        )
    if not listen and not connect:
        raise BadInput("bus: neither `listen` nor `connect`: nobody could reach the daemon")


def _readable(path: Path, what: str, private: bool = False) -> str:
    try:
        read_text(path, LARGEST_BYTES)
        found = os.stat(path)
    except NotReadable as error:
        raise BadInput(f"{what}: {path} cannot be read: {error}") from None
    if private and system.others_may(found, stat.S_IRWXO | stat.S_IWGRP):
        raise BadInput(f"{what}: {path} can be read by everybody; chmod 600 {path}")
    return str(path)


def _tls(directory: Path, side: str) -> dict[str, Any]:
    tls = "transport/link/tls"
    return {
        f"{tls}/root_ca_certificate": _readable(directory / CA, "certificates"),
        f"{tls}/{side}_certificate": _readable(directory / CERTIFICATE, "certificates"),
        f"{tls}/{side}_private_key": _readable(directory / KEY, "certificates", private=True),
        f"{tls}/enable_mtls": True,
        f"{tls}/close_link_on_expiration": True,
    }


def _secret(path: Path, what: str) -> str:
    """Return the text of a file that no other user may read. Raises BadInput."""
    return Path(_readable(path, what, private=True)).read_text("utf-8")


def read_passwords(path: Path, what: str) -> dict[str, str]:
    """Return passwords by name, from a file of name:password lines that no other user may read.
    Raises BadInput."""
    found = {}
    for number, line in enumerate(_secret(path, what).splitlines(), 1):
        name, colon, password = line.partition(":")
        if not line.strip():
            continue
        if not (name and colon and len(password) >= 8):
            raise BadInput(f"{path}: line {number} must be name:password with 8 characters or more")
        found[name] = password
    return found


def server_settings(
    name: str,
    axes: Sequence[Keys],
    listen: Sequence[str],
    operators: Sequence[str],
    observers: Sequence[str],
    passwords: str,
    certificates: str,
) -> dict[str, Any]:
    """Return the zenoh settings of a daemon that requires authentication. name: the controller's;
    axes: keys of its axes, all with the same roles. Raises BadInput if a file is missing, readable
    by other users, or does not match the roles."""
    people = [*operators, *observers]
    if bool(passwords) == bool(certificates):
        raise BadInput("bus.auth: give either `passwords` or `certificates`")
    if not people:
        raise BadInput("bus.auth: name the operators and observers; nobody could connect")
    if len(set(people)) < len(people):
        raise BadInput("bus.auth: a name is listed twice; an operator may observe anyway")
    if passwords:
        missing = sorted(set(people) - set(read_passwords(Path(passwords), "bus.auth.passwords")))
        if missing:
            raise BadInput(f"bus.auth: {', '.join(missing)}: no password in {passwords}")
        user = "transport/auth/usrpwd"
        settings: dict[str, Any] = {
            f"{user}/user": name,
            f"{user}/password": secrets.token_urlsafe(32),  # our own is never requested
            f"{user}/dictionary_file": passwords,
        }
        subject = "usernames"
    else:
        plain = [e for e in listen if not e.startswith(("tls/", "quic/"))]
        if plain:
            raise BadInput(f"bus.listen: {plain[0]}: certificates need an address tls/HOST:PORT")
        settings = _tls(Path(certificates), "listen")
        subject = "cert_common_names"
    return settings | {"access_control": _access(axes, subject, operators, observers)}


def client_settings(credentials: str) -> dict[str, Any]:
    """Return the zenoh settings of a client. credentials: a directory with ca.pem, certificate.pem
    and key.pem, or a file with one line name:password; "": none. Raises BadInput if they cannot be
    used."""
    if not credentials:
        return {}
    path = Path(credentials)
    if path.is_dir():
        return _tls(path, "connect")
    name, colon, password = _secret(path, "credentials").strip().partition(":")
    if not colon or not name or not password or "\n" in password:
        raise BadInput(f"{path}: must hold one line name:password")
    user = "transport/auth/usrpwd"
    return {f"{user}/user": name, f"{user}/password": password}


def _access(
    axes: Sequence[Keys], subject: str, operators: Sequence[str], observers: Sequence[str]
) -> dict[str, Any]:
    """Return the rules by role; `ingress` is traffic to the daemon, `egress` traffic from it."""
    everyone = Keys(axes[0].base, "*")
    published = [keys.pubsub(name) for keys in axes for name in PUBLISHED]
    asked = [keys.rpc(name) for keys in axes for name in QUESTIONS]
    setpoints = [keys.setpoints() for keys in axes]
    command, alive = [keys.rpc("command") for keys in axes], [keys.alive() for keys in axes]
    observing = {
        "publish": (["put"], "egress", published),
        "subscribe": (["declare_subscriber"], "ingress", published),
        "ask": (["query"], "ingress", asked),
        "answer": (["declare_queryable", "reply"], "egress", asked),
        "token": (["liveliness_token"], "egress", alive),
        "find": (
            ["liveliness_query", "declare_liveliness_subscriber"],
            "ingress",
            [everyone.alive(), *alive],
        ),
    }
    operating = {
        "put-setpoint": (["put"], "ingress", setpoints),
        "take-setpoint": (["declare_subscriber"], "egress", setpoints),
        "command": (["query"], "ingress", command),
        "answer-command": (["declare_queryable", "reply"], "egress", command),
    }
    roles = {"operators": list(operators), "observers": list(observers)}
    roles = {role: names for role, names in roles.items() if names}
    policies = [{"rules": list(observing), "subjects": list(roles)}]
    if operators:
        policies.append({"rules": list(operating), "subjects": ["operators"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {
                "id": name,
                "permission": "allow",
                "messages": messages,
                "flows": [flow],
                "key_exprs": key_exprs,
            }
            for name, (messages, flow, key_exprs) in (observing | operating).items()
        ],
        "subjects": [{"id": role, subject: names} for role, names in roles.items()],
        "policies": policies,
    }
