"""Settings of the simulated stage: every effect has its parameters, and 0 switches it off.

The defaults are a PZS001 stack (1.4 uF, 17.4 um at 150 V) on an MDT693B: 150 ohm and 60 mA in
series with the capacitor, 10 to 15 % hysteresis, creep of 1.2 % per decade, one mechanical mode and
a bridge with a filter and noise. Hum, drift, coupling, friction and rate dependence are off. Each
axis of a stage with several has such settings, plus the other axes' contribution to it.
"""

from typing import Annotated, Literal, Self

from msgspec import Meta, structs

from dehyst.drivers.settings import Settings


class StageSettings(Settings, frozen=True):
    """The stage's parameters, in the order in which the effects act. 0 switches an effect off."""

    driver = "simulated stage"

    # scale
    full_scale_v: Annotated[
        float, Meta(gt=0, description="voltage at which the virgin stage has moved by stroke_um")
    ] = 150.0
    stroke_um: Annotated[
        float, Meta(gt=0, description="displacement of the virgin stage at full_scale_v")
    ] = 17.4
    origin_um: Annotated[float, Meta(description="displacement of the de-energised stage")] = 0.0
    seed: Annotated[int, Meta(ge=0, description="seed of the sensor noise")] = 1
    # electrical
    dac_step_v: Annotated[
        float,
        Meta(ge=0, description="step of the amplifier's converter; the default is 16 bit, 2.75 mV"),
    ] = 150.0 / 54545.0
    ext_gain: Annotated[
        float, Meta(ge=0, description="volts at the output per volt at the EXT input")
    ] = 15.0
    clip_min_v: Annotated[float, Meta(description="lowest output of the amplifier")] = -0.5
    clip_max_v: Annotated[float, Meta(description="highest output of the amplifier")] = 150.5
    amplifier_tau_s: Annotated[
        float, Meta(ge=0, description="first-order lag of the amplifier itself")
    ] = 0.0
    slew_v_per_s: Annotated[
        float, Meta(ge=0, description="slew limit; the default is 60 mA into 1.4 uF")
    ] = 42857.0
    rc_tau_s: Annotated[
        float, Meta(ge=0, description="lag of the stack; the default is 150 ohm and 1.4 uF")
    ] = 210e-6
    # piezo
    hysteresis_width: Annotated[
        float,
        Meta(ge=0, le=0.2, description="greatest width of the full loop, as a share of its stroke"),
    ] = 0.12
    asymmetry: Annotated[
        float,
        Meta(ge=-1, le=1, description="exponential bow of the static map after the hysteresis"),
    ] = 0.15
    rate_per_decade: Annotated[
        float,
        Meta(
            ge=0, le=0.5, description="friction grows by 1 + this log10(1 + rate / (range per s))"
        ),
    ] = 0.0
    creep_gain_per_decade: Annotated[
        float, Meta(ge=0, le=0.2, description="creep, as a share of the step")
    ] = 0.012
    # mechanics
    mode_hz: Annotated[float, Meta(ge=0, description="frequency of the mechanical mode")] = 780.0
    mode_damping: Annotated[float, Meta(ge=0, le=0.99, description="damping ratio of the mode")] = (
        0.02
    )
    mode_share: Annotated[
        float,
        Meta(ge=0, le=1, description="share of the displacement that passes through the mode"),
    ] = 0.3
    friction_um: Annotated[
        float, Meta(ge=0, description="half width of the guide's stick range")
    ] = 0.0
    # effects other than the drive that move the stage
    gain_per_k: Annotated[float, Meta(description="change of the gain with temperature")] = 0.0
    expansion_um_per_k: Annotated[float, Meta(description="thermal expansion")] = 0.0
    drift_um_per_s: Annotated[float, Meta(description="drift of the mount")] = 0.0
    coupling_um_per_v: Annotated[
        float, Meta(description="displacement per volt on the other axis")
    ] = 0.0
    # contribution of the stage's other axes: their own motion, from their origin
    from_x: Annotated[
        float, Meta(ge=-0.5, le=0.5, description="displacement per displacement of axis x")
    ] = 0.0
    from_y: Annotated[
        float, Meta(ge=-0.5, le=0.5, description="displacement per displacement of axis y")
    ] = 0.0
    from_z: Annotated[
        float, Meta(ge=-0.5, le=0.5, description="displacement per displacement of axis z")
    ] = 0.0
    cross_share: Annotated[
        float,
        Meta(ge=0, le=1, description="share of it that passes through a mode of the platform"),
    ] = 0.0
    cross_hz: Annotated[float, Meta(ge=0, description="frequency of that mode")] = 260.0
    cross_damping: Annotated[
        float, Meta(ge=0, le=0.99, description="damping ratio of that mode")
    ] = 0.05
    hum_um: Annotated[float, Meta(description="amplitude of the hum")] = 0.0
    hum_hz: Annotated[float, Meta(ge=0, description="frequency of the hum")] = 50.0
    # sensor
    sensor_tau_s: Annotated[float, Meta(ge=0, description="lag of the bridge's filter")] = 150e-6
    sensor_delay_s: Annotated[
        float, Meta(ge=0, le=0.05, description="pure delay of the reading")
    ] = 0.0
    sensor_gain: Annotated[float, Meta(description="reading per displacement")] = 1.0
    sensor_offset_um: Annotated[float, Meta(description="reading at displacement 0")] = 0.0
    sensor_bow: Annotated[
        float, Meta(description="parabolic error at mid-stroke, as a share of the stroke")
    ] = 0.0
    sensor_noise_um: Annotated[
        float, Meta(ge=0, description="standard deviation of one reading")
    ] = 0.02
    adc_step_um: Annotated[float, Meta(ge=0, description="step of the reading")] = 0.0005

    def check(self) -> None:
        """Refuse a clip that leaves no range."""
        if self.clip_min_v >= self.clip_max_v:
            raise self.wrong("clip_min_v", f"below clip_max_v = {self.clip_max_v:g}")

    def quiet(self, **others: float) -> Self:
        """Return this stage without the effects in OFF_FOR_QUIET, for tests."""
        off = dict.fromkeys(OFF_FOR_QUIET, 0.0)
        return structs.replace(self, **{**off, **others})


