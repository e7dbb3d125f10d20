"""Properties of the emulated MDT693B, and the faults that can be switched at run time."""

from typing import Annotated, Literal

from msgspec import Meta

from dehyst.drivers.emulated.mdt693b_dialects import DIALECTS
from dehyst.drivers.settings import Settings

DAC_STEP_V = 2.75e-3  # 16 bit
ADC_STEP_V = 3.0e-3  # of the readback


class Mdt693bKnobs(Settings, frozen=True):
    """Properties of the unit; the defaults are plausible, with about 320 sets/s."""

    driver = "emulated mdt693b"

    dialect: Annotated[str, Meta(description="firmware, a row of the table of dialects")] = "1.10"
    axes: Annotated[Literal["xyz", "x"], Meta(description='"x" for an MDT694B')] = "xyz"
    serial_number: Annotated[str, Meta(description="answer to serial?")] = "150226175403"
    friendly_name: Annotated[str, Meta(description="answer to friendly?")] = "MDT693B"
    echo: Annotated[bool, Meta(description="echo at power-on")] = True
    compatibility: Annotated[bool, Meta(description="MDT693A commands at power-on")] = False
    compatibility_only: Annotated[bool, Meta(description="in that mode, no other commands")] = False
    limit_v: Annotated[Literal[75, 100, 150], Meta(description="the limit switch")] = 150
    range_error: Annotated[
        bytes, Meta(description="modern answer to an argument out of range; b'!' may be another")
    ] = b"CMD_ARG_INVALID"
    bare_numbers: Annotated[
        bool, Meta(description="intensity?, msenable? and their like without brackets")
    ] = False
    compatibility_prompt: Annotated[
        bytes, Meta(description="modern prompt in compatibility mode; b'*' may be another")
    ] = b">"
    latency_s: Annotated[
        float, Meta(ge=0, description="time from the end of a command to its reply")
    ] = 0.0026
    jitter_s: Annotated[
        float, Meta(ge=0, description="added to the latency, uniform from 0 to this")
    ] = 0.0003
    min_period_s: Annotated[float, Meta(ge=0, description="shortest time between commands")] = 0.0
    chunk_size: Annotated[int, Meta(ge=0, description="bytes per write of a reply; 0: whole")] = 0
    chunk_gap_s: Annotated[float, Meta(ge=0, description="time between those writes")] = 0.0
    readback_offset_v: Annotated[float, Meta(description="of the ADC")] = 0.2
    readback_noise_v: Annotated[float, Meta(ge=0, description="of the ADC, rms")] = 1.5e-3
    readback_lag_s: Annotated[float, Meta(ge=0, description="of the ADC, first order")] = 0.1
    dac_step_v: Annotated[float, Meta(ge=0, description="0: no rounding")] = DAC_STEP_V
    adc_step_v: Annotated[float, Meta(ge=0, description="0: no rounding")] = ADC_STEP_V
    start_v: Annotated[float, Meta(description="output recalled at power-on")] = 0.0
    seed: Annotated[int, Meta(description="seed of jitter, noise and garbage")] = 0

    def check(self) -> None:
        """Refuse a dialect that is not in the table."""
        if self.dialect not in DIALECTS:
            raise self.wrong("dialect", f"one of {', '.join(DIALECTS)}")


class Mdt693bFaults(Settings, frozen=True):
    """Faults at run time; the last five act on the next `count` replies."""

    driver = "emulated mdt693b's faults"

    hang: Annotated[
        bool, Meta(description="accepts bytes but does nothing; bytes received meanwhile are lost")
    ] = False
    mute: Annotated[bool, Meta(description="obeys but sends no replies")] = False
    lose_sets: Annotated[bool, Meta(description="acknowledges sets without carrying them out")] = (
        False
    )
    readback_error_v: Annotated[float, Meta(description="added to the readback")] = 0.0
    readback_error_axis: Annotated[str, Meta(description='of this axis; "": of each')] = ""
    before_reply: Annotated[bytes, Meta(description="sent before a reply: NUL, LF, stale")] = b""
    after_reply: Annotated[bytes, Meta(description="sent after a reply")] = b""
    garbage: Annotated[bool, Meta(description="random printable bytes instead of a reply")] = False
    half: Annotated[bool, Meta(description="a reply is cut in half")] = False
    delay_s: Annotated[float, Meta(ge=0, description="delay added to a reply")] = 0.0
    count: Annotated[int, Meta(ge=0, description="number of replies affected")] = 0
