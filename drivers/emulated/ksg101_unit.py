"""An emulated KSG101 / TSG001 strain gauge reader: bytes in, bytes out, no port.

    unit = Ksg101Unit(Ksg101Knobs(max_travel_um=20.0), position=reading_at)
    with PtyServer(unit, "/tmp/dehyst/ksg101"): ...

`position` is asked for the displacement [um] at the clock's time at which a reading is due, which
is a little ago when this process is late.
"""

import math
import random
import time
from collections import deque
from collections.abc import Callable

from msgspec import structs

from dehyst.drivers.emulated.ksg101_knobs import Ksg101Faults, Ksg101Knobs
from dehyst.drivers.ksg101 import codec
from dehyst.drivers.ksg101.codec import AptMessage, Decoder, encode_apt

FULL_SCALE = 32767


class Ksg101Unit:
    """See the module; fulfils pty_device.PtyUnit."""

    def __init__(
        self,
        knobs: Ksg101Knobs | None = None,
        position: Callable[[float], float] = lambda time_s: 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.knobs = knobs or Ksg101Knobs()
        self.faults = Ksg101Faults()
        self.readings_done = 0
        self._position = position
        self._clock = clock
        self._decoder = Decoder(receiver=codec.UNIT, sender=codec.HOST)
        self._random = random.Random(self.knobs.seed)
        self._requests: deque[tuple[float, AptMessage]] = deque()
        self._outgoing: deque[tuple[float, bytes]] = deque()
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

    def feed(self, data: bytes) -> None:
        """Bytes from the host arrive now."""
        due = self._clock() + self.knobs.latency_s
        self._requests.extend((due, message) for message in self._decoder.feed(data))

    def take(self) -> bytes:
        """The next bytes that leave by now; requests that are due by now are carried out."""
        now = self._clock()
        while self._requests and self._requests[0][0] <= now:
            due, message = self._requests.popleft()
            reply = self._answer(message, due)
            if reply and not self.faults.mute:
                self._send(reply, due + self.faults.delay_s)
        if self._outgoing and self._outgoing[0][0] <= now:
            return self._outgoing.popleft()[1]
        return b""

    def next_due_s(self) -> float | None:
        """Clock time at which take() has something next."""
        due = [queue[0][0] for queue in (self._requests,) if queue]
        due += [queue[0][0] for queue in (self._outgoing,) if queue]
        return min(due, default=None)

    def link_lost(self) -> None:
        """The cable was pulled; the zero stays."""
        self._decoder.reset()
        self._requests.clear()
        self._outgoing.clear()

    def _send(self, reply: bytes, due_s: float) -> None:
        if self.faults.garbage > 0:
            self.faults = structs.replace(self.faults, garbage=self.faults.garbage - 1)
            reply = self._random.randbytes(7) + reply
        size = self.knobs.chunk_size or len(reply)
        for start in range(0, len(reply), size):
            self._outgoing.append((due_s, reply[start : start + size]))

    def _answer(self, message: AptMessage, now: float) -> bytes:
        name = message.name
        if name == "hw_req_info":
            return self._reply(
                "hw_get_info",
                serial_number=self.knobs.serial_number,
                model=self.knobs.model.encode()[:8],
                type=3,
                firmware=bytes([3, 0, 1, 0]),  # minor, interim, major
                notes=b"emulated strain gauge reader",
                hardware_version=1,
                modification=0,
                channels=1,
            )
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

    @staticmethod
    def _reply(name: str, **values: object) -> bytes:
        return encode_apt(name, source=codec.UNIT, destination=codec.HOST, **values)

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
        """Reading for a displacement; a bridge out of range, or broken (NaN), shows full scale."""
        if math.isnan(position_um):
            return FULL_SCALE
        share = position_um / self.knobs.max_travel_um * self.knobs.scale_error
        return round(max(-1.0, min(1.0, share)) * FULL_SCALE)
