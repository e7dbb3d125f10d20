"""The configuration's sections and keys, one class per section.

The reference documentation and the comments of `dehyst config init` come from the defaults and
docstrings here. An unknown key, a missing key, a wrong type or a value outside its range raises
BadInput, which names the key. `dehyst run --check FILE` prints what a file means.
"""

import os
import tempfile
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from dehyst.drivers import system
from dehyst.models.errors import BadInput

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Name = Annotated[
    str,
    Meta(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$",
        title="a name of a-z, 0-9, _ and -, beginning with a letter or digit, at most 63 "
        "characters",
    ),
]
AxisName = Annotated[
    str, Meta(pattern=r"^[a-z0-9]{0,8}$", title="an axis, of at most eight characters a-z and 0-9")
]


MOST_RATE_HZ = 20_000
"""Largest sampling rate: twice the fastest at which the loop was measured."""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class ModelConfig(_Strict, frozen=True):
    """[model]"""

    file: str
    """Path of the model file, relative to the configuration; or the name of a shipped model."""


class LoopConfig(_Strict, frozen=True):
    """[loop]"""

    rate_hz: Annotated[float, Meta(gt=0, le=MOST_RATE_HZ)] = 1000.0
    """Sampling rate. Refused if the drivers cannot sustain it."""
    priority: Annotated[int, Meta(ge=0, le=99)] = 80
    """Requested SCHED_FIFO priority; 0: ordinary scheduling. The status reports the actual one.
    From 1 kHz on, the CPUs are also kept out of slow idle states."""
    cpu: Annotated[int, Meta(ge=-1)] = -1
    """CPU to pin the loop to; -1: none."""
    engine: Literal["auto", "python", "compiled"] = "auto"
    """"compiled": without the Python interpreter, for drivers that can be called from C; "auto":
    compiled if possible, otherwise "python"."""
    spin_us: Annotated[float, Meta(ge=0, le=1000)] | None = None
    """Time for which the compiled loop busy-waits before each deadline, in microseconds, at most
    half a period; default: 0 up to 2 kHz, 50 above."""


class DeviceConfig(_Strict, frozen=True):
    """[actuator] and [sensor]: driver is a plugin's name, settings its own table."""

    driver: str
    settings: dict[str, Any] = {}


class ActuatorConfig(DeviceConfig, frozen=True):
    """[actuator]"""

    gain: Positive = 1.0
    """Actuator volts per drive unit of the model, such as 15 for a model identified on the 0..10 V
    input of an amplifier with gain 15 if the actuator sets the amplifier's output voltage."""
    readback_tolerance_v: NotNegative = 2.0
    """Largest allowed difference between the output that was set and the output that the unit
    reports, if it can; a larger one stops the loop until they agree again. 0: the output is not
    read back (for example because an external input is added to it)."""


class SensorConfig(DeviceConfig, frozen=True):
    """[sensor]"""

    scale: float = 1.0
    """Model displacement units per sensor unit."""
    zero: float = 0.0
    """Added to the scaled reading: the model's displacement where the sensor reads 0."""


class ChannelConfig(_Strict, frozen=True):
    """[channels.NAME]: a quantity on which blocks of the model depend, called NAME in the model: a
    further sensor, such as a temperature (`driver`), or another axis of this amplifier (`axis`)."""

    driver: str = ""
    """Name of the sensor's driver."""
    settings: dict[str, Any] = {}
    axis: AxisName = ""
    """Name of the other axis, whose value in the same sample is used."""
    quantity: Literal["displacement", "drive"] = "displacement"
    """Quantity of that axis: its displacement from its model's zero (set-point plus origin), in
    that model's unit, or its drive, in that model's drive unit."""
    scale: float = 1.0
    """The model's channel unit per unit of the sensor or axis."""
    zero: float = 0.0
    """Added to the scaled value."""
    every_s: Annotated[float, Meta(ge=0.01, le=3600)] = 1.0
    """Interval at which a sensor is read, outside the loop."""


class LimitsConfig(_Strict, frozen=True):
    """[limits], in actuator volts. The daemon enforces these in addition to the unit's own."""

    min_v: float
    max_v: float
    slew_v_per_s: Positive
    """Largest rate of the output, in every state, including start and stop."""


class SafeConfig(_Strict, frozen=True):
    """[safe]: the output when no client commands it."""

    voltage_v: float = 0.0
    ramp_v_per_s: Positive = 50.0
    on_stop: Literal["ramp", "hold"] = "ramp"
    """When the daemon ends: ramp to voltage_v, or leave the output as it is."""
    on_fault: Literal["ramp", "hold"] = "hold"
    """After a fault has ended, or after the loop's process has died: ramp to voltage_v, or leave
    the output as it is."""


