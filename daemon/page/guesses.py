"""Limit wrong passwords and session tokens per address. Pure: takes the time as an argument.

Each address may send FREE wrong ones, then one more every EACH_S. Any sent earlier are refused
without being checked, so that parallel guesses are no faster. An address waits only for its own
wrong ones, and a valid session does not wait at all.
"""

import ipaddress

FREE = 5
"""Wrong guesses without a wait, for typing errors; a stale cookie in a browser costs one."""
EACH_S = 10.0
"""Interval of further guesses: 8640 a day from one address."""
MOST_ADDRESSES = 4096
"""Limits the memory; the address whose last wrong guess is the oldest is dropped first."""
NS = 1_000_000_000


def origin_of(address: str) -> str:
    """Return the key by which an address is counted: an IPv4 address, or the /64 network of an IPv6
    address, which usually belongs to one household. Any other text is its own key."""
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
    """Keep for each address the time at which all its wrong guesses have expired."""

    def __init__(self, free: int = FREE, each_s: float = EACH_S) -> None:
        self._each_ns = round(each_s * NS)
        self._ahead_ns = (free - 1) * self._each_ns
        self._even_ns: dict[str, int] = {}

    def wait_s(self, address: str, now_ns: int) -> float:
        """Return how long this address must wait for its next guess [s]; 0: no wait."""
        even_ns = self._even_ns.get(origin_of(address), now_ns)
        return max(0.0, (even_ns - now_ns - self._ahead_ns) / NS)

    def wrong(self, address: str, now_ns: int) -> None:
        """Count a wrong password or token from this address."""
        key = origin_of(address)
        even_ns = max(self._even_ns.pop(key, now_ns), now_ns) + self._each_ns
        while len(self._even_ns) >= MOST_ADDRESSES:
            del self._even_ns[next(iter(self._even_ns))]
        self._even_ns[key] = even_ns
