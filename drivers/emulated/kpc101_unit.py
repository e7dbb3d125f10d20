"""An emulated KPC101 or BPC301, and a BPC303: piezo channels, each with a strain gauge; no port.

    unit = Bpc303Unit(Kpc101Knobs(), on_output=drive, position=reading_at)
    with PtyServer(unit, "/tmp/dehyst/bpc303"): ...

`on_output(channel, volts, time_s)` is called whenever a voltage changes, and `position(channel,
time_s)` must return a displacement [um]. Channels are counted from 1.
"""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Annotated

from msgspec import Meta, structs

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import FULL_TRAVEL, AptMessage
from dehyst.drivers.emulated.apt_unit import AptUnit
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Faults, Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit

OnOutput = Callable[[int, float, float], None]
Position = Callable[[int, float], float]


class Kpc101Knobs(Kpz101Knobs, frozen=True):
    """Properties of one channel; all channels of a BPC303 have the same."""

    driver = "emulated kpc101"

    serial_number: Annotated[int, Meta(ge=0, description="serial number that the unit reports")] = (
        113000123
    )
    model: Annotated[str, Meta(max_length=8, description="model that the unit reports")] = "KPC101"
    max_travel_um: Annotated[
        float, Meta(ge=0, le=6553.5, description="travel at 100 %; 0: the unit does not know it")
    ] = 20.0
    gauge: Annotated[bool, Meta(description="a strain gauge is connected")] = True
    bays: Annotated[int, Meta(ge=1, le=3, description="of a BPC303: how many are occupied")] = 3


RACK_KNOBS = Kpc101Knobs(serial_number=71000123, model="BPC303")

AXES = "xyz"
"""Names of a BPC303's channels, in order."""


class Kpc101Faults(Kpz101Faults, frozen=True):
    """Faults at run time; on a BPC303 they act on all channels."""

    driver = "emulated kpc101's faults"

    gauge_pulled: Annotated[bool, Meta(description="no strain gauge is connected")] = False


class Kpc101Unit(Kpz101Unit):
    """A unit of one channel. gauge_connected: may be changed at run time; readings_done: gauge
    readings so far."""

    knobs: Kpc101Knobs
    faults: Kpc101Faults
    notes = b"emulated piezo controller"

    def __init__(
        self,
        knobs: Kpc101Knobs | None = None,
        on_output: OnOutput = lambda channel, volts, time_s: None,
        position: Position = lambda channel, time_s: 0.0,
        clock: Callable[[], float] = time.monotonic,
        number: int = 1,
        address: int = codec.UNIT,
    ) -> None:
        self.addresses = (address,)
        super().__init__(knobs or Kpc101Knobs(), partial(on_output, number), clock)
        self.faults = Kpc101Faults()
        self.readings_done = 0
        self._position = partial(position, number)
        self.gauge_connected = self.knobs.gauge

    def _answer(self, message: AptMessage, now: float) -> bytes:
        if message.values.get("chan", 1) != 1:
            return b""
        match message.name:
            case "pz_req_maxtravel":
                steps = round(self.knobs.max_travel_um * 10)
                return self._reply("pz_get_maxtravel", chan=1, travel_100nm=steps)
            case "pz_req_outputmaxvolts":
                limit_v = self.knobs.limit_v
                flag = {75: 2, 100: 4, 150: 8}[limit_v]
                return self._reply(
                    "pz_get_outputmaxvolts", chan=1, voltage_100mv=10 * limit_v, flags=flag
                )
            case "pz_req_pzstatusupdate":
                self.readings_done += 1
                return self._reply(
                    "pz_get_pzstatusupdate",
                    chan=1,
                    output=self._counts,
                    position=self._position_counts(now),
                    status=self._status(),
                )
            case "pz_req_tpz_iosettings" | "pz_set_tpz_iosettings":  # only the KPZ101 has these
                return b""
        return super()._answer(message, now)

    def _status(self) -> int:
        return super()._status() | (codec.GAUGE_CONNECTED if self._has_gauge() else 0)

    def _has_gauge(self) -> bool:
        return self.gauge_connected and not self.faults.gauge_pulled

    def _position_counts(self, now: float) -> int:
        if not self._has_gauge():
            return 0
        position_um = self._position(now)
        if math.isnan(position_um):
            return FULL_TRAVEL
        share = position_um / (self.knobs.max_travel_um or 1.0)
        return round(max(-1.0, min(1.0, share)) * FULL_TRAVEL)


class Bpc303Unit(AptUnit):
    """A rack: its motherboard reports the identity, and each bay is a separate channel."""

    knobs: Kpc101Knobs
    faults: Kpc101Faults
    notes = b"emulated piezo controller"
    sets_of_all = 0  # this unit has no such command
    addresses = (codec.RACK, *codec.BAYS)

    def __init__(
        self,
        knobs: Kpc101Knobs = RACK_KNOBS,
        on_output: OnOutput = lambda channel, volts, time_s: None,
        position: Position = lambda channel, time_s: 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(knobs, Kpc101Faults(), clock)
        card = structs.replace(knobs, model="BPC303")
        self.channels = {
            address: Kpc101Unit(card, on_output, position, clock, number, address)
            for number, address in enumerate(codec.BAYS[: knobs.bays], 1)
        }

    @property
    def sets_done(self) -> int:
        """Number of voltage sets so far, over all channels."""
        return sum(channel.sets_done for channel in self.channels.values())

    @property
    def readings_done(self) -> int:
        """Number of gauge readings so far, over all channels."""
        return sum(channel.readings_done for channel in self.channels.values())

    def output_v(self, axis: str = "x") -> float:
        """Return the output voltage of a channel; 0 for an empty bay."""
        channel = self.channels.get(codec.BAYS[AXES.index(axis)])
        return channel.output_v() if channel else 0.0

    def _answer(self, message: AptMessage, now: float) -> bytes:
        if message.destination in self.channels:
            channel = self.channels[message.destination]
            channel.faults = self.faults
            return channel.answer(message, now)
        if message.destination == codec.RACK and message.name == "rack_req_bayused":
            bay = int(message.values["bay"])
            state = codec.BAY_OCCUPIED if bay < self.knobs.bays else codec.BAY_EMPTY
            return self._reply("rack_get_bayused", bay=bay, state=state)
        return b""