class SimulatedSettings(StageSettings, frozen=True):
    """Settings that both drivers of a simulated stage take: stage, axis, and the stage's
    parameters."""

    stage: Annotated[
        str, Meta(min_length=1, description="name of the stage; drivers that give one share it")
    ] = "default"
    axis: Annotated[
        Literal["x", "y", "z"],
        Meta(description="which axis of the stage this is; the other settings are this axis' own"),
    ] = "x"
    period_s: Annotated[
        float,
        Meta(ge=0, description="virtual time that passes when each axis is written; 0: real time"),
    ] = 0.0


class SimulatedActuatorSettings(SimulatedSettings, frozen=True):
    """The amplifier of a simulated stage."""

    driver = "simulated actuator"

    min_v: Annotated[float, Meta(description="lowest voltage that may be written")] = 0.0
    max_v: (
        Annotated[
            float, Meta(description="highest voltage that may be written; full_scale_v if left out")
        ]
        | None
    ) = None


class SimulatedSensorSettings(SimulatedSettings, frozen=True):
    """The strain gauge of a simulated stage."""

    driver = "simulated sensor"


AXES = ("x", "y", "z")
STAGE_KEYS = StageSettings.__struct_fields__
SHARED_KEYS = (*STAGE_KEYS, "period_s")
OFF_FOR_QUIET = (
    "dac_step_v",
    "amplifier_tau_s",
    "slew_v_per_s",
    "rc_tau_s",
    "hysteresis_width",
    "asymmetry",
    "rate_per_decade",
    "creep_gain_per_decade",
    "mode_hz",
    "friction_um",
    "sensor_tau_s",
    "sensor_delay_s",
    "sensor_noise_um",
    "adc_step_um",
)
