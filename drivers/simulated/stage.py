"""The simulated stage: amplifier output, piezo stack, mechanics and bridge, as one object.

The physics is in dehyst.drivers.simulated.kernels; this object holds the state and implements the
faults. The caller passes the time: no clock is read here. A command acts from the moment it is
given; a reading is taken at the present moment.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec import structs

from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.settings import read_values
from dehyst.drivers.simulated import kernels, parts
from dehyst.drivers.simulated.kernels import StageArrays
from dehyst.drivers.simulated.maxwell_slip import COUNT, Floats, build, static_map
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.tuning import TUNING

NS = 1e-9
FAULTS = ("stuck", "nan", "range", "late")
RANGE_FACTOR = 4.0  # a reading out of range: this many strokes above the origin

_slip = functools.lru_cache(maxsize=32)(build)


class SimulatedStage:
    """A simulated stage; deterministic for given settings, commands and times.

    Faults of the reading (`fault`): "stuck" repeats the last one, "nan" returns NaN, "range" shows
    a value far above the stroke, "late" leaves the value correct and asks the reader to answer
    `late_s` later.

    plant: the state in arrays that keep their addresses, for compiled code.
    """

    def __init__(
        self,
        settings: StageSettings | None = None,
        plant: StageArrays | None = None,
        pass_time: Callable[[float], None] | None = None,
    ) -> None:
        """plant, pass_time: for an axis of a Platform, its arrays and what advances time."""
        self.settings = settings or StageSettings()
        self.plant = plant or stage_arrays()
        self._pass_time = pass_time or self._alone
        self.plant.random[0] = self.settings.seed
        self._apply(self.settings)
        self._set("true_um", self.settings.origin_um)
        self._set("bridge_um", self.settings.origin_um)
        self._epoch_ns: int | None = None
        self._fault: tuple[str, float] | None = None
        self._late_s = 0.0
        self._last_reading = self.settings.origin_um

    # -- time and drive ---------------------------------------------------------------------

    def command(self, volts: float) -> None:
        """Set the amplifier's digital command [V] from now on; the output follows in time."""
        if not math.isfinite(volts):
            raise DriverConfigError(f"stage: command {volts} V is not a number")
        self._set("command_v", volts)

    def set_inputs(
        self,
        ext_v: float | None = None,
        other_v: float | None = None,
        temperature_k: float | None = None,
    ) -> None:
        """Set the EXT input [V], the other axis' voltage [V], the temperature [K above start]."""
        pairs = (("ext_v", ext_v), ("other_v", other_v), ("temperature_k", temperature_k))
        for name, value in pairs:
            if value is not None:
                self._set(name, value)

    def advance(self, dt_s: float, volts: float | None = None) -> None:
        """Advance by dt_s seconds, with `volts` commanded from the start (None: unchanged)."""
        if volts is not None:
            self.command(volts)
        if not 0.0 <= dt_s < math.inf:
            raise DriverConfigError(f"stage: cannot advance by {dt_s} s")
        if dt_s == 0.0:
            return
        self._pass_time(dt_s)

    def _alone(self, dt_s: float) -> None:
        held = self.plant.state["command_v"][0]
        kernels.advance_stage(self.plant, dt_s, held, held)

    def advance_to(self, time_ns: int, volts: float | None = None) -> None:
        """Advance to time_ns under the present command, then command `volts`.

        The first call sets the origin of time. A time in the past changes nothing.
        """
        if self._epoch_ns is None:
            self._epoch_ns = time_ns - round(self.time_s / NS)
        self.advance(max(0.0, (time_ns - self._epoch_ns) * NS - self.time_s))
        if volts is not None:
            self.command(volts)

    def settle(self, volts: float, ramp_s: float = 1.0, rest_s: float = 10.0) -> None:
        """Ramp linearly to `volts` over ramp_s and rest there for rest_s; time advances by both."""
        start = self.command_v
        for n in range(200):
            self.advance(ramp_s / 200, start + (volts - start) * (n + 1) / 200)
        self.advance(rest_s)

    def run(
        self,
        t_s: Floats,
        volts: Floats,
        *,
        ext_v: Floats | None = None,
        other_v: Floats | None = None,
        temperature_k: Floats | None = None,
        straight: bool = False,
    ) -> tuple[Floats, Floats]:
        """Return true displacement and reading, (N,) each [um], at times t_s (N,) counted from now.

        volts (N,): volts[k] is commanded at t_s[k], after the reading at t_s[k], and held until
        t_s[k+1] (straight=True: linear interpolation, like an analog source). The other inputs (N,)
        likewise; None leaves them unchanged. Faults are not applied.
        """
        t = np.ascontiguousarray(t_s, dtype=np.float64)
        v = np.ascontiguousarray(volts, dtype=np.float64)
        if t.ndim != 1 or t.shape != v.shape or t.size == 0 or np.any(np.diff(t) <= 0):
            raise DriverConfigError(
                "stage: run() needs times that increase, and a voltage for each"
            )
        if not (np.all(np.isfinite(t)) and np.all(np.isfinite(v))):
            raise DriverConfigError("stage: run() needs finite times and voltages")
        extra = np.empty((3, t.size))
        for row, name, given in zip(
            extra,
            ("ext_v", "other_v", "temperature_k"),
            (ext_v, other_v, temperature_k),
            strict=True,
        ):
            row[:] = self.plant.state[name][0] if given is None else given
        return kernels.run_stage(self.plant, t, v, extra, straight)

    # -- observable quantities --------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Simulated seconds that have passed."""
        return float(self.plant.state["time_s"][0])

    @property
    def epoch_ns(self) -> int:
        """The caller's time at which the stage's time was 0; 0 before advance_to."""
        return self._epoch_ns or 0

    @property
    def command_v(self) -> float:
        """The present command [V]."""
        return float(self.plant.state["command_v"][0])

    @property
    def drive_v(self) -> float:
        """Voltage at the piezo, after the slew limit and the RC [V]."""
        return float(self.plant.state["drive_v"][0])

    @property
    def displacement_um(self) -> float:
        """True displacement [um]."""
        return float(self.plant.state["true_um"][0])

    def reading_um(self) -> float:
        """Take one reading [um]: filter, delay, fresh noise, ADC, and any active fault."""
        kind = self.reading_fault
        if kind == "stuck":
            return self._last_reading
        plant = self.plant
        shown = float(parts.reading(plant.parameters, plant.state, plant.ring, plant.random))
        if kind == "nan":
            return math.nan
        if kind == "range":
            return self.settings.origin_um + RANGE_FACTOR * self.settings.stroke_um
        self._last_reading = shown
        return shown

    # -- faults and changes -----------------------------------------------------------------

    def fault(self, kind: str, for_s: float = math.inf, late_s: float = 0.01) -> None:
        """Apply a fault to the readings for the next for_s seconds of the stage's time."""
        if kind not in FAULTS:
            raise DriverConfigError(f"unknown stage fault '{kind}'; known: {', '.join(FAULTS)}")
        self._fault = (kind, self.time_s + for_s)
        self._late_s = late_s

    def clear_fault(self) -> None:
        """End the fault: readings are correct again."""
        self._fault = None

    @property
    def reading_fault(self) -> str | None:
        """The active fault, or None."""
        if self._fault is not None and self.time_s >= self._fault[1]:
            self._fault = None
        return None if self._fault is None else self._fault[0]

    @property
    def late_s(self) -> float:
        """How much later than usual a reader must answer now [s]."""
        return self._late_s if self.reading_fault == "late" else 0.0

    def change(self, *, jump: bool = False, **settings: float) -> None:
        """Change settings at run time; the state and the displacement are kept.

        With jump=True a new gain moves the stage at once; otherwise it acts from here on.
        """
        new = structs.replace(self.settings, **read_values(StageSettings, settings))
        before = self.displacement_um
        delayed = self.settings.sensor_delay_s
        self._apply(new)
        self.settings = new
        if "seed" in settings:
            self.plant.random[0] = new.seed
        if new.sensor_delay_s > 0 and delayed == 0:
            self.plant.ring[0, parts.RING] = 1.0
            self.plant.ring[:, 0] = self.time_s, self.plant.state["bridge_um"][0]
            self._set("pushed_s", self.time_s)
        self._refresh_strain()
        now = float(parts.displacement(self.plant.parameters[0], self.plant.state[0]))
        if not jump:
            self._set("shift_um", float(self.plant.state["shift_um"][0]) + before - now)
            now = before
        self._set("true_um", now)

    def _refresh_strain(self) -> None:
        """Recompute strain and creep under new parameters, from the present springs."""
        s, p = self.plant.state, self.plant.parameters
        x = self.drive_v / p["full_scale_v"][0]
        slip = float(self.plant.elements[1] @ self.plant.springs)
        share = float(s["mode"][0] - s["creep"][0])
        strain = static_map(float(p["asymmetry"][0]), (x - slip) / float(p["norm"][0]))
        creep = parts.creep_sum(p[0], self.plant.relax, strain)
        for name, value in (("slip", slip), ("strain", strain), ("creep", creep)):
            self._set(name, value)
        self._set("mode", creep + share)

    def _apply(self, settings: StageSettings) -> None:
        slip = _slip(settings.hysteresis_width, settings.asymmetry)
        self.plant.elements[:] = slip.d, slip.k, slip.bow
        table: dict[str, Any] = structs.asdict(settings)
        at_tenth = -np.expm1(-0.1 / parts.CREEP_TAUS_S).sum() / parts.CREEP_PER_DECADE
        table |= {
            "creep_static": -at_tenth,
            "norm": slip.norm,
            "substep_s": _substep_s(settings),
            "quiet_s": _quiet_s(settings),
        }
        for name in parts.PARAMETERS:
            self.plant.parameters[name] = table[name]

    def _set(self, name: str, value: float) -> None:
        self.plant.state[name] = value


