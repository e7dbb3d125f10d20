"""Configuration of the emulated bench, and a first model of its stage.

`dehyst run` without --config and `dehyst demo` start from it: an MDT693B and a KSG101 emulated on
pseudo terminals and connected to the simulated stage.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dehyst.daemon.files.outputs import whole_file
from dehyst.models.errors import BadModel

if TYPE_CHECKING:  # starting the bench with the shipped model needs no numba
    from dehyst.drivers.simulated.settings import StageSettings
    from dehyst.models.model import Model
    from dehyst.models.recording import Floats

SHIPPED_MODEL = Path(__file__).with_name("simulated-stage.toml")
"""The model that `simulated_model()` identifies."""
RATE_HZ = 200.0  # sustained by an MDT693B over serial
AXES_RATE_HZ = 100.0  # with several axes on it
FULL_SCALE_V = 150.0  # highest limit of an MDT693B

LIMITS_TRIM_BUS = """
[limits]
min_v = 0.0
max_v = {full_scale_v}
slew_v_per_s = 4000.0

[trim]
enabled = {trim}

[bus]
listen = ["{listen}"]
"""
TEMPLATE = """\
# The emulated bench: an MDT693B and a KSG101 on pseudo terminals, connected to a simulated stage.
name = "{name}"
run_dir = "{directory}"

[model]
file = "model.toml"

[loop]
rate_hz = {rate_hz}

[actuator]
driver = "mdt693b"
gain = {gain}
[actuator.settings]
port = "{actuator}"

[sensor]
driver = "ksg101"
zero = {zero}
[sensor.settings]
port = "{sensor}"
"""


AXES_TEMPLATE = """\
# The emulated bench with several axes: an MDT693B and a KSG101 for each axis on pseudo terminals,
# connected to a simulated stage.
name = "{name}"
run_dir = "{directory}"

[loop]
rate_hz = {rate_hz}