class SetpointConfig(_Strict, frozen=True):
    """[setpoint]"""

    origin: Literal["auto", "model", "mid-range"] | float = "auto"
    """The meaning of set-point 0. "model": the model's own zero. "mid-range": the middle of the
    reachable range. A number: that model displacement. "auto": the model's own zero if the model
    reaches it in its whole valid range, or misses it by at most a fifth of that range; otherwise
    the middle of that range (the sensor has an arbitrary offset). "auto" does not depend on
    [limits]. Telemetry uses the same origin."""
    stale_s: Positive = 2.0
    """The loop holds if there is no new set-point for this time, or no next point of a
    trajectory."""
    hold_s: NotNegative = 5.0
    """Time for which the loop holds before the output ramps to the safe voltage."""
    stay: bool = False
    """true: a client may ask the daemon to keep a position until the next command, even after the
    client has disconnected (`dehyst send --stay`). The default is false, so that a client that has
    died never leaves a voltage on an unattended stage."""
    approach_um_per_s: Positive = 20.0
    """Speed of the move to a trajectory's first point."""
    queue_s: Annotated[float, Meta(gt=0, le=600)] = 30.0
    """Longest queue of trajectory points that the daemon accepts."""
    lease_s: Annotated[float, Meta(ge=0.5, le=60)] = 3.0
    """One client commands at a time; its lease ends this long after its last command."""


class InverseConfig(_Strict, frozen=True):
    """[inverse]"""

    mode: Literal["auto", "static", "causal", "preview"] = "auto"
    """"auto": "preview" if the model needs it and preview_s provides future targets, otherwise
    "static". "causal" extrapolates instead, without the guarantees of the other modes."""
    preview_s: Annotated[float, Meta(ge=0, le=1)] = 0.1


class TrimConfig(_Strict, frozen=True):
    """[trim]: the gauge corrects the target slowly, so that the mean position is correct."""

    enabled: bool = True
    """false: feed-forward only; the gauge is still recorded and monitored."""
    time_constant_s: Positive | None = None
    """Time constant of the integral correction; default: 0.3 s, longer for a slow gauge. Refused if
    the gauge's lag and delay make it unstable."""
    limit_um: Positive | None = None
    """Largest correction, in the model's displacement unit; default: a tenth of the reachable
    range."""
    rate_um_per_s: Positive | None = None
    """Largest rate of the correction; default: a fiftieth of the reachable range per second."""


class AuthConfig(_Strict, frozen=True):
    """[bus.auth]: who may connect (needed to listen on other addresses than loopback); or, with
    `credentials`, the daemon's identity at a router that enforces the roles. Names are user names
    or the common names of certificates."""

    operators: tuple[str, ...] = ()
    """May command and observe."""
    observers: tuple[str, ...] = ()
    """May read telemetry, status, model, configuration and history."""
    passwords: str = ""
    """File of name:password lines, readable only by the daemon; relative to the configuration."""
    certificates: str = ""
    """Alternatively, a directory with ca.pem, certificate.pem and key.pem (made by `dehyst
    keys`)."""
    credentials: str = ""
    """Alternatively, the daemon's own credentials at a router: such a directory, or a file with one
    line name:password. Needed for a router on the network."""


class BusConfig(_Strict, frozen=True):
    """[bus]: zenoh, on loopback only unless `listen` or `connect` name other addresses."""

    base: Annotated[
        str,
        Meta(
            pattern=r"^[a-z0-9_-]+(/[a-z0-9_-]+)*$",
            title="words of a-z, 0-9, _ and -, with a / between two",
        ),
    ] = "dehyst"
    """Prefix of every key."""
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    connect: tuple[str, ...] = ()
    """Routers through which clients also find this daemon; with `listen = []`, only through
    them."""
    auth: AuthConfig | None = None


class TelemetryConfig(_Strict, frozen=True):
    """[telemetry]"""

    batch_s: Annotated[float, Meta(gt=0, le=1)] = 0.02
    """Duration of a published batch of samples."""
    history_s: Annotated[float, Meta(gt=0, le=3600)] = 60.0
    """Duration of the telemetry history that clients can query."""