def stage_arrays() -> StageArrays:
    """Return a stage at rest, all 0."""
    return StageArrays(
        parameters=np.zeros(1, parts.PARAMETERS_T),
        elements=np.zeros((3, COUNT)),
        state=np.zeros(1, parts.STATE_T),
        springs=np.zeros(COUNT),
        relax=np.zeros(parts.CREEP_TAUS_S.size),
        ring=np.zeros((2, parts.RING + 1)),
        random=np.zeros(1, dtype=np.uint64),
    )


def _substep_s(settings: StageSettings) -> float:
    """Return the longest sub-step in motion: it resolves the RC corner, the mode and the hum."""
    taus = (settings.rc_tau_s, settings.amplifier_tau_s)
    limits = [TUNING.longest_substep_s]
    limits += [tau / TUNING.substeps_per_tau for tau in taus if tau > 0]
    if settings.sensor_tau_s > 0:
        limits.append(settings.sensor_tau_s / TUNING.substeps_per_sensor_tau)
    if settings.mode_hz > 0:
        limits.append(1 / (TUNING.substeps_per_oscillation * settings.mode_hz))
    if settings.cross_share > 0 and settings.cross_hz > 0:
        limits.append(1 / (TUNING.substeps_per_oscillation * settings.cross_hz))
    limits.append(_quiet_s(settings))
    return max(min(limits), TUNING.shortest_substep_s)


def _quiet_s(settings: StageSettings) -> float:
    """Return the longest sub-step at rest: it resolves the hum, which continues."""
    if settings.hum_um and settings.hum_hz:
        return 1 / (TUNING.substeps_per_hum * settings.hum_hz)
    return TUNING.longest_substep_s
