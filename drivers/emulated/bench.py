"""The emulated bench: an amplifier, a gauge reader for each axis, a simulated stage between them.

    directory/mdt693b   port of the amplifier        directory/ksg101   port of the strain gauge
    directory/kpz101    the same for a KPZ101, which has one axis
    directory/kpc101    or a KPC101: it has its own gauge, so there is no ksg101
    directory/bpc303    or a BPC303: likewise, its channels are x, y and z
    directory/control   Unix datagram socket that takes faults and changes (control.py)

With several axes each has its KSG101: directory/ksg101-x, ksg101-y, ksg101-z.

The stage follows real time: it is advanced to the present whenever the amplifier's output changes
and whenever the gauge is read. The amplifier unit simulates DAC step, EXT input and clip; the stage
simulates slew, RC and everything after them.
"""

import functools
import os
import time
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from dehyst.drivers.emulated.amplifiers import (
    Amplifier,
    Knobs,
    check_axes,
    has_gauges,
    make_amplifier,
)
from dehyst.drivers.emulated.kpc101_unit import Bpc303Unit, Kpc101Knobs, Kpc101Unit
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.simulated.axes import Platform
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage

NS_PER_S = 1e9


@dataclass(frozen=True)
class BenchSettings:
    """The parts of the bench. axis: the amplifier's axis that drives the stage; more: further axes
    of the stage, each with its own gauge. The voltage of an axis that drives nothing acts through
    the stage's coupling_um_per_v. gauge: its travel also applies to an amplifier's own gauges;
    None: one whose travel covers the stage."""

    stage: StageSettings = field(default_factory=StageSettings)
    amplifier: Knobs = field(default_factory=Mdt693bKnobs)
    gauge: Ksg101Knobs | None = None
    axis: str = "x"
    more: Mapping[str, StageSettings] = field(default_factory=dict)

    @property
    def stages(self) -> dict[str, StageSettings]:
        """Every axis that drives something, the main one first."""
        return {self.axis: self.stage, **self.more}


class BenchLog:
    """Each axis' amplifier output and gauge readings, with times of the bench's clock."""

    def __init__(self) -> None:
        self.axes: dict[str, AxisLog] = {}

    def of(self, axis: str) -> "AxisLog":
        """Return the log of one axis; axes are kept in the order of the first request."""
        return self.axes.setdefault(axis, AxisLog())

    def save(self, path: Path) -> None:
        """Save as .npz: time_ns, volts (output); reading_ns, reading_um, true_um; further axes with
        prefix `y_` etc.; or as .csv: the output of the first axis. The file appears complete or not
        at all."""
        part = path.with_name(path.name + ".part")
        logs = self.axes or {"x": AxisLog()}
        with part.open("wb") as file:
            if path.suffix == ".csv":
                first = next(iter(logs.values()))
                rows = zip(first.output_ns, first.output_v, strict=True)
                text = "time_ns,volts\n" + "".join(f"{t},{v:.9g}\n" for t, v in rows)
                file.write(text.encode())
            else:
                table: dict[str, Any] = {}
                for axis, log in logs.items():
                    head = f"{axis}_" if table else ""
                    table |= {f"{head}{key}": values for key, values in log.arrays().items()}
                np.savez(file, **table)
        os.replace(part, path)


