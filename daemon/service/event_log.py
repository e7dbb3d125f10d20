"""Print the events of the loop's process, read from the event rings, in the supervisor's log."""

from collections.abc import Callable
from datetime import datetime

from dehyst.daemon.config import Config
from dehyst.daemon.rings.records import EVENT
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.models.errors import BadInput


class EventLog:
    """Reports the events of one axis, each once."""

    def __init__(self, config: Config, say: Callable[[str], None]) -> None:
        self._path, self._say = config.directory / "event.ring", say
        self._axis = f"{config.axis}: " if config.axis else ""
        self._ring: RingFile | None = None
        self._reported = 0

    def log_new(self, pid: int) -> None:
        """Report the events that this process' loop has written since the last call."""
        try:
            if self._ring is None or self._ring.stale():
                if self._ring is not None:
                    self._ring.close()
                self._ring, self._reported = None, 0
                self._ring = RingFile(self._path, EVENT)
            if self._ring.pid != pid or self._ring.place()[0] == self._reported:
                return
            records, self._reported = self._ring.read(self._reported)
        except BadInput:
            return  # no loop yet, or its ring is damaged; the loop repairs it
        for record in records:
            when = datetime.fromtimestamp(int(record["wall_ns"]) * 1e-9)
            text = bytes(record["text"]).decode("utf-8", "replace")
            self._say(f"{when:%H:%M:%S} {self._axis}{text}")
