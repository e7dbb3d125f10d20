"""Finds the daemons on the bus and selects one, by its name or as the only one."""

import logging
import socket
from collections.abc import Callable, Sequence

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Status
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.models.errors import BadInput

log = logging.getLogger(__name__)
FIND_S, TIMEOUT_S = 5.0, 3.0  # wait for a daemon that is starting; for its answer


def listens(address: str) -> bool:
    """Return whether something accepts connections at a TCP address of zenoh; True for other kinds
    of address, which only zenoh itself can try."""
    kind, _, rest = address.partition("/")
    host, _, port = rest.rpartition(":")
    if kind != "tcp" or not port.isdigit():
        return True
    try:
        socket.create_connection((host.strip("[]"), int(port)), 0.5).close()  # s
    except OSError:
        return False
    return True


def find_daemons(
    bus: Bus, base: str, addresses: Sequence[str], enough: Callable[[list[str]], object]
) -> list[str]:
    """Return the names of the daemons on the bus. Waits for one that is just starting, until
    `enough(names)` is true or there are several. Raises BusError if there is none."""
    deadline_ns = clock.monotonic_ns() + round(FIND_S * 1e9)
    passed_over: set[str] = set()
    while True:
        names = daemons(bus, base, passed_over)
        if enough(names) or clock.monotonic_ns() > deadline_ns or len(names) > 1:
            break
        clock.sleep_s(0.05)
    if not names and (old := _older_daemons(bus, base)):
        raise BusError(
            f"{', '.join(old)} at {', '.join(addresses)} speaks an older version of the bus than "
            "this client; update the daemon, or use a client of its version"
        )
    if not names:
        raise BusError(
            f"something listens at {', '.join(addresses)}, but no daemon with keys below {base}/ "
            "answers; it may not be visible with these credentials"
        )
    return names


def _older_daemons(bus: Bus, base: str) -> list[str]:
    """Return the names of daemons that announce themselves with an older version of the keys."""
    tokens = [key for alive, _ in Keys(base, "*").older() for key in bus.alive(alive)]
    return sorted({key.split("/")[-2] for key in tokens})


def chosen_of(names: list[str], name: str | None) -> str | None:
    """Return the selected daemon; None: no match, or several."""
    if name is None:
        return names[0] if len(names) == 1 else None
    return name if name in names else None


def not_chosen(names: list[str], name: str | None, where: str) -> str:
    """Return why no daemon is selected: several answer, or none has this name."""
    if name is None:
        return (
            f"several daemons answer at {where}: {', '.join(names)}; choose one: --name {names[0]}"
        )
    return f"no daemon {name} at {where}; the daemons there are: {', '.join(names)}"


def daemons(bus: Bus, base: str = "dehyst", passed_over: set[str] | None = None) -> list[str]:
    """Return the names of the daemons on the bus. Tokens under keys that no daemon has are ignored,
    and logged unless already in `passed_over`."""
    keys, known, found = Keys(base, "*"), set() if passed_over is None else passed_over, []
    for key in bus.alive(keys.alive()):
        try:
            found.append(keys.parse(key).name)
        except BadInput as error:
            if key not in known:
                log.warning("ignored, because it is not a dehyst daemon: %s", error)
            known.add(key)
    return sorted(found)


def find_axes(
    bus: Bus, base: str, name: str | None, addresses: Sequence[str]
) -> tuple[str, dict[str, str]]:
    """Return (the controller's name, each axis's name in keys by its short name; the short name is
    "" if the controller has a single axis). name: of a controller or an axis. Raises BusError."""
    names = find_daemons(bus, base, addresses, lambda found: _meant(found, name))
    where = ", ".join(addresses)
    found: dict[str, dict[str, str]] = {}
    for daemon in _meant(names, name):
        if any(daemon in axes.values() for axes in found.values()):
            continue
        answer = next(iter(bus.ask(Keys(base, daemon).rpc("status"), timeout_s=TIMEOUT_S)))
        said = encoding.decode(Status, answer).gateway
        controller = said.controller or daemon
        axes = {one.removeprefix(f"{controller}-"): one for one in said.axes} or {"": daemon}
        if name in (None, controller):
            found[controller] = axes
        elif name == daemon:
            return controller, {axis: one for axis, one in axes.items() if one == name}
    if len(found) == 1:
        return next(iter(found.items()))
    if found:
        raise BusError(not_chosen(list(found), None, where))
    raise BusError(f"no daemon {name} at {where}; the daemons there are: {', '.join(names)}")


def _meant(names: list[str], name: str | None) -> list[str]:
    """Return the daemons whose name matches, or that may be axes of a controller of this name."""
    if name is None:
        return names
    return [one for one in names if one == name or one.startswith(f"{name}-")]
