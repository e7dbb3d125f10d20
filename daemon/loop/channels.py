"""Read further measured channels, such as a temperature, outside the loop.

The values that a model's blocks need change slowly: one thread reads each channel at intervals and
stores the value where the inverse reads it. A channel that fails keeps its last value, so that the
output does not jump; the failure is reported, and the channel is tried again at every reading.
"""

import math
import threading
from collections.abc import Callable, Mapping

from dehyst.daemon import clock
from dehyst.daemon.config import ChannelConfig
from dehyst.daemon.loop.timing import realtime
from dehyst.drivers.interface import DriverError, Sensor
from dehyst.drivers.registry import load_sensor


class Channels:
    """The open sensors of [channels.NAME], without the channels that follow an axis. Raises
    DriverError where one cannot be opened.

    measured: called with the name and value of each valid reading; report: called with a message
    when a channel fails or recovers.
    """

    def __init__(
        self,
        configs: Mapping[str, ChannelConfig],
        measured: Callable[[str, float], None],
        report: Callable[[str], None],
    ) -> None:
        self._configs = {name: config for name, config in configs.items() if config.driver}
        self._measured, self._report = measured, report
        self._sensors: dict[str, Sensor] = {}
        self._said: dict[str, str] = {}
        self._known: set[str] = set()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="channels", daemon=True)
        try:
            for name, config in self._configs.items():
                sensor = load_sensor(config.driver).from_settings(config.settings)
                sensor.open()
                self._sensors[name] = sensor
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Read each channel once, then continue in a thread."""
        for name in self._sensors:
            self.read(name)
        if self._sensors:
            self._thread.start()

    def read(self, name: str) -> None:
        """Take one reading. A failure is reported once, until it changes or ends."""
        config, sensor = self._configs[name], self._sensors[name]
        try:
            if self._said.get(name):
                sensor.reconnect()
            value = sensor.read() * config.scale + config.zero
            wrong = "" if math.isfinite(value) else "no valid reading"
        except DriverError as error:
            wrong = f"{type(error).__name__}: {error}"
        if not wrong:
            self._measured(name, value)
            self._known.add(name)
        if wrong != self._said.get(name, ""):
            until_then = "its last value is kept" if name in self._known else "not compensated"
            self._report(
                f"channel {name}: {wrong}; {until_then}" if wrong else f"channel {name}: back"
            )
            self._said[name] = wrong

    def _run(self) -> None:
        realtime.leave_realtime()
        every = {name: config.every_s for name, config in self._configs.items()}
        due = {name: clock.monotonic_ns() * 1e-9 + s for name, s in every.items()}
        while True:
            name = min(due, key=lambda n: due[n])
            if self._end.wait(max(due[name] - clock.monotonic_ns() * 1e-9, 0.0)):
                return
            self.read(name)
            due[name] = clock.monotonic_ns() * 1e-9 + every[name]

    def close(self) -> None:
        """Stop reading and release the sensors."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        for sensor in self._sensors.values():
            sensor.close()
