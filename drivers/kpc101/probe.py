"""Harmless requests to a KPC101, BPC301 or BPC303, and how to interpret the recorded replies."""

from dataclasses import dataclass
from typing import Any

from dehyst.drivers.apt.codec import (
    BAYS,
    CHANNEL_ENABLED,
    FULL_OUTPUT,
    FULL_TRAVEL,
    GAUGE_CONNECTED,
    HOST,
    OPEN_LOOP,
    RACK,
    SOFTWARE_ONLY,
    UNIT,
    Decoder,
)
from dehyst.drivers.recorded import RecordedExchange

ACTUATOR, SENSOR = "actuator", "sensor"

Requests = tuple[tuple[str, dict[str, int]], ...]


def _of_channel(address: int) -> Requests:
    """Return the requests to a channel."""
    names = (
        "mod_req_chanenablestate",
        "pz_req_poscontrolmode",
        "pz_req_inputvoltssrc",
        "pz_req_outputmaxvolts",
        "pz_req_outputvolts",
        "pz_req_maxtravel",
        "pz_req_pzstatusupdate",
    )
    return tuple((name, {"chan": 1, "destination": address}) for name in names)


def _of_unit(address: int) -> Requests:
    """Return the requests that identify a unit."""
    return tuple((name, {"destination": address}) for name in ("hw_stop_updatemsgs", "hw_req_info"))


REQUESTS = _of_unit(UNIT) + _of_channel(UNIT)
RACK_REQUESTS = _of_unit(RACK) + tuple(one for bay in BAYS for one in _of_channel(bay))
"""All requests to a rack; an empty bay answers none of its own."""


@dataclass(frozen=True)
class ProbedChannel:
    """The content of one channel's replies. number: from 1; limit_v: 0 if unknown; output_v: the
    set-point, which a disabled output does not have; open_loop, software_only: the driver needs
    both; travel_um: 0 if the unit does not know it; position_um: None without travel or gauge, and
    at full scale."""

    number: int
    limit_v: float
    output_v: float
    enabled: bool
    open_loop: bool
    software_only: bool
    gauge_connected: bool
    travel_um: float
    position_um: float | None

    @property
    def roles(self) -> tuple[str, ...]:
        """What it can serve as: an actuator, and with a gauge also a sensor."""
        return (ACTUATOR, SENSOR) if self.gauge_connected else (ACTUATOR,)


def interpret_channels(exchanges: list[RecordedExchange]) -> list[ProbedChannel]:
    """Return the channels that answer, in order; pure, so that it also works on a fixture file."""
    decoder = Decoder((HOST,), (UNIT, RACK, *BAYS))
    found: dict[int, dict[str, dict[str, Any]]] = {}
    for exchange in exchanges:
        decoder.reset()
        for message in decoder.feed(exchange.reply):
            found.setdefault(message.source, {})[message.name] = message.values
    found.pop(RACK, None)
    return [
        _interpret(BAYS.index(address) + 1 if address in BAYS else 1, found[address])
        for address in sorted(found)
        if "pz_get_outputvolts" in found[address]
    ]


def _interpret(number: int, found: dict[str, dict[str, Any]]) -> ProbedChannel:
    def value(message: str, name: str) -> int:
        return int(found.get(message, {}).get(name, -1))

    limit_v = max(0, value("pz_get_outputmaxvolts", "voltage_100mv")) / 10.0
    travel_um = max(0, value("pz_get_maxtravel", "travel_100nm")) / 10.0
    status = max(0, value("pz_get_pzstatusupdate", "status"))
    counts = int(found.get("pz_get_pzstatusupdate", {}).get("position", FULL_TRAVEL))
    connected = bool(status & GAUGE_CONNECTED)
    reads = connected and travel_um > 0 and abs(counts) < FULL_TRAVEL
    return ProbedChannel(
        number,
        limit_v,
        int(found["pz_get_outputvolts"]["voltage"]) / FULL_OUTPUT * limit_v,
        value("mod_get_chanenablestate", "state") == CHANNEL_ENABLED,
        value("pz_get_poscontrolmode", "mode") == OPEN_LOOP,
        value("pz_get_inputvoltssrc", "inputs") == SOFTWARE_ONLY,
        connected,
        travel_um,
        counts / FULL_TRAVEL * travel_um if reads else None,
    )
