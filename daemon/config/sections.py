"""The configuration's sections and keys, one class a section: the documentation's defaults.

An unknown key, a missing key, a wrong type or a value outside its range is BadInput that names
the key. `dehyst run --check FILE` prints what a file means.
"""

import os
import tempfile
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from dehyst.drivers import system

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Name = Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$")]
AxisName = Annotated[str, Meta(pattern=r"^[a-z0-9]{0,8}$")]


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class ModelConfig(_Strict, frozen=True):
    """[model]"""

    file: str
    """Path of the model file, relative to the configuration; or a shipped model's name."""


class LoopConfig(_Strict, frozen=True):
    """[loop]"""

    rate_hz: Annotated[float, Meta(gt=0, le=20_000)] = 1000.0
    """Sampling rate. Refused if the drivers cannot sustain it."""
    priority: Annotated[int, Meta(ge=0, le=99)] = 80
    """Requested SCHED_FIFO priority; 0: ordinary scheduling. The status reports the actual one.
    From 1 kHz on, the CPUs are also kept out of slow idle states."""
    cpu: Annotated[int, Meta(ge=-1)] = -1
    """CPU to pin the loop to; -1: none."""
    engine: Literal["auto", "python", "compiled"] = "auto"
    """"compiled": without the interpreter, for drivers that C can call; "auto": where possible."""
    spin_us: Annotated[float, Meta(ge=0, le=1000)] | None = None
    """Time for which the compiled loop stays awake before each deadline, in microseconds, at most
    half a period; default: 0 up to 2 kHz, 50 above."""


class DeviceConfig(_Strict, frozen=True):
    """[actuator] and [sensor]: driver is a plugin's name, settings its own table."""

    driver: str
    settings: dict[str, Any] = {}


class ActuatorConfig(DeviceConfig, frozen=True):
    """[actuator]"""

    gain: Positive = 1.0
    """Actuator volts per drive unit of the model: 15 for a model identified on the 0..10 V input
    of an amplifier with gain 15 whose output voltage is set here."""
    readback_tolerance_v: NotNegative = 2.0
    """If the unit can report its output: a report further from the set-point than this stops
    the loop until they agree again. 0: the report is not requested (for example because an external
    input is added to the output)."""


class SensorConfig(DeviceConfig, frozen=True):
    """[sensor]"""

    scale: float = 1.0
    """Model displacement units per sensor unit."""
    zero: float = 0.0
    """Added to the scaled reading: the model's displacement where the sensor reads 0."""


class ChannelConfig(_Strict, frozen=True):
    """[channels.NAME]: a quantity that blocks of the model follow, called NAME in the model: a
    further sensor, such as a temperature (`driver`), or another axis of this amplifier (`axis`)."""

    driver: str = ""
    """Name of the sensor's driver."""
    settings: dict[str, Any] = {}
    axis: AxisName = ""
    """Or the axis to follow, in the same sample."""
    quantity: Literal["displacement", "drive"] = "displacement"
    """Quantity of that axis: its displacement from its model's zero (set-point and origin), in that
    model's unit, or its drive in that model's drive unit."""
    scale: float = 1.0
    """The model's channel unit per unit of the sensor or axis."""
    zero: float = 0.0
    """Added to the scaled value."""
    every_s: Annotated[float, Meta(ge=0.01, le=3600)] = 1.0
    """Interval at which a sensor is read, outside the loop."""


class LimitsConfig(_Strict, frozen=True):
    """[limits], in actuator volts. The daemon enforces these in addition to the unit's limits."""

    min_v: float
    max_v: float
    slew_v_per_s: Positive
    """Largest rate of the output, in every state, including start and stop."""


class SafeConfig(_Strict, frozen=True):
    """[safe]: the output when no client commands it."""

    voltage_v: float = 0.0
    ramp_v_per_s: Positive = 50.0
    on_stop: Literal["ramp", "hold"] = "ramp"
    """At the end of the daemon: ramp to voltage_v, or leave the output where it is."""
    on_fault: Literal["ramp", "hold"] = "hold"
    """After a fault has ended, and after the loop's process has died."""


