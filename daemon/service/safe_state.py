"""Bring the outputs to their configured safe state without the loop, after the core has died."""

import math
import sys

from dehyst.daemon import clock, notify
from dehyst.daemon.config import Config, Controller
from dehyst.daemon.files.known_units import ACTUATOR, expect_known
from dehyst.daemon.loop.checks import check_limits, note_output, past_output
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.drivers.interface import DeviceGone, DeviceNotFound, DeviceTimeout, ProtocolError
from dehyst.drivers.registry import load_actuator
from dehyst.models.errors import BadInput, DehystError

SHORTEST_PERIOD_S = 0.005  # between two steps of a ramp: 0.25 V at the default of 50 V/s
SLOWER = 1.5  # times the calculated duration of a ramp: a busy line delays its steps
SPARE_S = 15.0  # in addition to a ramp's duration: for slow devices, a busy machine
TRY_AGAIN_S, PAUSE_S = 5.0, 0.5  # for a device that stalls; between two tries
NOTE_S = 0.02
"""The output is noted this often during a ramp, so that a start after a killed `dehyst safe` is off
by this much of a ramp at most; the default ramp of 50 V/s then stays within OUTPUT_AGREES_V."""
PASSING = (DeviceGone, DeviceNotFound, DeviceTimeout, ProtocolError)
"""Errors that may have passed at the next attempt: a truncated reply, a port that its last user
still holds."""


class _Output:
    """One axis' output during its ramp. volts: present output; goal: final output [V]."""

    def __init__(self, config: Config) -> None:
        self.config = config
        actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
        try:
            expect_known(config, ACTUATOR, actuator)
        except BadInput as error:  # a bad folder must not keep an output from its safe state
            print(f"dehyst safe: {error}", file=sys.stderr)
        actuator.open()
        self.link = DeviceLink("actuator", actuator)
        try:
            check_limits(config, actuator.spec)
            past, _ = past_output(config, float(actuator.output()), actuator)
        except BaseException:
            self.link.close()
            raise
        self.volts, self._noted_ns = float(past[-1]), 0
        self.goal = config.safe.voltage_v if config.safe.on_fault == "ramp" else self.volts
        self.least_period_s = max(SHORTEST_PERIOD_S, 1.0 / actuator.spec.max_rate_hz)

    @property
    def left_s(self) -> float:
        """Remaining duration of the ramp [s]."""
        return abs(self.goal - self.volts) / self.config.safe.ramp_v_per_s

    def step(self, period_s: float) -> None:
        """Write the next step of the ramp."""
        way = self.goal - self.volts
        if way:
            most = self.config.safe.ramp_v_per_s * period_s
            volts = self.volts + math.copysign(min(most, abs(way)), way)
            self.link.call(self.link.device.write, volts)
            self.volts = volts  # only now: the next attempt starts from what was written
            if clock.monotonic_ns() - self._noted_ns >= NOTE_S * clock.NS:
                self.note()

    def note(self) -> None:
        """Note the output for whoever drives it next."""
        self._noted_ns = clock.monotonic_ns()
        note_output(self.config, self.volts)


def make_safe(controller: Controller) -> dict[str, float]:
    """Ramp all outputs to their safe voltages at the same time, or leave them, as `safe.on_fault`
    says; return the volts by axis name.

    An output that cannot be reached does not keep the others from their safe state. It is tried
    again for TRY_AGAIN_S, because nothing after this takes care of it; then its DriverError is
    raised.
    """
    volts: dict[str, float] = {}
    errors: dict[str, DehystError] = {}
    left, end_ns = list(controller.axes), clock.monotonic_ns() + round(TRY_AGAIN_S * clock.NS)
    while left:
        safe, failed = _once(left)
        volts, errors = volts | safe, errors | failed
        left = [config for config in left if isinstance(failed.get(config.name), PASSING)]
        if clock.monotonic_ns() > end_ns:
            break
        if left:
            clock.sleep_s(PAUSE_S)
    for name, failed_with in errors.items():
        if name in volts:
            continue
        if len(controller.axes) > 1:
            raise type(failed_with)(f"{name}: {failed_with}") from failed_with
        raise failed_with
    return {config.name: volts[config.name] for config in controller.axes}


def _once(axes: list[Config]) -> tuple[dict[str, float], dict[str, DehystError]]:
    """Make one attempt; return the outputs that have reached their state and the errors of the
    others."""
    outputs: list[_Output] = []
    errors: dict[str, DehystError] = {}
    try:
        for config in axes:
            try:
                outputs.append(_Output(config))
            except DehystError as error:
                errors[config.name] = error
        _ramp(outputs, errors)
    finally:
        for output in outputs:
            output.note()
            output.link.close()
    done = [output for output in outputs if output.config.name not in errors]
    return {output.config.name: output.volts for output in done}, errors


def _ramp(outputs: list[_Output], errors: dict[str, DehystError]) -> None:
    """Ramp the outputs step by step; one that fails is left out from then on."""
    moving = [output for output in outputs if output.left_s > 0]
    if not moving:
        return
    # the axes are written in turn, because they may be on one unit; systemd must wait for the
    # longest ramp, whatever TimeoutStopSec= says
    period_s = max(output.least_period_s for output in moving)
    longest_s = max(output.left_s for output in moving)
    notify.send(f"EXTEND_TIMEOUT_USEC={round(1e6 * (SLOWER * longest_s + SPARE_S))}")
    while moving:
        begun_ns = clock.monotonic_ns()
        for output in list(moving):
            try:
                output.step(period_s)
            except DehystError as error:
                errors[output.config.name] = error
                moving.remove(output)
        moving = [output for output in moving if output.left_s > 0]
        clock.sleep_s(max(0.0, period_s - (clock.monotonic_ns() - begun_ns) / clock.NS))
