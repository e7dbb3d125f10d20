"""A simulated amplifier and a simulated strain gauge in this process, on one simulated stage.

Both drivers are made from settings; those that name the same `stage` share it. Either table may
hold stage parameters (see stage_settings.py); what both say must agree.

    [actuator.settings]              [sensor.settings]
    stage = "a"                      stage = "a"
    stroke_um = 17.4                 sensor_noise_um = 0.02

Time is the clock's, or, with `period_s`, virtual: every write lets exactly that much time pass
under the voltage just written, so that a run repeats bit for bit.
"""

import dataclasses
import math
import time
import weakref
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from dehyst.drivers.interface import DeviceGone, DeviceSpec, DriverConfigError, OutOfRange
from dehyst.drivers.stage import Stage, warm_up
from dehyst.drivers.stage_settings import STAGE_KEYS, StageSettings

if TYPE_CHECKING:  # the compiled functions are made where somebody asks for them
    from dehyst.drivers.direct import Addresses, Direct

MAX_RATE_HZ = 20_000.0
LATENCY_S = 1e-5
ACTUATOR_KEYS = ("min_v", "max_v")


class SharedStage:
    """One simulated stage and who uses it. `plugged = False` pulls its plug, for tests.

    clock_ns, sleep: injected; by default the monotonic clock and time.sleep.
    """

    def __init__(self, name: str, clock_ns: Callable[[], int], sleep: Callable[[float], None]):
        self.name = name
        self.clock_ns = clock_ns
        self.sleep = sleep
        self.given: dict[str, Any] = {}
        self.users = 0
        self.switches = np.array([1, 0])  # plugged, origin of time [ns]: the compiled loop's too
        self._stage: Stage | None = None

    @property
    def plugged(self) -> bool:
        """False: every call raises DeviceGone."""
        return bool(self.switches[0])

    @plugged.setter
    def plugged(self, value: bool) -> None:
        self.switches[0] = value

    @property
    def period_s(self) -> float:
        """Virtual time per write; 0: the clock's time."""
        return float(self.given.get("period_s", 0.0))

    def settings(self) -> StageSettings:
        """The stage's settings as far as they were given."""
        return StageSettings.from_mapping({k: v for k, v in self.given.items() if k in STAGE_KEYS})

    @property
    def idle(self) -> bool:
        """True when the stage has been used and nobody has it open now."""
        return self.users == 0 and self._stage is not None

    @property
    def stage(self) -> Stage:
        """The stage; made when it is first needed."""
        if self._stage is None:
            self._stage = Stage(self.settings())
        return self._stage

    def merge(self, given: Mapping[str, Any]) -> None:
        """Add one driver's keys; DriverConfigError where they contradict what is there."""
        for key, value in given.items():
            if key in self.given and self.given[key] != value:
                raise DriverConfigError(
                    f"simulated stage '{self.name}': {key} = {value!r} here, but "
                    f"{self.given[key]!r} in the other driver of this stage"
                )
        new = {k: v for k, v in given.items() if k not in self.given}
        if new and self._stage is not None:
            raise DriverConfigError(
                f"simulated stage '{self.name}' is running; {sorted(new)[0]} comes too late"
            )
        self.given |= new
        period_s = self.given.get("period_s", 0.0)
        if isinstance(period_s, bool) or not isinstance(period_s, (int, float)):
            raise DriverConfigError(f"simulated: period_s = {period_s!r} must be a number")
        if not 0.0 <= period_s < math.inf:
            raise DriverConfigError(f"simulated: period_s = {period_s} must be 0 or above")
        self.settings()

    def require_plug(self) -> None:
        """Raise DeviceGone while the plug is out."""
        if not self.plugged:
            raise DeviceGone(f"simulated stage '{self.name}' is unplugged")

    def follow_clock(self) -> None:
        """Bring the stage to the present; nothing in virtual time."""
        if not self.period_s:
            self.stage.advance_to(self.clock_ns())

    def context(self, low_v: float, high_v: float) -> "Addresses":
        """This stage for the C functions of simulated_direct.py."""
        from dehyst.drivers import simulated_direct

        self.follow_clock()
        self.switches[1] = self.stage.epoch_ns
        return simulated_direct.context_of(self.stage, self.switches, self.period_s, low_v, high_v)


_stages: weakref.WeakValueDictionary[str, SharedStage] = weakref.WeakValueDictionary()


def shared_stage(
    name: str,
    given: Mapping[str, Any] | None = None,
    clock_ns: Callable[[], int] | None = None,
    sleep: Callable[[float], None] | None = None,
) -> SharedStage:
    """The stage of this name, made if it is not there; it lives as long as a driver holds it.

    A stage that nobody has open gives way to one with other settings.
    """
    shared = _stages.get(name)
    given = given or {}
    if shared is not None and shared.idle:
        differs = any(shared.given.get(key) != value for key, value in given.items())
        shared = None if differs else shared
    if shared is None:
        shared = SharedStage(name, time.monotonic_ns, time.sleep)
    shared.merge(given)
    _stages[name] = shared
    if clock_ns is not None:
        shared.clock_ns = clock_ns
    if sleep is not None:
        shared.sleep = sleep
    return shared


