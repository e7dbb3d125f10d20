"""One connection to a unit that the drivers of an amplifier and of a sensor share."""

import threading
from collections.abc import Callable
from typing import Any
from weakref import WeakValueDictionary


class Shared:
    """A connection and its users. calls: lock held during each call, if the unit takes one at a
    time. Reconnecting holds another lock, so that nobody waits for a unit that is lost."""

    def __init__(self, make: Callable[[], Any], release: Callable[[Any], None]) -> None:
        self.calls = threading.RLock()
        self._make, self._release = make, release
        self._making = threading.Lock()
        self._users: set[int] = set()
        self._made: Any = None

    def connect(self, user: int, make: Callable[[], Any] | None = None) -> Any:
        """Return the connection, after making it if there is none. make: replaces the first user's
        function if users connect differently. Raises what `make` raises."""
        with self._making:
            if self._made is None:
                self._made = (make or self._make)()
            self._users.add(user)
            return self._made

    def drop(self, failed: Any) -> None:
        """Discard a connection whose call failed; the next user to connect makes a new one."""
        with self._making:
            if self._made is failed and failed is not None:
                self._end()

    def release(self, user: int) -> None:
        """End this user's share of the connection; the last user closes it."""
        with self._making:
            self._users.discard(user)
            if not self._users and self._made is not None:
                self._end()

    def _end(self) -> None:
        made, self._made = self._made, None
        self._release(made)


_shared: WeakValueDictionary[str, Shared] = WeakValueDictionary()
_finding = threading.Lock()


def shared_by(key: str, make: Callable[[], Any], release: Callable[[Any], None]) -> Shared:
    """Return the Shared of this key, the same for every caller. make: connects; release:
    disconnects and raises nothing."""
    with _finding:
        found = _shared.get(key)
        if found is None:
            found = _shared[key] = Shared(make, release)
        return found
