"""The loop's view of its devices: a call that fails marks the device, a thread brings it back.

While a device is down the loop does not touch it; only the reconnecting thread does. When the
thread has succeeded the loop takes the device over again at its next sample.
"""

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from dehyst.daemon import clock
from dehyst.daemon.loop.timing import realtime
from dehyst.drivers.interface import DriverError

FIRST_RETRY_S, LONGEST_RETRY_S = 0.2, 5.0


class DeviceLink:
    """One device and whether it answers.

    ok: the loop may use it; errors: how often it failed; news: messages for the event log.
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
        """Call the device; on a DriverError the link goes down and the error is raised on."""
        try:
            return function(*arguments)
        except DriverError as error:
            self.down(error)
            raise

    def down(self, error: Exception) -> None:
        """The device failed: start to bring it back."""
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
            except Exception as error:  # whatever it was, the device is tried again
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
        """True once after a reconnection succeeded; the loop owns the device again."""
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
    """Move an output without the loop, step by step at no more than the given rate."""
    step = rate_v_per_s * period_s
    while volts != goal:
        volts += math.copysign(min(step, abs(goal - volts)), goal - volts)
        link.call(link.device.write, volts)
        sleep(period_s)
    return volts