class WatchConfig(_Strict, frozen=True):
    """[watch]: the monitor that compares the stage with its model."""

    enabled: bool = True
    directory: str = ""
    """Folder for the recordings around a mismatch; default: `mismatch` in the run directory."""
    before_s: Annotated[float, Meta(ge=1, le=3600)] = 30.0
    """Recorded time before the mismatch, at most telemetry.history_s."""
    after_s: Annotated[float, Meta(ge=0, le=600)] = 10.0
    keep: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Number of recordings to keep; the oldest are deleted."""
    learn_s: Annotated[float, Meta(ge=30, le=36000)] = 400.0
    """Seconds of motion from which the monitor learns before it first flags a mismatch. A shorter
    time gives earlier flags, but more false ones."""


class DoctorConfig(_Strict, frozen=True):
    """[doctor]: a separate process that diagnoses mismatches and offers a new model."""

    enabled: bool = True
    """false: `dehyst run` does not start the doctor."""
    accept: bool = False
    """true: an offered model is accepted automatically, for the usual trial."""
    test_s: Annotated[float, Meta(ge=2, le=600)] = 10.0
    """Duration of the later telemetry on which an offered model is tested."""
    trial_s: Annotated[float, Meta(ge=2, le=3600)] = 10.0
    """Seconds of motion within which the error must fall; otherwise the previous model is
    restored."""
    trial_limit_s: Annotated[float, Meta(ge=2, le=864000)] | None = None
    """A trial ends after this time [s], with or without motion, and is judged by its result so far;
    default: 30 times trial_s, at least 300 s."""
    memory_gb: Annotated[float, Meta(ge=1, le=64)] = 4.0
    time_s: Annotated[float, Meta(ge=10, le=36000)] = 900.0
    """A diagnosis that needs more memory or processor time is stopped, as is one that has not
    finished after six times this time because other processes use the processors."""


class PageConfig(_Strict, frozen=True):
    """[page]: with this section, `dehyst run` also serves a web page."""

    listen: str = "127.0.0.1:8080"
    """HOST:PORT. Other addresses than loopback need certificate, key and passwords."""
    public_url: str = ""
    """The address that people type, such as https://lab.example/stage/, if a reverse proxy on this
    machine serves the page. Other addresses than loopback need https and passwords."""
    certificate: str = ""
    """PEM file for TLS; all paths are relative to the configuration."""
    key: str = ""
    passwords: str = ""
    """File of name:password lines, readable only by the daemon; without it, everybody on this
    machine may command."""
    operators: tuple[str, ...] = ()
    """May view and command."""
    observers: tuple[str, ...] = ()
    """May view."""
    observe: bool = False
    """true: nobody may command from the page."""
    connect: tuple[str, ...] = ()
    """Addresses of the controllers; default: this daemon's own address."""
    credentials: str = ""
    """The page's credentials there, in the form of a client's --credentials."""


class Config(_Strict, frozen=True):
    """The whole file."""

    name: Name
    """This controller's name in every key; with several axes, each axis is called NAME-AXIS."""
    model: ModelConfig
    actuator: ActuatorConfig
    sensor: SensorConfig
    limits: LimitsConfig
    loop: LoopConfig = LoopConfig()
    channels: dict[str, ChannelConfig] = {}
    safe: SafeConfig = SafeConfig()
    setpoint: SetpointConfig = SetpointConfig()
    inverse: InverseConfig = InverseConfig()
    trim: TrimConfig = TrimConfig()
    bus: BusConfig = BusConfig()
    telemetry: TelemetryConfig = TelemetryConfig()
    watch: WatchConfig = WatchConfig()
    doctor: DoctorConfig = DoctorConfig()
    page: PageConfig | None = None
    axis: AxisName = ""
    """Name of the axis, set by the daemon if the controller has several. A file omits it."""
    run_dir: str = ""
    """Private directory of the memory-mapped rings; default: `dehyst-NAME` in $RUNTIME_DIRECTORY or
    $XDG_RUNTIME_DIR, otherwise `dehyst-USER-NAME` in the temporary directory."""

    @property
    def period_ns(self) -> int:
        """Sampling period in integer nanoseconds."""
        return round(1e9 / self.loop.rate_hz)

    @property
    def watch_directory(self) -> Path:
        """Folder of the recordings around a mismatch and of the doctor's results."""
        return Path(self.watch.directory) if self.watch.directory else self.directory / "mismatch"

    @property
    def longest_ramp_s(self) -> float:
        """Longest time for the output to reach its safe voltage at the configured rate [s]."""
        limits, safe = self.limits, self.safe
        way_v = max(limits.max_v - safe.voltage_v, safe.voltage_v - limits.min_v)
        return way_v / safe.ramp_v_per_s

    @property
    def directory(self) -> Path:
        """Run directory, shared by core and gateway."""
        return run_directory(self.name, self.run_dir)


def usable_name(text: str) -> str:
    """Return the text in lower case as a controller's name, or "" if it is not a valid name."""
    try:
        return msgspec.convert(text.lower(), Name)
    except msgspec.ValidationError:
        return ""


def check_name(name: str) -> None:
    """Raise BadInput if the value of --name is no controller's name."""
    if usable_name(name) != name:
        raise BadInput(
            f"--name {name!r}: use a-z, 0-9, _ and -, beginning with a letter or digit, at most 63 "
            "characters"
        )


def run_directory(name: str, run_dir: str) -> Path:
    """Return the folder of a controller's rings. run_dir: the configured one, "" for the
    default."""
    if run_dir:
        return Path(run_dir)
    base = os.environ.get("RUNTIME_DIRECTORY") or os.environ.get("XDG_RUNTIME_DIR")
    if base:
        return Path(base) / f"dehyst-{name}"
    return Path(tempfile.gettempdir()) / f"dehyst-{system.user_id()}-{name}"
