"""Wrong passwords and session tokens, counted by the address that they come from. Pure: the time
comes in.

Each address may give FREE wrong ones, then one more every EACH_S. What it gives before is refused
unseen, so that guesses cannot be made faster by making them at once. An address waits for its own
wrong ones alone, and a session that has begun waits for none.
"""

import ipaddress

FREE = 5
"""A person who mistypes is not made to wait; a stale cookie in a browser costs one."""
EACH_S = 10.0
"""8640 guesses a day from one address."""
MOST_ADDRESSES = 4096
"""Bounds the memory; the address that was wrong the longest ago is forgotten first."""
NS = 1_000_000_000


def origin_of(address: str) -> str:
    """What counts as one address: an IPv4 address, or the /64 network of an IPv6 address, which
    one household has for itself. Anything else counts as itself."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address[:64]
    if isinstance(found, ipaddress.IPv6Address):
        if found.ipv4_mapped is not None:
            return str(found.ipv4_mapped)
        return str(ipaddress.ip_network((found, 64), strict=False))
    return str(found)


class Guesses:
    """For each address, the time at which all of its wrong guesses are forgiven."""

    def __init__(self, free: int = FREE, each_s: float = EACH_S) -> None:
        self._each_ns = round(each_s * NS)
        self._ahead_ns = (free - 1) * self._each_ns
        self._even_ns: dict[str, int] = {}

    def wait_s(self, address: str, now_ns: int) -> float:
        """How long this address has to wait before its next guess is looked at; 0: not at all."""
        even_ns = self._even_ns.get(origin_of(address), now_ns)
        return max(0.0, (even_ns - now_ns - self._ahead_ns) / NS)

    def wrong(self, address: str, now_ns: int) -> None:
        """This address gave a wrong password or token."""
        key = origin_of(address)
        even_ns = max(self._even_ns.pop(key, now_ns), now_ns) + self._each_ns
        while len(self._even_ns) >= MOST_ADDRESSES:
            del self._even_ns[next(iter(self._even_ns))]
        self._even_ns[key] = even_ns