[actuator]
driver = "mdt693b"
[actuator.settings]
port = "{actuator}"
"""

MAY_STAY = """
[setpoint]
stay = true  # a simulated stage may be left at any place; a real one only where that is safe
"""
AXIS_TEMPLATE = """
[axis.{axis}.model]
file = "model-{axis}.toml"
[axis.{axis}.actuator.settings]
axis = "{axis}"
[axis.{axis}.sensor]
driver = "ksg101"
[axis.{axis}.sensor.settings]
port = "{sensor}"
"""


def exploring_drive(
    rate_hz: float = RATE_HZ, seconds: float = 12.0, sweep: float = 0.0
) -> "tuple[Floats, Floats]":
    """Return (t_s, volts): a sine of 1 Hz whose amplitude shrinks and grows again, from 0 V and
    back to 0 V; its frequency rises by `sweep` Hz on either side, as one rate shows no
    rate-dependence."""
    t_s = np.arange(round(rate_hz * seconds)) / rate_hz
    phase = 2 * np.pi * (t_s + sweep * (t_s / seconds - 1.0) * t_s)
    envelope = np.interp(t_s / seconds, [0.0, 0.2, 0.6, 1.0], [1.0, 1.0, 0.15, 1.0])
    volts = 0.5 * FULL_SCALE_V * (1.0 - envelope * np.cos(phase))
    fade = np.minimum(1.0, np.minimum(t_s, t_s[-1] - t_s) / 0.25)  # s, to and from 0 V
    return t_s, volts * fade


def simulated_model(settings: "StageSettings | None" = None) -> "Model":
    """Return a model of a simulated stage (None: the default one), identified from its own
    simulated recording."""
    from dehyst.drivers.simulated.stage import SimulatedStage
    from dehyst.models.identify import identify
    from dehyst.models.recording import Recording

    t_s, volts = exploring_drive()
    _, reading = SimulatedStage(settings).run(t_s, volts)
    held = np.concatenate([[0.0], volts[:-1]])  # a reading belongs to the previous voltage
    recording = Recording(t_s=t_s, drive=held, displacement=reading, name="simulated stage")
    return identify([recording]).model


@dataclass(frozen=True)
class Imitation:
    """The simulated stage scaled to a model, so that any model can be tried without its stage.

    gain: amplifier volts per drive unit; zero: the model's displacement of the unloaded stage;
    stage: options for `dehyst emulate`.
    """

    gain: float = 1.0
    zero: float = 0.0
    stage: tuple[str, ...] = ()

    @classmethod
    def of(cls, model: "Model") -> "Imitation":
        """Map full scale to the end of the model's drive range, and give the stage the model's
        stroke. Raises BadModel if the drive range ends at or below 0."""
        from dehyst.models.hysteresis.forward import simulate_hysteresis

        valid = model.validity
        if valid.drive_max <= 0:
            raise BadModel(
                f"the model's drive ends at {valid.drive_max:g} {model.drive_unit}; the emulated "
                f"amplifier gives 0 to {FULL_SCALE_V:g} V"
            )
        drives = np.linspace(0.0, valid.drive_max, 1001)
        y = simulate_hysteresis(model.hysteresis, drives, 1e9)
        return cls(
            FULL_SCALE_V / valid.drive_max,
            float(y[0]),
            ("--stage", f"stroke_um={y[-1] - y[0]:.6g}"),
        )


def write_bench(
    directory: Path,
    ports: Mapping[str, str],
    name: str,
    listen: str,
    model: "Model | Path | None",
    imitation: Imitation = Imitation(),
    trim: bool = True,
    more: str = "",
) -> Path:
    """Write config.toml (and model.toml if a model or its file is given) into directory; return the
    path of the configuration.

    ports: {"mdt693b": path, "ksg101": path}, as `dehyst emulate` prints them; trim: the gauge
    corrects the target; more: further sections.
    """
    config = directory / "config.toml"
    if model is not None:
        _write_model(model, directory / "model.toml")
    _write_text(
        config,
        (TEMPLATE + LIMITS_TRIM_BUS).format(
            name=name,
            directory=directory,
            rate_hz=RATE_HZ,
            full_scale_v=FULL_SCALE_V,
            actuator=ports["mdt693b"],
            sensor=ports["ksg101"],
            listen=listen,
            gain=imitation.gain,
            zero=imitation.zero,
            trim=str(trim).lower(),
        )
        + more,
    )
    return config


def write_axes_bench(
    directory: Path,
    ports: Mapping[str, str],
    name: str,
    listen: str,
    models: "Mapping[str, Model | Path | None]",
    trim: bool = True,
    rate_hz: float = AXES_RATE_HZ,
    more: str = "",
) -> Path:
    """Write config.toml for the axes of an emulated bench, and model-AXIS.toml for each model
    given, into directory; return the path of the configuration.

    ports: {"mdt693b": path, "ksg101-x": path, ...}, as `dehyst emulate --axes 3` prints them;
    models: by axis; trim, more: as in write_bench.
    """
    text = (AXES_TEMPLATE + LIMITS_TRIM_BUS).format(
        name=name,
        directory=directory,
        rate_hz=rate_hz,
        full_scale_v=FULL_SCALE_V,
        actuator=ports["mdt693b"],
        listen=listen,
        trim=str(trim).lower(),
    )
    for axis, model in models.items():
        if model is not None:
            _write_model(model, directory / f"model-{axis}.toml")
        text += AXIS_TEMPLATE.format(axis=axis, sensor=ports[f"ksg101-{axis}"])
    config = directory / "config.toml"
    _write_text(config, text + more)
    return config


def _write_model(model: "Model | Path", path: Path) -> None:
    if isinstance(model, Path):
        _write_text(path, model.read_text("utf-8"))
        return
    from dehyst.daemon.files.models import save_model

    save_model(model, path)


def _write_text(path: Path, text: str) -> None:
    with whole_file(path) as file:
        file.write(text.encode("utf-8"))
