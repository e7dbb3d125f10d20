"""The command lease: one client commands at a time, the others learn who.

Pure: the time comes in. A lease is a number that only its holder knows; it ends when its
holder was silent for `length_ns`, gives it up, or another client takes over explicitly. Every
lease starts the sequence of its set-points anew, so that commands recorded under an earlier lease
are worth nothing.

The holder's clock is related to ours by the least delay seen (`sent_ns` of its messages), so that
a command that was long on its way is recognised without the two wall clocks agreeing.
"""

from collections.abc import Callable

from dehyst.daemon.bus.messages import new_number

CLOCK_DRIFT = 1e-3
"""How fast the two monotonic clocks may drift apart."""


class Lease:
    """Who may command. length_ns: silence after which the lease ends."""

    def __init__(self, length_ns: int, number: Callable[[], int] = new_number) -> None:
        self.length_ns = length_ns
        self._number = number
        self.client = 0
        self.lease = 0
        self.label = ""
        self.sequence = -1  # of the newest set-point
        self._seen_ns = 0
        self._offset_ns = 0  # our clock minus the holder's, least seen
        self._offset_at_ns = 0

    def held(self, now_ns: int) -> bool:
        """True while somebody holds the lease."""
        return self.client != 0 and now_ns - self._seen_ns <= self.length_ns

    def left_s(self, now_ns: int) -> float:
        """Seconds until the lease ends by silence; 0 where nobody holds it."""
        return max(0, self.length_ns - (now_ns - self._seen_ns)) * 1e-9 if self.client else 0.0

    def give(self, now_ns: int, client: int, label: str, sent_ns: int, number: int = 0) -> int:
        """Give the lease to this client, whoever held it; returns its number. number: to be given
        out, the same for several axes; 0: a new one."""
        self.client, self.label, self.lease = client, label, number or self._number()
        self.sequence = -1
        self._seen_ns = self._offset_at_ns = now_ns
        self._offset_ns = now_ns - sent_ns
        return self.lease

    def check(self, now_ns: int, client: int, lease: int) -> bool:
        """True when this client holds this very lease now."""
        return self.held(now_ns) and client == self.client and lease == self.lease

    def heard(self, now_ns: int, sent_ns: int) -> None:
        """A command of the holder was good: the lease starts again from now."""
        self._seen_ns = now_ns
        drift = round(CLOCK_DRIFT * (now_ns - self._offset_at_ns))
        self._offset_ns = min(self._offset_ns + drift, now_ns - sent_ns)
        self._offset_at_ns = now_ns

    def keep(self, now_ns: int) -> None:
        """The holder was heard, but its command was not good: it is there all the same."""
        self._seen_ns = now_ns

    def age_ns(self, now_ns: int, sent_ns: int) -> int:
        """How much longer than the quickest message this one was on its way; negative: it
        claims to come from the future."""
        return now_ns - sent_ns - self._offset_ns

    def give_up(self) -> None:
        """End the lease."""
        self.client = self.lease = 0
        self.label = ""
