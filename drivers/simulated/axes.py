"""A stage of several axes: each is a SimulatedStage, and each moves the others slightly.

    x = own motion of x + from_y (own motion of y) + from_z (own motion of z),  a share of the
    sum passes through a mode of the platform; likewise y and z.

All axes are stored in one set of arrays (kernels.PlatformArrays), so that time advances for all of
them at once, from Python and from compiled code.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.settings import read_settings
from dehyst.drivers.simulated import kernels, parts
from dehyst.drivers.simulated.kernels import PlatformArrays
from dehyst.drivers.simulated.maxwell_slip import COUNT
from dehyst.drivers.simulated.settings import AXES, StageSettings
from dehyst.drivers.simulated.stage import NS, SimulatedStage

# Switches of a shared stage, also used by the compiled loop: for each axis 1 when it is plugged in,
# 1 while its amplifier is open, 1 when it has been written since time last advanced; and the origin
# of time [ns]
N = len(AXES)
PLUGGED, DRIVEN, WRITTEN, EPOCH = 0, N, 2 * N, 3 * N

SEED_STEP = 7919  # between axes: each has its own noise although the settings give one seed


OTHERS: dict[str, dict[str, float]] = {
    "x": {"from_y": 0.025, "from_z": -0.012, "cross_share": 0.4},
    "y": {
        "stroke_um": 16.1,
        "hysteresis_width": 0.1,
        "asymmetry": 0.1,
        "mode_hz": 690.0,
        "from_x": -0.02,
        "from_z": 0.015,
        "cross_share": 0.4,
    },
    "z": {
        "stroke_um": 18.2,
        "hysteresis_width": 0.14,
        "creep_gain_per_decade": 0.014,
        "mode_hz": 910.0,
        "from_x": 0.015,
        "from_y": 0.02,
        "cross_share": 0.4,
    },
}
"""Settings that distinguish the axes of a stage with several: each has its own hysteresis and is
moved by the others."""


def settings_by_axis(
    axes: Sequence[str], given: Mapping[str, Mapping[str, Any]]
) -> dict[str, StageSettings]:
    """Return the settings of each axis: the plain stage for a single axis, else OTHERS, updated
    with the given ones (axis -> settings). Raises DriverConfigError."""
    known = OTHERS if len(axes) > 1 else {}
    return {a: read_settings(StageSettings, {**known.get(a, {}), **given.get(a, {})}) for a in axes}


class Platform:
    """Up to three axes, x, y and z, of one simulated stage; an axis may be added later.

    arrays: the state, which keeps its address, for compiled code; axes: the stages by name.
    `advance` of any axis, or of this object, advances the time of all.
    """

    def __init__(self, settings: Mapping[str, StageSettings] | None = None) -> None:
        self.arrays = PlatformArrays(
            parameters=np.zeros(N, parts.PARAMETERS_T),
            elements=np.zeros((3 * N, COUNT)),
            state=np.zeros(N, parts.STATE_T),
            springs=np.zeros((N, COUNT)),
            relax=np.zeros((N, parts.CREEP_TAUS_S.size)),
            ring=np.zeros((2 * N, parts.RING + 1)),
            random=np.zeros(N, dtype=np.uint64),
            present=np.zeros(N, dtype=np.int64),
        )
        self.axes: dict[str, SimulatedStage] = {}
        self._epoch_ns: int | None = None
        for axis, one in (settings or {}).items():
            self.add(axis, one)

    def add(self, axis: str, settings: StageSettings) -> SimulatedStage:
        """Add an axis, at rest from now on. Raises DriverConfigError."""
        if axis not in AXES or axis in self.axes:
            raise DriverConfigError(f"simulated stage: axis '{axis}' must be x, y or z, each once")
        if getattr(settings, f"from_{axis}"):
            raise DriverConfigError(
                f"simulated stage: from_{axis} of axis {axis} must be 0; it couples other axes only"
            )
        place = AXES.index(axis)
        stage = SimulatedStage(settings, kernels.axis_of.py_func(self.arrays, place), self.advance)
        self.arrays.random[place] = settings.seed + SEED_STEP * place
        stage.plant.state["time_s"] = self.time_s
        self.arrays.present[place] = 1
        self.axes[axis] = stage
        return stage

    @property
    def time_s(self) -> float:
        """Simulated seconds that have passed."""
        return float(np.max(self.arrays.state["time_s"]))

    @property
    def epoch_ns(self) -> int:
        """The caller's time at which the stage's time was 0; 0 before advance_to."""
        return self._epoch_ns or 0

    def advance(self, dt_s: float) -> None:
        """Advance by dt_s seconds under the present commands."""
        kernels.advance_platform(self.arrays, dt_s)

    def advance_to(self, time_ns: int) -> None:
        """Advance to time_ns; the first call sets the time origin. Past times do nothing."""
        if self._epoch_ns is None:
            self._epoch_ns = time_ns - round(self.time_s / NS)
        dt_s = (time_ns - self._epoch_ns) * NS - self.time_s
        if dt_s > 0.0:
            self.advance(dt_s)


@functools.cache
def compile_stage() -> None:
    """Compile the kernels, or load them from numba's cache, before a clock starts."""
    stage = Platform({"x": StageSettings()}).axes["x"]
    stage.advance(1e-3, 1.0)
    stage.reading_um()