class SetpointConfig(_Strict, frozen=True):
    """[setpoint]"""

    origin: Literal["auto", "model", "mid-range"] | float = "auto"
    """The meaning of set-point 0. "model": the model's own zero. "mid-range": the middle of the
    reachable range. A number: that model displacement. "auto": "model" if the model's zero
    lies in the reachable range or next to it, otherwise "mid-range" (the sensor has an arbitrary
    offset). Telemetry uses the same origin."""
    stale_s: Positive = 2.0
    """The loop holds after this time without a new set-point, or after a trajectory has run dry."""
    hold_s: NotNegative = 5.0
    """Time for which the loop holds before the output ramps to the safe voltage."""
    stay: bool = False
    """true: a client may ask the daemon to keep a position until another command, also after the
    client has disconnected (`dehyst send --stay`). The default is false, so that a dead client
    never leaves a voltage on an unattended stage."""
    approach_um_per_s: Positive = 20.0
    """Speed at which the stage moves to a trajectory's first point."""
    queue_s: Annotated[float, Meta(gt=0, le=600)] = 30.0
    """Largest queue of trajectory points that the daemon accepts."""
    lease_s: Annotated[float, Meta(ge=0.5, le=60)] = 3.0
    """One client commands at a time; its lease ends this long after its last command."""


class InverseConfig(_Strict, frozen=True):
    """[inverse]"""

    mode: Literal["auto", "static", "causal", "preview"] = "auto"
    """"auto": preview if the model needs it and preview_s provides targets ahead, otherwise static;
    "causal" extrapolates instead, without the guarantees of the other modes."""
    preview_s: Annotated[float, Meta(ge=0, le=1)] = 0.1


class TrimConfig(_Strict, frozen=True):
    """[trim]: the gauge corrects the target slowly, so that the mean position is correct."""

    enabled: bool = True
    """false: feed-forward alone; the gauge is only recorded and monitored."""
    time_constant_s: Positive | None = None
    """Time constant of the integral correction; default: 0.3 s, longer for a slow gauge. Refused if
    the gauge's lag and delay make it unstable."""
    limit_um: Positive | None = None
    """Largest correction, in the model's displacement unit; default: a tenth of the reach."""
    rate_um_per_s: Positive | None = None
    """Fastest correction; default: a fiftieth of the reach per second."""


class AuthConfig(_Strict, frozen=True):
    """[bus.auth]: who may connect (needed to listen beyond loopback); or, with `credentials`, the
    daemon's identity at a router that enforces the roles. Names are user names, or the common names
    of certificates."""

    operators: tuple[str, ...] = ()
    """May command and observe."""
    observers: tuple[str, ...] = ()
    """May read telemetry, status, model, configuration and history."""
    passwords: str = ""
    """File of name:password lines, readable only by the daemon; relative to the configuration."""
    certificates: str = ""
    """Or a directory with ca.pem, certificate.pem and key.pem (made by `dehyst keys`)."""
    credentials: str = ""
    """Or the daemon's own credentials at a router: such a directory, or a file with one line
    name:password. Needed for a router on the network."""


class BusConfig(_Strict, frozen=True):
    """[bus]: zenoh, on loopback only unless `listen` or `connect` name other addresses."""

    base: Annotated[str, Meta(pattern=r"^[a-z0-9_-]+(/[a-z0-9_-]+)*$")] = "dehyst"
    """First chunks of every key."""
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    connect: tuple[str, ...] = ()
    """Routers through which clients also find this daemon, or, with `listen = []`, only there."""
    auth: AuthConfig | None = None


class TelemetryConfig(_Strict, frozen=True):
    """[telemetry]"""

    batch_s: Annotated[float, Meta(gt=0, le=1)] = 0.02
    """Samples are published in batches of this length."""
    history_s: Annotated[float, Meta(gt=0, le=3600)] = 60.0
    """Length of the telemetry history that clients can query."""


class WatchConfig(_Strict, frozen=True):
    """[watch]: the monitor that compares the stage with its model."""

    enabled: bool = True
    directory: str = ""
    """Folder for the recordings around a mismatch; default: `mismatch` in the run directory."""
    before_s: Annotated[float, Meta(ge=1, le=3600)] = 30.0
    """Recorded time before the event, up to telemetry.history_s."""
    after_s: Annotated[float, Meta(ge=0, le=600)] = 10.0
    keep: Annotated[int, Meta(ge=1, le=1000)] = 10
    """Number of recordings; the oldest are deleted."""
    learn_s: Annotated[float, Meta(ge=30, le=36000)] = 400.0
    """Seconds of motion from which the watch learns before its first flag. A shorter time flags
    sooner, with more false flags."""


