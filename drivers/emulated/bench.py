"""The emulated bench: an MDT693B and a KSG101 on two ptys, one simulated stage between them.

    directory/mdt693b   port of the amplifier        directory/ksg101   port of the strain gauge
    directory/control   Unix datagram socket that takes faults and changes (control.py)

The stage follows real time: it is advanced to the present whenever the amplifier's output
changes and whenever the gauge is read. DAC step, EXT input and clip are the amplifier unit's;
slew, RC and everything behind them are the stage's.
"""

import os
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec import structs

from dehyst.drivers.emulated.ksg101_knobs import Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import Stage

NS_PER_S = 1e9


@dataclass(frozen=True)
class BenchSettings:
    """The three parts. axis: the amplifier's axis that drives the stage; another axis' voltage
    acts through the stage's coupling. gauge: None: a KSG101 whose travel covers the stage."""

    stage: StageSettings = field(default_factory=StageSettings)
    amplifier: Mdt693bKnobs = field(default_factory=Mdt693bKnobs)
    gauge: Ksg101Knobs | None = None
    axis: str = "x"


class BenchLog:
    """What left the amplifier and what the gauge showed, with the times of the bench's clock."""

    def __init__(self) -> None:
        self.output_ns = array("q")
        self.output_v = array("d")
        self.reading_ns = array("q")
        self.reading_um = array("d")
        self.true_um = array("d")

    def save(self, path: Path) -> None:
        """.npz: time_ns, volts (output); reading_ns, reading_um, true_um. .csv: the output. The
        file appears complete or not at all."""
        part = path.with_name(path.name + ".part")
        with part.open("wb") as file:
            if path.suffix == ".csv":
                rows = zip(self.output_ns, self.output_v, strict=True)
                text = "time_ns,volts\n" + "".join(f"{t},{v:.9g}\n" for t, v in rows)
                file.write(text.encode())
            else:
                np.savez(
                    file,
                    time_ns=np.array(self.output_ns),
                    volts=np.array(self.output_v),
                    reading_ns=np.array(self.reading_ns),
                    reading_um=np.array(self.reading_um),
                    true_um=np.array(self.true_um),
                )
        os.replace(part, path)


class Bench:
    """Both emulators and the stage. Call everything from the thread that serves, or through
    `amplifier.call(...)`; `log` is kept only when it is given."""

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
        if self.settings.axis not in knobs.axes:
            raise DriverConfigError(f"the amplifier has axes {knobs.axes}, no {self.settings.axis}")
        # what the amplifier unit does already, the stage must not do again
        self.stage = Stage(
            structs.replace(
                self.settings.stage,
                dac_step_v=0.0,
                ext_gain=0.0,
                clip_min_v=-1.0,
                clip_max_v=knobs.limit_v + 1.0,
            )
        )
        if knobs.start_v:
            self.stage.settle(knobs.start_v)
        self.amplifier = Mdt693bEmulator(self.directory / "mdt693b", knobs, self._output, clock)
        self.gauge_unit = Ksg101Unit(
            self.settings.gauge or covering_gauge(self.settings.stage), self._position, clock
        )
        self.gauge = PtyServer(self.gauge_unit, self.directory / "ksg101", clock)

    @property
    def servers(self) -> tuple[PtyServer, PtyServer]:
        """For pty_device.serve()."""
        return (self.amplifier, self.gauge)

    def ports(self) -> dict[str, str]:
        """The paths that drivers open, by the driver's name, and the control socket."""
        return {
            "mdt693b": self.amplifier.port,
            "ksg101": self.gauge.port,
            "control": str(self.directory / "control"),
        }

    def follow(self) -> None:
        """Bring the stage to the present."""
        self.stage.advance_to(round(self._clock() * NS_PER_S))

    def _output(self, axis: str, volts: float, time_s: float) -> None:
        if axis != self.settings.axis:
            self.follow()
            self.stage.set_inputs(other_v=volts)
            return
        time_ns = round(time_s * NS_PER_S)
        self.stage.advance_to(time_ns, volts)
        if self.log is not None:
            self.log.output_ns.append(time_ns)
            self.log.output_v.append(volts)

    def _position(self) -> float:
        self.follow()
        reading_um = self.stage.reading_um()
        if self.log is not None:
            self.log.reading_ns.append(round(self._clock() * NS_PER_S))
            self.log.reading_um.append(reading_um)
            self.log.true_um.append(self.stage.displacement_um)
        return reading_um


def covering_gauge(stage: StageSettings) -> Ksg101Knobs:
    """A gauge reader whose full scale leaves room on both sides of the stage's range."""
    ends = abs(stage.origin_um), abs(stage.origin_um + stage.stroke_um)
    return Ksg101Knobs(max_travel_um=max(20.0, float(np.ceil(1.15 * max(ends)))))