class _Simulated:
    """What both drivers do: the shared stage, opening and closing."""

    kind = ""
    own_keys: tuple[str, ...] = ()
    spec: DeviceSpec

    def __init__(self, shared: SharedStage, own: Mapping[str, float]) -> None:
        self.shared = shared
        self._own = dict(own)
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
        """Make a driver; settings: stage (name), period_s, stage parameters and own keys."""
        known = ("stage", "period_s", *cls.own_keys, *STAGE_KEYS)
        unknown = sorted(set(settings) - set(known))
        if unknown:
            raise DriverConfigError(
                f"simulated {cls.kind}: unknown setting '{unknown[0]}'; known: {', '.join(known)}"
            )
        name = settings.get("stage", "default")
        if not isinstance(name, str) or not name:
            raise DriverConfigError(f"simulated {cls.kind}: stage = {name!r} must be a name")
        own = {key: settings[key] for key in cls.own_keys if key in settings}
        for key, value in own.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise DriverConfigError(f"simulated {cls.kind}: {key} = {value!r} is no number")
        given = {k: v for k, v in settings.items() if k != "stage" and k not in cls.own_keys}
        return cls(shared_stage(name, given, clock_ns, sleep), own)

    def open(self) -> None:
        """Start using the stage; it stays where it is."""
        self.shared.require_plug()
        warm_up()
        if not self._open:
            self._open = True
            self.shared.users += 1
        self.spec = self._spec()
        self.shared.follow_clock()

    def reconnect(self) -> None:
        """After DeviceGone: use the stage again; it stays where it is."""
        self.open()

    def close(self) -> None:
        """Stop using the stage; it stays where it is. Safe to call twice."""
        if self._open:
            self._open = False
            self.shared.users -= 1

    def _ready(self) -> Stage:
        if not self._open:
            raise DeviceGone(f"simulated {self.kind} is not open")
        self.shared.require_plug()
        self.shared.follow_clock()
        return self.shared.stage


class SimulatedActuator(_Simulated):
    """The amplifier of a simulated stage. Settings: stage, period_s, min_v (0), max_v (full
    scale), and any stage parameter."""

    kind = "actuator"
    own_keys = ACTUATOR_KEYS

    def _spec(self) -> DeviceSpec:
        stage = self.shared.settings()
        low = self._own.get("min_v", 0.0)
        high = self._own.get("max_v", stage.full_scale_v)
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
            identity=f"simulated amplifier, stage '{self.shared.name}'",
        )

    def write(self, volts: float) -> None:
        """Command the output [V]. Raises OutOfRange outside the spec, DeviceGone unplugged."""
        stage = self._ready()
        if not self.spec.minimum <= volts <= self.spec.maximum:
            raise OutOfRange(
                f"simulated actuator: {volts} V is outside {self.spec.minimum} to "
                f"{self.spec.maximum} V; nothing was written"
            )
        stage.command(volts)
        if self.shared.period_s:
            stage.advance(self.shared.period_s)

    def output(self) -> float:
        """The last command [V]."""
        return self.shared.stage.command_v

    def direct(self) -> "Direct":
        """How compiled code writes (dehyst.drivers.direct)."""
        from dehyst.drivers import simulated_direct

        return simulated_direct.actuator(self.shared.context(self.spec.minimum, self.spec.maximum))


class SimulatedSensor(_Simulated):
    """The strain gauge of a simulated stage. Settings: stage, period_s, any stage parameter."""

    kind = "sensor"

    def _spec(self) -> DeviceSpec:
        stage = self.shared.settings()
        return DeviceSpec(
            unit="um",
            minimum=stage.origin_um - stage.stroke_um,
            maximum=stage.origin_um + 2.0 * stage.stroke_um,
            resolution=stage.adc_step_um,
            max_rate_hz=MAX_RATE_HZ,
            latency_s=LATENCY_S,
            identity=f"simulated strain gauge, stage '{self.shared.name}'",
        )

    def read(self) -> float:
        """One reading [um]; NaN under the fault "nan". The fault "late" sleeps first."""
        stage = self._ready()
        if stage.late_s > 0.0:
            if self.shared.period_s:
                stage.advance(stage.late_s)
            else:
                self.shared.sleep(stage.late_s)
        return stage.reading_um()

    def direct(self) -> "Direct":
        """How compiled code reads (dehyst.drivers.direct)."""
        from dehyst.drivers import simulated_direct

        return simulated_direct.sensor(self.shared.context(-math.inf, math.inf))


def stage_table(settings: StageSettings) -> dict[str, float]:
    """A stage's settings as a configuration table: what differs from the defaults."""
    default = StageSettings()
    return {
        key: value
        for key, value in dataclasses.asdict(settings).items()
        if value != getattr(default, key)
    }