class DoctorConfig(_Strict, frozen=True):
    """[doctor]: a separate process that diagnoses mismatches and offers a new model."""

    enabled: bool = True
    """false: `dehyst run` does not start the doctor."""
    accept: bool = False
    """true: an offered model is accepted automatically, on trial as usual."""
    test_s: Annotated[float, Meta(ge=2, le=600)] = 10.0
    """Length of the later telemetry on which an offer is tested."""
    trial_s: Annotated[float, Meta(ge=2, le=3600)] = 10.0
    """Seconds of motion within which the error must fall; otherwise the previous model returns."""
    trial_limit_s: Annotated[float, Meta(ge=2, le=864000)] | None = None
    """A trial ends after this time [s], with or without motion, with the result so far; default:
    30 times trial_s, at least 300 s."""
    memory_gb: Annotated[float, Meta(ge=1, le=64)] = 4.0
    time_s: Annotated[float, Meta(ge=10, le=36000)] = 900.0
    """A diagnosis that takes more memory or processor time is stopped; so is one that is not done
    after six times this time because other processes use the processors."""


class PageConfig(_Strict, frozen=True):
    """[page]: with this section in the file, `dehyst run` also serves the page in a browser."""

    listen: str = "127.0.0.1:8080"
    """HOST:PORT. Beyond loopback only with certificate, key and passwords."""
    public_url: str = ""
    """The address that people type, if a reverse proxy on this machine serves the page, such as
    https://lab.example/stage/. Beyond loopback only with https and passwords."""
    certificate: str = ""
    """PEM file for TLS; all paths are relative to the configuration."""
    key: str = ""
    passwords: str = ""
    """File of name:password lines, readable only by the daemon; without it everybody on this
    machine may command."""
    operators: tuple[str, ...] = ()
    """May view and command."""
    observers: tuple[str, ...] = ()
    """May view."""
    observe: bool = False
    """true: nobody may command from the page."""
    connect: tuple[str, ...] = ()
    """Addresses of the controllers; default: the daemon's own address."""
    credentials: str = ""
    """Credentials of the page there, as --credentials of any client."""


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
    """What a daemon of several axes says of one of them: which. In a file it is left out."""
    run_dir: str = ""
    """Private directory of the memory-mapped rings; default: `dehyst-NAME` in $RUNTIME_DIRECTORY or
    $XDG_RUNTIME_DIR, otherwise `dehyst-USER-NAME` in the temporary directory."""

    @property
    def period_ns(self) -> int:
        """Sampling period, integer nanoseconds."""
        return round(1e9 / self.loop.rate_hz)

    @property
    def watch_directory(self) -> Path:
        """Where recordings around a mismatch are kept, and what the doctor makes of them."""
        return Path(self.watch.directory) if self.watch.directory else self.directory / "mismatch"

    @property
    def longest_ramp_s(self) -> float:
        """How long the output may take to its safe voltage at the configured rate."""
        limits, safe = self.limits, self.safe
        way_v = max(limits.max_v - safe.voltage_v, safe.voltage_v - limits.min_v)
        return way_v / safe.ramp_v_per_s

    @property
    def directory(self) -> Path:
        """Where core and gateway meet."""
        return run_directory(self.name, self.run_dir)


def usable_name(text: str) -> str:
    """That text as a controller's name, in lower case; "": it cannot be one."""
    try:
        return msgspec.convert(text.lower(), Name)
    except msgspec.ValidationError:
        return ""


def run_directory(name: str, run_dir: str) -> Path:
    """The folder of a controller's rings; run_dir: as configured, "" for the default."""
    if run_dir:
        return Path(run_dir)
    base = os.environ.get("RUNTIME_DIRECTORY") or os.environ.get("XDG_RUNTIME_DIR")
    if base:
        return Path(base) / f"dehyst-{name}"
    return Path(tempfile.gettempdir()) / f"dehyst-{system.user_id()}-{name}"