class AxisLog:
    """The part of BenchLog for one axis."""

    def __init__(self) -> None:
        self.output_ns = array("q")
        self.output_v = array("d")
        self.reading_ns = array("q")
        self.reading_um = array("d")
        self.true_um = array("d")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by their names in the file."""
        return {
            "time_ns": np.array(self.output_ns),
            "volts": np.array(self.output_v),
            "reading_ns": np.array(self.reading_ns),
            "reading_um": np.array(self.reading_um),
            "true_um": np.array(self.true_um),
        }


class Bench:
    """Both emulators and the stage. Call every method from the serving thread, or through
    `amplifier.call(...)`; `log` is written only if it is given."""

    def __init__(
        self,
        directory: str | Path,
        settings: BenchSettings | None = None,
        log: BenchLog | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.settings = settings or BenchSettings()
        self.directory = Path(directory)
        self.directory.mkdir(parents=True, exist_ok=True)
        self.log = log
        self._clock = clock
        knobs = self.settings.amplifier
        stages = self.settings.stages
        check_axes(knobs, tuple(stages))
        # the stage must not repeat what the amplifier unit already simulates
        units = {
            "dac_step_v": 0.0,
            "ext_gain": 0.0,
            "clip_min_v": -1.0,
            "clip_max_v": knobs.limit_v + 1.0,
        }
        self._platform = Platform({a: structs.replace(s, **units) for a, s in stages.items()})
        self.stages = self._platform.axes
        if knobs.start_v:
            for stage in self.stages.values():
                stage.settle(knobs.start_v)
        gauge = self.settings.gauge
        self.own_gauges = has_gauges(knobs)
        if isinstance(knobs, Kpc101Knobs):
            wanted = [gauge or covering_gauge(one) for one in stages.values()]
            travel_um = max(one.max_travel_um for one in wanted)
            knobs = structs.replace(knobs, max_travel_um=travel_um)
        self.amplifier: Amplifier = make_amplifier(
            self.directory, knobs, tuple(stages), self._output, self._position, clock
        )
        self.gauges: dict[str, PtyServer] = {}
        self.gauge_units: dict[str, Ksg101Unit | Kpc101Unit | Bpc303Unit] = {}
        for place, (axis, one) in enumerate(stages.items()):
            if isinstance(self.amplifier.unit, Kpc101Unit | Bpc303Unit):
                self.gauges[axis], self.gauge_units[axis] = self.amplifier, self.amplifier.unit
                continue
            knobs_of = gauge or covering_gauge(one)
            unit = Ksg101Unit(
                structs.replace(knobs_of, serial_number=knobs_of.serial_number + place),
                functools.partial(self._position, axis),
                clock,
            )
            name = "ksg101" if len(stages) == 1 else f"ksg101-{axis}"
            self.gauge_units[axis] = unit
            self.gauges[axis] = PtyServer(unit, self.directory / name, clock)

    @property
    def stage(self) -> SimulatedStage:
        """The stage of the first axis."""
        return self.stages[self.settings.axis]

    @property
    def servers(self) -> tuple[PtyServer, ...]:
        """The servers for pty_device.serve(): the amplifier, then the gauges."""
        return tuple(dict.fromkeys((self.amplifier, *self.gauges.values())))

    def ports(self) -> dict[str, str]:
        """The paths that drivers open, by the driver's name, and the control socket."""
        gauges = {server.link_path.name: server.port for server in self.gauges.values()}
        return {
            self.amplifier.link_path.name: self.amplifier.port,
            **gauges,
            "control": str(self.directory / "control"),
        }

    def follow(self) -> None:
        """Advance the stage to the present."""
        self._platform.advance_to(round(self._clock() * NS_PER_S))

    def _output(self, axis: str, volts: float, time_s: float) -> None:
        if axis not in self.stages:
            self.follow()
            for stage in self.stages.values():
                stage.set_inputs(other_v=volts)
            return
        time_ns = round(time_s * NS_PER_S)
        self._platform.advance_to(time_ns)
        self.stages[axis].command(volts)
        if self.log is not None:
            log = self.log.of(axis)
            log.output_ns.append(time_ns)
            log.output_v.append(volts)

    def _position(self, axis: str, time_s: float) -> float:
        time_ns = round(time_s * NS_PER_S)
        self._platform.advance_to(time_ns)
        stage = self.stages[axis]
        reading_um = stage.reading_um()
        if self.log is not None:
            log = self.log.of(axis)
            log.reading_ns.append(time_ns)
            log.reading_um.append(reading_um)
            log.true_um.append(stage.displacement_um)
        return reading_um


def covering_gauge(stage: StageSettings) -> Ksg101Knobs:
    """Return a gauge reader whose full scale leaves room on both sides of the stage's range."""
    ends = abs(stage.origin_um), abs(stage.origin_um + stage.stroke_um)
    return Ksg101Knobs(max_travel_um=max(20.0, float(np.ceil(1.15 * max(ends)))))
