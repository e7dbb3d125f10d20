"""A simulated amplifier and a simulated strain gauge in this process, on one simulated stage.

Both drivers are made from settings; those that name the same `stage` share it, and of a stage with
several axes each pair of drivers has its `axis`. Either table may hold parameters of the axis (see
settings.py); a parameter given in both must have the same value.

    [actuator.settings]              [sensor.settings]
    stage = "a"                      stage = "a"
    stroke_um = 17.4                 sensor_noise_um = 0.02
"""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

from dehyst.drivers.driver import out_of_range
from dehyst.drivers.interface import DeviceGone, DeviceSpec, DriverConfigError
from dehyst.drivers.settings import read_settings
from dehyst.drivers.simulated.axes import compile_stage
from dehyst.drivers.simulated.settings import (
    SHARED_KEYS,
    SimulatedActuatorSettings,
    SimulatedSensorSettings,
    SimulatedSettings,
)
from dehyst.drivers.simulated.shared_stage import SharedStage, shared_stage
from dehyst.drivers.simulated.stage import SimulatedStage

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct

MAX_RATE_HZ = 20_000.0  # the highest loop.rate_hz
LATENCY_S = 1e-5  # of a call from Python: 0.0098 ms (tests/benchmarks/drivers/rates.py)


class _Simulated:
    """Shared parts of both drivers: the shared stage, opening and closing."""

    settings_type: ClassVar[type[SimulatedSettings]]
    spec: DeviceSpec

    def __init__(self, shared: SharedStage, settings: SimulatedSettings) -> None:
        self.shared = shared
        self.settings = settings
        self._open = False
        self.spec = self._spec()

    def _spec(self) -> DeviceSpec:
        raise TypeError(f"{type(self).__name__} has no spec")

    @classmethod
    def from_settings(
        cls,
        settings: Mapping[str, Any],
        clock_ns: Callable[[], int] | None = None,
        sleep: Callable[[float], None] | None = None,
    ) -> Self:
        """Make a driver; DriverConfigError names a wrong key."""
        checked = read_settings(cls.settings_type, settings)
        given = {key: getattr(checked, key) for key in settings if key in SHARED_KEYS}
        return cls(shared_stage(checked.stage, given, clock_ns, sleep, checked.axis), checked)

    def open(self) -> None:
        """Start using the stage without moving it."""
        self.shared.require_plug()
        compile_stage()
        if not self._open:
            self._open = True
            self.shared.users += 1
            self._switch(True)
        self.spec = self._spec()
        self.shared.follow_clock()

    def reconnect(self) -> None:
        """After DeviceGone, use the stage again without moving it."""
        self.open()

    def close(self) -> None:
        """Stop using the stage without moving it. Safe to call twice."""
        if self._open:
            self._open = False
            self.shared.users -= 1
            self._switch(False)

    def _switch(self, on: bool) -> None:
        """Handle opening (on) or closing; the amplifier overrides it."""

    def _ready(self) -> SimulatedStage:
        if not self._open:
            raise DeviceGone(f"the {self.settings.driver} is not open")
        self.shared.require_plug()
        self.shared.follow_clock()
        return self.shared.stage


class SimulatedActuator(_Simulated):
    """The amplifier of a simulated stage."""

    settings_type = SimulatedActuatorSettings
    settings: SimulatedActuatorSettings

    def _spec(self) -> DeviceSpec:
        stage = self.shared.settings()
        low, high = self.settings.min_v, self.settings.max_v
        high = stage.full_scale_v if high is None else high
        if not low < high:
            raise DriverConfigError(f"simulated actuator: min_v = {low} is not below {high}")
        if low < stage.clip_min_v or high > stage.clip_max_v:
            raise DriverConfigError(
                f"simulated actuator: {low} to {high} V is wider than the amplifier's "
                f"{stage.clip_min_v} to {stage.clip_max_v} V (clip_min_v, clip_max_v)"
            )
        return DeviceSpec(
            unit="v",
            minimum=low,
            maximum=high,
            resolution=stage.dac_step_v,
            max_rate_hz=MAX_RATE_HZ,
            latency_s=LATENCY_S,
            identity=f"simulated amplifier, {self.shared.title}",
        )

    def write(self, volts: float) -> None:
        """Command the output [V]. Raises OutOfRange outside the spec, DeviceGone when unplugged."""
        stage = self._ready()
        if not self.spec.minimum <= volts <= self.spec.maximum:
            raise out_of_range("simulated actuator", volts, self.spec.minimum, self.spec.maximum)
        self.shared.platform.write(self.shared.place, stage, volts)

    def _switch(self, on: bool) -> None:
        self.shared.drive(on)

    def output(self) -> float:
        """Return the last command [V]."""
        return self.shared.stage.command_v

    def direct(self) -> "Direct":
        """Return the C function that writes (dehyst.drivers.direct_calls)."""
        from dehyst.drivers.simulated import direct_calls

        return direct_calls.actuator(self.shared.context(self.spec.minimum, self.spec.maximum))


class SimulatedSensor(_Simulated):
    """The strain gauge of a simulated stage."""

    settings_type = SimulatedSensorSettings

    def _spec(self) -> DeviceSpec:
        stage = self.shared.settings()
        return DeviceSpec(
            unit="um",
            minimum=stage.origin_um - stage.stroke_um,
            maximum=stage.origin_um + 2.0 * stage.stroke_um,
            resolution=stage.adc_step_um,
            max_rate_hz=MAX_RATE_HZ,
            latency_s=LATENCY_S,
            identity=f"simulated strain gauge, {self.shared.title}",
        )

    def read(self) -> float:
        """Take one reading [um]; NaN during the fault "nan". The fault "late" sleeps first."""
        stage = self._ready()
        if stage.late_s > 0.0:
            if self.shared.period_s:
                stage.advance(stage.late_s)
            else:
                self.shared.platform.sleep(stage.late_s)
        return stage.reading_um()

    def direct(self) -> "Direct":
        """Return the C function that reads (dehyst.drivers.direct_calls)."""
        from dehyst.drivers.simulated import direct_calls

        return direct_calls.sensor(self.shared.context(-math.inf, math.inf))
