"""A piezo channel in open loop: the checks made before a voltage is set.

The loop mode and the input sources are read and checked; they are never set, because setting either
of them moves the output.
"""

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.channel import AptChannel
from dehyst.drivers.interface import DriverConfigError, ProtocolError


def reported_counts(channel: AptChannel, first: bytes = b"") -> int:
    """Return the output voltage in counts that the unit reports, after the messages in `first`."""
    reply = channel.ask("pz_req_outputvolts", "pz_get_outputvolts", first)
    return int(reply.values["voltage"])


def check_ready(channel: AptChannel) -> None:
    """Raise DriverConfigError unless the unit is in open loop and follows software only."""
    mode = channel.ask("pz_req_poscontrolmode", "pz_get_poscontrolmode").values["mode"]
    if mode != codec.OPEN_LOOP:
        raise DriverConfigError(
            f"{channel.path}: the unit is in position control mode {mode}; set it to open loop "
            f"(mode {codec.OPEN_LOOP}) while the stage is at rest; dehyst does not, because that "
            "moves the output"
        )
    source = channel.ask("pz_req_inputvoltssrc", "pz_get_inputvoltssrc").values["inputs"]
    if source != codec.SOFTWARE_ONLY:
        added = [
            name
            for bit, name in (
                (codec.EXTERNAL_SIGNAL, "the external signal"),
                (codec.POTENTIOMETER, "the potentiometer"),
            )
            if source & bit
        ]
        raise DriverConfigError(
            f"{channel.path}: the unit adds {' and '.join(added) or f'source {source}'} to every "
            "set-point, so the output would differ from it; set its voltage source to software only"
        )


def enable(channel: AptChannel) -> None:
    """Enable the output without a jump: a disabled output is set to 0 V first. Raises ProtocolError
    if the unit does not report 0 V, or stays disabled."""
    if _is_enabled(channel):
        return
    zero = channel.encode("pz_set_outputvolts", voltage=0)
    counts = reported_counts(channel, zero)
    if counts != 0:
        raise ProtocolError(
            f"{channel.path}: the output is disabled with a set-point of {counts} counts, to "
            "which it would jump if enabled; set it to 0 V and enable it by hand"
        )
    channel.send("mod_set_chanenablestate", state=codec.CHANNEL_ENABLED)
    if not _is_enabled(channel):
        raise ProtocolError(f"{channel.path}: the unit did not enable its output")


def _is_enabled(channel: AptChannel) -> bool:
    reply = channel.ask("mod_req_chanenablestate", "mod_get_chanenablestate")
    return int(reply.values["state"]) == codec.CHANNEL_ENABLED
