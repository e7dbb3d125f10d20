"""One connection to a unit that an amplifier's and a sensor's driver share."""

import threading
from collections.abc import Callable
from typing import Any
from weakref import WeakValueDictionary


class Shared:
    """calls: held during each call, where the unit takes one at a time. Making the connection anew
    holds another lock, so that nobody waits for a unit that is lost."""

    def __init__(self, make: Callable[[], Any], release: Callable[[Any], None]) -> None:
        self.calls = threading.RLock()
        self._make, self._release = make, release
        self._making = threading.Lock()
        self._users: set[int] = set()
        self._made: Any = None

    def connect(self, user: int, make: Callable[[], Any] | None = None) -> Any:
        """The connection, made where there is none. make: in place of the first user's, where the
        users differ in how they connect. Raises what `make` raises."""
        with self._making:
            if self._made is None:
                self._made = (make or self._make)()
            self._users.add(user)
            return self._made

    def drop(self, failed: Any) -> None:
        """A call over this connection failed: the next to connect makes one anew."""
        with self._making:
            if self._made is failed and failed is not None:
                self._end()

    def release(self, user: int) -> None:
        """Use it no more; the last user ends it."""
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
    """The same one for all that name the same key. make: connects; release: disconnects, raises
    nothing."""
    with _finding:
        found = _shared.get(key)
        if found is None:
            found = _shared[key] = Shared(make, release)
        return found
