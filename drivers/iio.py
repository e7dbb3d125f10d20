"""Linux IIO through sysfs: an AD7124 or AD719x bridge converter on a single-board computer.

    path/name, path/in_voltage0_raw (or in_voltage0-voltage1_raw), ..._scale, ..._offset

The voltage in millivolts is (raw + offset) x scale, as the kernel's ABI document says
(Documentation/ABI/testing/sysfs-bus-iio). Each read triggers one conversion. Tested on real
files laid out like sysfs, not on a converter.
"""

import math
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceSpec,
    DeviceTimeout,
    DriverConfigError,
    ProtocolError,
)

TRIALS = 5


@dataclass(frozen=True)
class IioSettings:
    """path: the device's folder. channel: e.g. "voltage0" or "voltage0-voltage1" (differential).
    um_per_mv: displacement per millivolt. zero_mv: voltage at displacement 0. bits: of the
    converter. unsigned: raw counts from 0 (else two's complement)."""

    path: str = "/sys/bus/iio/devices/iio:device0"
    channel: str = "voltage0"
    um_per_mv: float = 1.0
    zero_mv: float = 0.0
    bits: int = 24
    unsigned: bool = False


class IioSensor:
    """A converter channel as a displacement sensor, in micrometres."""

    def __init__(self, settings: IioSettings, clock: Callable[[], float] = time.monotonic) -> None:
        self.settings = settings
        self._clock = clock
        self._raw = Path(settings.path) / f"in_{settings.channel}_raw"
        self._open = False
        self._scale_mv = 1.0
        self._offset = 0.0
        self.spec = self._spec("", 0.0)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver; DriverConfigError names a wrong key."""
        known = {f.name: f.default for f in fields(IioSettings)}
        for key, value in settings.items():
            if key not in known:
                raise DriverConfigError(f"iio: unknown setting '{key}'; known: {', '.join(known)}")
            wanted: Any = type(known[key])
            number = wanted in (int, float) and not isinstance(value, bool)
            if not isinstance(value, (int, float) if number and wanted is float else wanted) or (
                isinstance(value, bool) and wanted is not bool
            ):
                raise DriverConfigError(f"iio: {key} = {value!r} has the wrong type")
        made = IioSettings(**settings)
        if not (math.isfinite(made.um_per_mv) and made.um_per_mv != 0):
            raise DriverConfigError(f"iio: um_per_mv = {made.um_per_mv} must not be 0")
        if not math.isfinite(made.zero_mv):
            raise DriverConfigError(f"iio: zero_mv = {made.zero_mv} must be a number")
        if not 8 <= made.bits <= 32:
            raise DriverConfigError(f"iio: bits = {made.bits} is not in 8 to 32")
        if "/" in made.channel:
            raise DriverConfigError(f"iio: channel = {made.channel!r} is a name, no path")
        return cls(made)

    def open(self) -> None:
        """Find the channel, its scale and offset, and time a few readings."""
        if self._open:
            return
        folder = Path(self.settings.path)
        if not folder.is_dir():
            raise DeviceNotFound(f"iio: there is no device {folder}; ls /sys/bus/iio/devices")
        if not self._raw.is_file():
            seen = sorted(p.name[3:-4] for p in folder.glob("in_*_raw"))
            raise DeviceNotFound(
                f"iio: there is no {self._raw}; channels here: {', '.join(seen) or 'none'}"
            )
        self._open = True
        try:
            self._scale_mv = self._attribute("scale", 1.0)
            self._offset = self._attribute("offset", 0.0)
            name = self._text(folder / "name") or "unnamed"
            took = []
            for _ in range(TRIALS):
                start = self._clock()
                self.read()
                took.append(self._clock() - start)
        except BaseException:
            self.close()
            raise
        self.spec = self._spec(f"IIO {name} {self.settings.channel}", sorted(took)[TRIALS // 2])

    def read(self) -> float:
        """One conversion [um]; NaN where the converter is at an end of its range."""
        if not self._open:
            raise DeviceGone(f"iio: {self.settings.path} is not open")
        try:
            text = self._raw.read_text()
        except TimeoutError:  # the kernel driver waited for the converter in vain
            raise DeviceTimeout(f"iio: {self._raw}: no conversion in time") from None
        except OSError as error:
            raise DeviceGone(f"iio: {self._raw}: {error.strerror}") from None
        try:
            counts = int(text)
        except ValueError:
            raise ProtocolError(f"iio: {self._raw} says {text!r}, no number") from None
        low, high = self._ends()
        if not low < counts < high:
            return math.nan
        return self._displacement_um(counts)

    def reconnect(self) -> None:
        """Open the channel again."""
        self.close()
        self.open()

    def close(self) -> None:
        """Release the channel. Safe to call twice."""
        self._open = False

    def _ends(self) -> tuple[int, int]:
        bits = self.settings.bits
        if self.settings.unsigned:
            return 0, 2**bits - 1
        return -(2 ** (bits - 1)), 2 ** (bits - 1) - 1

    def _displacement_um(self, counts: int) -> float:
        mv = (counts + self._offset) * self._scale_mv
        return (mv - self.settings.zero_mv) * self.settings.um_per_mv

    def _spec(self, identity: str, latency_s: float) -> DeviceSpec:
        ends = sorted(self._displacement_um(counts) for counts in self._ends())
        return DeviceSpec(
            unit="um",
            minimum=ends[0],
            maximum=ends[1],
            resolution=abs(self._scale_mv * self.settings.um_per_mv),
            max_rate_hz=1.0 / latency_s if latency_s > 0 else 100.0,
            latency_s=latency_s or 0.01,
            identity=identity,
        )

    def _attribute(self, name: str, default: float) -> float:
        """The channel's own attribute, or the one its kind shares, or the default."""
        folder = Path(self.settings.path)
        found = re.match("[a-z]+", self.settings.channel)
        kind = found.group() if found else "voltage"
        shared = [f"in_{kind}_{name}", f"in_{kind}-{kind}_{name}"]
        for file in (f"in_{self.settings.channel}_{name}", *shared):
            text = self._text(folder / file)
            if text is None:
                continue
            try:
                return float(text)
            except ValueError:
                raise ProtocolError(f"iio: {folder / file} says {text!r}, no number") from None
        return default

    @staticmethod
    def _text(path: Path) -> str | None:
        try:
            return path.read_text().strip()
        except OSError:
            return None
