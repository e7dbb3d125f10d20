"""Harmless requests to a KPZ101, and how to interpret the recorded replies."""

from dataclasses import dataclass

from dehyst.drivers.apt.codec import (
    CHANNEL_ENABLED,
    FULL_OUTPUT,
    OPEN_LOOP,
    SOFTWARE_ONLY,
    VOLTAGE_LIMITS_V,
    Decoder,
)
from dehyst.drivers.recorded import RecordedExchange

REQUESTS: tuple[tuple[str, dict[str, int]], ...] = (
    ("hw_stop_updatemsgs", {}),
    ("hw_req_info", {}),
    ("mod_req_chanenablestate", {"chan": 1}),
    ("pz_req_poscontrolmode", {"chan": 1}),
    ("pz_req_inputvoltssrc", {"chan": 1}),
    ("pz_req_tpz_iosettings", {"chan": 1}),
    ("pz_req_outputvolts", {"chan": 1}),
)


@dataclass(frozen=True)
class ProbedPiezo:
    """The content of the replies. limit_v: 0 if unknown; output_v: the set-point, which a disabled
    output does not have; open_loop, software_only: the driver needs both."""

    limit_v: float = 0.0
    output_v: float = 0.0
    enabled: bool = False
    open_loop: bool = False
    software_only: bool = False


def interpret_driver_requests(exchanges: list[RecordedExchange]) -> ProbedPiezo:
    """Interpret the replies; pure, so that it also works on a fixture file."""
    decoder, found = Decoder(), {}
    for exchange in exchanges:
        decoder.reset()
        for message in decoder.feed(exchange.reply):
            found[message.name] = message.values
    code = found.get("pz_get_tpz_iosettings", {}).get("voltage_limit", 0)
    limit_v = VOLTAGE_LIMITS_V.get(int(code), 0.0)
    counts = int(found.get("pz_get_outputvolts", {}).get("voltage", 0))
    return ProbedPiezo(
        limit_v,
        counts / FULL_OUTPUT * limit_v,
        found.get("mod_get_chanenablestate", {}).get("state") == CHANNEL_ENABLED,
        found.get("pz_get_poscontrolmode", {}).get("mode") == OPEN_LOOP,
        found.get("pz_get_inputvoltssrc", {}).get("inputs") == SOFTWARE_ONLY,
    )
