"""An emulated KPZ101 / TPZ001 piezo driver: bytes in, bytes out, no port.

    unit = Kpz101Unit(Kpz101Knobs(limit_v=75), on_output=drive)
    with PtyServer(unit, "/tmp/dehyst/kpz101"): ...

`on_output(volts, time_s)` is called whenever the voltage at the output changes; a disabled output
is at 0 V.
"""

import time
from collections.abc import Callable

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import FULL_OUTPUT, VOLTAGE_LIMITS_V, AptMessage
from dehyst.drivers.emulated.apt_unit import AptUnit
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Faults, Kpz101Knobs


class Kpz101Unit(AptUnit):
    """The emulated unit; implements pty_device.PtyUnit. sets_done: voltage sets so far."""

    knobs: Kpz101Knobs
    faults: Kpz101Faults
    notes = b"emulated piezo driver"

    def __init__(
        self,
        knobs: Kpz101Knobs | None = None,
        on_output: Callable[[float, float], None] = lambda volts, time_s: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(knobs or Kpz101Knobs(), Kpz101Faults(), clock)
        knobs = self.knobs
        self.sets_done = 0
        self.sets_of_all = 0  # this unit has no such command
        self._on_output = on_output
        self._counts = round(knobs.start_v / knobs.limit_v * FULL_OUTPUT)
        self._state = codec.CHANNEL_ENABLED if knobs.enabled else codec.CHANNEL_DISABLED
        self._mode = knobs.mode
        self._source = knobs.source
        limits = {int(volts): code for code, volts in VOLTAGE_LIMITS_V.items()}
        self._io = {
            "chan": 1,
            "voltage_limit": limits[knobs.limit_v],
            "hub_analog_input": 1,
            "future_1": 0,
            "future_2": 0,
        }

    def output_v(self, axis: str = "x") -> float:
        """Return the output voltage, whatever the axis name."""
        if self._state != codec.CHANNEL_ENABLED:
            return 0.0
        limit_v = VOLTAGE_LIMITS_V[self._io["voltage_limit"]]
        return max(0, self._counts) / FULL_OUTPUT * limit_v  # the unit has no negative output

    def _answer(self, message: AptMessage, now: float) -> bytes:
        values = message.values
        if values.get("chan", 1) != 1:  # there is only one channel
            return b""
        match message.name:
            case "pz_req_outputvolts":
                return self._reply("pz_get_outputvolts", chan=1, voltage=self._counts)
            case "pz_req_poscontrolmode":
                return self._reply("pz_get_poscontrolmode", chan=1, mode=self._mode)
            case "pz_req_inputvoltssrc":
                return self._reply("pz_get_inputvoltssrc", chan=1, inputs=self._source)
            case "pz_req_tpz_iosettings":
                return self._reply("pz_get_tpz_iosettings", **self._io)
            case "mod_req_chanenablestate":
                return self._reply("mod_get_chanenablestate", chan=1, state=self._state)
            case "pz_req_pzstatusupdate":  # other programs request it
                return self._reply(
                    "pz_get_pzstatusupdate",
                    chan=1,
                    output=self._counts,
                    position=0,
                    status=self._status(),
                )
        before_v = self.output_v()
        self._change(message)
        if self.output_v() != before_v:
            self._on_output(self.output_v(), now)
        return b""

    def _status(self) -> int:
        enabled = self._state == codec.CHANNEL_ENABLED
        status = codec.ACTUATOR_CONNECTED | (codec.OUTPUT_ENABLED if enabled else 0)
        status |= codec.LIMIT_75_V << (self._io["voltage_limit"] - 1)
        return status | (0 if self._mode in (1, 3) else codec.LOOP_CLOSED)

    def _change(self, message: AptMessage) -> None:
        values = message.values
        match message.name:
            # in closed loop the unit ignores a voltage
            case "pz_set_outputvolts" if self._mode in (1, 3) and not self.faults.stuck:
                self._counts = int(values["voltage"])
                self.sets_done += 1
            case "pz_set_poscontrolmode":
                self._mode = int(values["mode"])
            case "pz_set_inputvoltssrc":
                self._source = int(values["inputs"])
            case "pz_set_tpz_iosettings" if values["voltage_limit"] in VOLTAGE_LIMITS_V:
                self._io = dict(values)
            case "mod_set_chanenablestate":
                self._state = int(values["state"])
