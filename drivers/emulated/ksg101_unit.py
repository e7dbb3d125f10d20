"""An emulated KSG101 / TSG001 strain gauge reader: bytes in, bytes out, no port.

    unit = Ksg101Unit(Ksg101Knobs(max_travel_um=20.0), position=reading_at)
    with PtyServer(unit, "/tmp/dehyst/ksg101"): ...

`position` is called with the clock time at which a reading is due and returns the displacement
[um]; that time is slightly in the past when this process is late.
"""

import math
import time
from collections.abc import Callable

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import AptMessage
from dehyst.drivers.emulated.apt_unit import AptUnit
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Faults, Ksg101Knobs

FULL_SCALE = 32767
"""Counts of a reading at the full travel of the unit."""


class Ksg101Unit(AptUnit):
    """The emulated reader; implements pty_device.PtyUnit."""

    knobs: Ksg101Knobs
    faults: Ksg101Faults
    notes = b"emulated strain gauge reader"

    def __init__(
        self,
        knobs: Ksg101Knobs | None = None,
        position: Callable[[float], float] = lambda time_s: 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(knobs or Ksg101Knobs(), Ksg101Faults(), clock)
        self.readings_done = 0
        self._position = position
        self._zero_um = 0.0
        self._zeroed = False
        self._smooth_um: tuple[float, float] | None = None  # value, time
        self._stuck_at = 0.0
        self._io = {
            "chan": 1,
            "analog_out": 1,
            "display_mode": 1,
            "force_calibration": 500,
            "reserved": 0,
        }

    def _answer(self, message: AptMessage, now: float) -> bytes:
        name = message.name
        if name == "pz_req_maxtravel":
            steps = round(self.knobs.max_travel_um * 10)
            return self._reply("pz_get_maxtravel", chan=1, travel_100nm=steps)
        if name == "tsg_req_reading":
            self.readings_done += 1
            position_um = self._measure(now)
            return self._reply(
                "tsg_get_reading",
                chan=1,
                reading=self._counts(position_um),
                smoothed=self._counts(self._smoothed(position_um, now)) & 0xFFFF,
            )
        if name == "tsg_req_iosettings":
            return self._reply("tsg_get_iosettings", **self._io)
        if name == "tsg_set_iosettings":
            self._io = dict(message.values)
        elif name == "pz_set_zero":
            self._zero_um += self._measure(now)
            self._zeroed = True
        elif name == "pz_req_pzstatusupdate":
            status = codec.GAUGE_CONNECTED | (codec.ZEROED if self._zeroed else 0)
            counts = self._counts(self._measure(now))
            return self._reply(
                "pz_get_pzstatusupdate", chan=1, output=0, position=counts, status=status
            )
        return b""

    def _measure(self, now: float) -> float:
        if not self.faults.stuck:
            self._stuck_at = self._position(now)
        return self._stuck_at - self._zero_um

    def _smoothed(self, position_um: float, now: float) -> float:
        if self._smooth_um is None or not math.isfinite(position_um):
            self._smooth_um = (position_um, now) if math.isfinite(position_um) else None
            return position_um
        value, then = self._smooth_um
        value += (position_um - value) * -math.expm1(-(now - then) / self.knobs.smoothing_s)
        self._smooth_um = (value, now)
        return value

    def _counts(self, position_um: float) -> int:
        """Convert a displacement to counts; out of range or broken (NaN) is full scale."""
        if math.isnan(position_um):
            return FULL_SCALE
        share = position_um / self.knobs.max_travel_um * self.knobs.scale_error
        return round(max(-1.0, min(1.0, share)) * FULL_SCALE)
