"""The simulated stage that an amplifier and a gauge share, by its name.

Time is the clock's, or, with `period_s`, virtual: every write lets exactly that much time pass
under the voltage just written, so that a run repeats bit for bit.
"""

import time
import weakref
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dehyst.drivers.interface import DeviceGone, DriverConfigError
from dehyst.drivers.simulated.settings import STAGE_KEYS, StageSettings
from dehyst.drivers.simulated.stage import Stage

if TYPE_CHECKING:  # the compiled functions are made where somebody asks for them
    from dehyst.drivers.direct_calls import Addresses


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
        return StageSettings(**{k: v for k, v in self.given.items() if k in STAGE_KEYS})

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
        """Add the keys of one driver, checked; DriverConfigError where they contradict others."""
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
        """This stage for the C functions of direct_calls.py."""
        from dehyst.drivers.simulated import direct_calls

        self.follow_clock()
        self.switches[1] = self.stage.epoch_ns
        return direct_calls.context_of(self.stage, self.switches, self.period_s, low_v, high_v)


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
