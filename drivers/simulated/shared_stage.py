"""The simulated stage that amplifiers and gauges share, found by its name and their axis.

Time is the clock's or, with `period_s`, virtual: once each axis with an open amplifier has been
written, exactly that much time passes under the voltages just written, so a run repeats bit for
bit.
"""

import time
import weakref
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dehyst.drivers.interface import DeviceGone, DriverConfigError
from dehyst.drivers.simulated.axes import DRIVEN, EPOCH, PLUGGED, WRITTEN, N, Platform
from dehyst.drivers.simulated.settings import AXES, STAGE_KEYS, StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.models.addresses import Addresses


class SharedPlatform:
    """A simulated stage, the clock it follows, and the switches of its devices.

    clock_ns, sleep: injected; by default the monotonic clock and time.sleep.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.clock_ns: Callable[[], int] = time.monotonic_ns
        self.sleep: Callable[[float], None] = time.sleep
        self.period_s: float | None = None  # None: not given yet, used as 0
        self.platform = Platform()
        self.switches = np.array([1] * N + [0] * (2 * N + 1))
        self.axes: weakref.WeakValueDictionary[str, SharedStage] = weakref.WeakValueDictionary()

    def follow_clock(self) -> None:
        """Advance the stage to the present; do nothing in virtual time."""
        if not self.period_s:
            self.platform.advance_to(self.clock_ns())

    def write(self, place: int, stage: SimulatedStage, volts: float) -> None:
        """Write to an axis. In virtual time, time advances when all axes have been written, and
        before an axis is written for the second time."""
        written, driven = self.switches[WRITTEN:EPOCH], self.switches[DRIVEN:WRITTEN]
        if self.period_s and written[place]:
            self._pass_sample(self.period_s)
        stage.command(volts)
        written[place] = 1
        if self.period_s and np.all(written >= driven):
            self._pass_sample(self.period_s)

    def _pass_sample(self, period_s: float) -> None:
        self.platform.advance(period_s)
        self.switches[WRITTEN:EPOCH] = 0


class SharedStage:
    """One axis of a simulated stage and its users. `plugged = False` unplugs it."""

    def __init__(self, shared: SharedPlatform, axis: str) -> None:
        self.platform = shared
        self.axis = axis
        self.place = AXES.index(axis)
        self.given: dict[str, Any] = {}
        self.users = 0

    @property
    def name(self) -> str:
        """The stage's name."""
        return self.platform.name

    @property
    def title(self) -> str:
        """The stage's name, and the axis if it has several."""
        alone = len(self.platform.axes) == 1 and self.axis == AXES[0]
        return f"stage '{self.name}'" + ("" if alone else f", axis {self.axis}")

    @property
    def plugged(self) -> bool:
        """If False, every call raises DeviceGone."""
        return bool(self.platform.switches[PLUGGED + self.place])

    @plugged.setter
    def plugged(self, value: bool) -> None:
        self.platform.switches[PLUGGED + self.place] = value

    def drive(self, on: bool) -> None:
        """Note that the amplifier was opened or closed: virtual time waits for it, or no longer."""
        self.platform.switches[DRIVEN + self.place] = on

    @property
    def period_s(self) -> float:
        """Virtual time per sample; 0: the clock's time."""
        return float(self.platform.period_s or 0.0)

    def settings(self) -> StageSettings:
        """The axis' settings that have been given so far."""
        return StageSettings(**{k: v for k, v in self.given.items() if k in STAGE_KEYS})

    @property
    def idle(self) -> bool:
        """True when the axis has been used but nobody has it open now."""
        return self.users == 0 and self.axis in self.platform.platform.axes

    @property
    def stage(self) -> SimulatedStage:
        """The axis; it is made on first use."""
        made = self.platform.platform
        return made.axes.get(self.axis) or made.add(self.axis, self.settings())

    def merge(self, given: Mapping[str, Any]) -> None:
        """Add and check one driver's keys; raise DriverConfigError if they contradict others."""
        known = dict(self.given)
        if self.platform.period_s is not None or self.platform.platform.axes:
            known["period_s"] = self.period_s
        for key, value in given.items():
            if key in known and known[key] != value:
                raise DriverConfigError(
                    f"simulated {self.title}: {key} = {value!r} here, but "
                    f"{known[key]!r} in the other driver of this stage"
                )
        new = {k: v for k, v in given.items() if k not in known}
        if new and self.axis in self.platform.platform.axes:
            raise DriverConfigError(
                f"simulated {self.title} is running; {sorted(new)[0]} can no longer be set"
            )
        self.platform.period_s = new.pop("period_s", self.platform.period_s)
        self.given |= new
        self.settings()

    def require_plug(self) -> None:
        """Raise DeviceGone while unplugged."""
        if not self.plugged:
            raise DeviceGone(f"simulated {self.title} is unplugged")

    def follow_clock(self) -> None:
        """Advance the stage to the present; do nothing in virtual time."""
        self.stage  # noqa: B018  its time begins with its first use
        self.platform.follow_clock()

    def context(self, low_v: float, high_v: float) -> "Addresses":
        """Return the context of this axis for the C functions of direct_calls.py."""
        from dehyst.drivers.simulated import direct_calls

        shared = self.platform
        self.follow_clock()
        shared.switches[EPOCH] = shared.platform.epoch_ns
        return direct_calls.context_of(
            shared.platform.arrays, shared.switches, (self.period_s, low_v, high_v, self.place)
        )


_platforms: weakref.WeakValueDictionary[str, SharedPlatform] = weakref.WeakValueDictionary()


def shared_stage(
    name: str,
    given: Mapping[str, Any] | None = None,
    clock_ns: Callable[[], int] | None = None,
    sleep: Callable[[float], None] | None = None,
    axis: str = AXES[0],
) -> SharedStage:
    """Return an axis of the stage of this name, made on first use; it exists as long as a driver
    refers to it.

    A stage of which no axis is open is replaced when other settings are given.
    """
    shared = _platforms.get(name)
    given = given or {}
    if shared is not None:
        known = dict(shared.axes)
        own = known[axis].given | {"period_s": shared.period_s} if axis in known else {}
        differs = any(own.get(key) != value for key, value in given.items())
        if axis in known and differs and all(one.idle for one in known.values()):
            shared = None
    shared = shared or SharedPlatform(name)
    found = shared.axes.get(axis) or SharedStage(shared, axis)
    found.merge(given)
    shared.axes[axis] = found
    _platforms[name] = shared
    if clock_ns is not None:
        shared.clock_ns = clock_ns
    if sleep is not None:
        shared.sleep = sleep
    return found
