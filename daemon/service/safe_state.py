"""Bring the outputs to their configured state without the loop: after the core's death."""

import math
import sys

from dehyst.daemon import clock, notify
from dehyst.daemon.config import Config, Controller
from dehyst.daemon.files.known_units import ACTUATOR, expect_known
from dehyst.daemon.loop.checks import check_limits, past_output
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.drivers.interface import DeviceGone, DeviceNotFound, DeviceTimeout, ProtocolError
from dehyst.drivers.registry import load_actuator
from dehyst.models.errors import BadInput, DehystError

SHORTEST_PERIOD_S = 0.005
SPARE_S = 15.0
TRY_AGAIN_S, PAUSE_S = 5.0, 0.5
PASSING = (DeviceGone, DeviceNotFound, DeviceTimeout, ProtocolError)
"""What may be over at the next attempt: a reply cut off, a port that its last holder still has."""


class _Output:
    """One axis' output on its way. volts: where it stands; goal: where it goes."""

    def __init__(self, config: Config) -> None:
        self.config = config
        actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
        try:
            expect_known(config, ACTUATOR, actuator)
        except BadInput as error:  # a bad folder keeps no output from its safe state
            print(f"dehyst safe: {error}", file=sys.stderr)
        actuator.open()
        self.link = DeviceLink("actuator", actuator)
        try:
            check_limits(config, actuator.spec)
            past, _ = past_output(config, float(actuator.output()), actuator)
        except BaseException:
            self.link.close()
            raise
        self.volts = float(past[-1])
        self.goal = config.safe.voltage_v if config.safe.on_fault == "ramp" else self.volts
        self.least_period_s = max(SHORTEST_PERIOD_S, 1.0 / actuator.spec.max_rate_hz)

    @property
    def left_s(self) -> float:
        """How long its ramp still takes."""
        return abs(self.goal - self.volts) / self.config.safe.ramp_v_per_s

    def step(self, period_s: float) -> None:
        """The next step of the ramp."""
        way = self.goal - self.volts
        if way:
            most = self.config.safe.ramp_v_per_s * period_s
            self.volts += math.copysign(min(most, abs(way)), way)
            self.link.call(self.link.device.write, self.volts)


def make_safe(controller: Controller) -> dict[str, float]:
    """Ramp every output to its safe voltage, all at the same time, or leave it, as `safe.on_fault`
    says; volts by the axes' names in keys.

    One that cannot be reached keeps no other from its safe state, and is tried again for
    TRY_AGAIN_S: nothing behind this sees to it. Raises its DriverError then.
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
    """One attempt: the outputs that have reached their state, and why the others have not."""
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
            output.link.close()
    done = [output for output in outputs if output.config.name not in errors]
    return {output.config.name: output.volts for output in done}, errors


def _ramp(outputs: list[_Output], errors: dict[str, DehystError]) -> None:
    """Step by step; an output that fails is left out from there on."""
    moving = [output for output in outputs if output.left_s > 0]
    if not moving:
        return
    # one after the other writes to what may be one unit; systemd waits for the longest ramp,
    # whatever TimeoutStopSec= says
    period_s = max(output.least_period_s for output in moving)
    longest_s = max(output.left_s for output in moving)
    notify.send(f"EXTEND_TIMEOUT_USEC={round(1e6 * (1.5 * longest_s + SPARE_S))}")
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
