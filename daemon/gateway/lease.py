"""The command lease: one client commands at a time, and the others learn which.

Pure: takes the time as an argument. A lease is a number that only its holder knows; it ends when
the holder has been silent for `length_ns`, gives it up, or another client explicitly takes over.
Every lease starts a new sequence of set-points, so that commands recorded under an earlier lease
are invalid.

The holder's clock is related to ours by the smallest delay seen (`sent_ns` of its messages), so
that a delayed command is recognised without synchronised wall clocks.
"""

from collections.abc import Callable

from dehyst.daemon.bus.messages import new_number

CLOCK_DRIFT = 1e-3
"""Largest relative drift between the two monotonic clocks."""


class Lease:
    """State of the lease. length_ns: silence after which it ends."""

    def __init__(self, length_ns: int, number: Callable[[], int] = new_number) -> None:
        self.length_ns = length_ns
        self._number = number
        self.client = 0
        self.lease = 0
        self.label = ""
        self.sequence = -1  # of the newest set-point
        self._seen_ns = 0
        self._offset_ns = 0  # smallest seen difference, our clock minus the holder's
        self._offset_at_ns = 0

    def is_held(self, now_ns: int) -> bool:
        """Return True while a client holds the lease."""
        return self.client != 0 and now_ns - self._seen_ns <= self.length_ns

    def left_s(self, now_ns: int) -> float:
        """Return the seconds until the lease expires; 0 if no client holds it."""
        return max(0, self.length_ns - (now_ns - self._seen_ns)) * 1e-9 if self.client else 0.0

    def give(self, now_ns: int, client: int, label: str, sent_ns: int, number: int = 0) -> int:
        """Give the lease to this client, whoever held it, and return its number. number: the number
        to issue, the same for several axes; 0: a new one."""
        self.client, self.label, self.lease = client, label, number or self._number()
        self.sequence = -1
        self._seen_ns = self._offset_at_ns = now_ns
        self._offset_ns = now_ns - sent_ns
        return self.lease

    def check(self, now_ns: int, client: int, lease: int) -> bool:
        """Return True if this client holds this lease now."""
        return self.is_held(now_ns) and client == self.client and lease == self.lease

    def renew(self, now_ns: int, sent_ns: int) -> None:
        """Renew the lease after a valid command of the holder."""
        self._seen_ns = now_ns
        drift = round(CLOCK_DRIFT * (now_ns - self._offset_at_ns))
        self._offset_ns = min(self._offset_ns + drift, now_ns - sent_ns)
        self._offset_at_ns = now_ns

    def keep_alive(self, now_ns: int) -> None:
        """Renew the lease after an invalid command of the holder, which is still alive."""
        self._seen_ns = now_ns

    def age_ns(self, now_ns: int, sent_ns: int) -> int:
        """Return how much longer this message took than the fastest one; negative: its time stamp
        is in the future."""
        return now_ns - sent_ns - self._offset_ns

    def give_up(self) -> None:
        """End the lease."""
        self.client = self.lease = 0
        self.label = ""
