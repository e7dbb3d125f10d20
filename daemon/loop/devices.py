"""The loop's links to its devices: a failed call marks a device as down; a thread reconnects it.

While a device is down, only the reconnecting thread uses it, not the loop. After the thread has
succeeded, the loop uses the device again from its next sample on.
"""

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from dehyst.daemon import clock
from dehyst.daemon.loop.timing import realtime
from dehyst.drivers.interface import DriverError

FIRST_RETRY_S, LONGEST_RETRY_S = 0.2, 5.0  # the wait doubles up to the longest


class DeviceLink:
    """One device, and whether it responds.

    ok: the loop may use it; errors: number of failures; news: messages for the event log.
    """

    def __init__(self, name: str, device: Any) -> None:
        self.name, self.device = name, device
        self.ok = True
        self.errors = 0
        self.news: deque[str] = deque()
        self._back = threading.Event()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call the device; on a DriverError, mark the link as down and raise the error again."""
        try:
            return function(*arguments)
        except DriverError as error:
            self.down(error)
            raise

    def down(self, error: Exception) -> None:
        """Mark the device as failed and start to reconnect it."""
        self.errors += 1
        self.ok = False
        self.news.append(f"{self.name}: {type(error).__name__}: {error}")
        self._back.clear()
        self._thread = threading.Thread(target=self._bring_back, name=f"reconnect-{self.name}")
        self._thread.daemon = True
        self._thread.start()

    def _bring_back(self) -> None:
        realtime.leave_realtime()
        wait_s, last = FIRST_RETRY_S, ""
        while not self._ended.wait(wait_s):
            try:
                self.device.reconnect()
            except Exception as error:  # whatever the error, the device is tried again
                known = isinstance(error, DriverError)
                text = str(error) if known else f"{type(error).__name__}: {error}"
                if text != last:
                    last = text
                    self.news.append(f"{self.name}: not back yet: {text}")
                wait_s = min(2 * wait_s, LONGEST_RETRY_S)
            else:
                self._back.set()
                return

    def came_back(self) -> bool:
        """Return True once after a successful reconnection; the loop then owns the device again."""
        if self.ok or not self._back.is_set():
            return False
        self._back.clear()
        self.ok = True
        self.news.append(f"{self.name}: back")
        return True

    def close(self) -> None:
        """Stop reconnecting and release the device."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        self.device.close()


def ramp(
    link: DeviceLink,
    volts: float,
    goal: float,
    rate_v_per_s: float,
    period_s: float,
    sleep: Callable[[float], None] = clock.sleep_s,
) -> float:
    """Move an output without the loop, in steps, at the given rate at most; return the output."""
    step = rate_v_per_s * period_s
    while volts != goal:
        volts += math.copysign(min(step, abs(goal - volts)), goal - volts)
        link.call(link.device.write, volts)
        sleep(period_s)
    return volts
