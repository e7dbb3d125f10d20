"""Record what a KSG101 really answers: raw bytes and times of harmless requests.

Only requests are sent, and the message that stops unsolicited updates; no setting is changed, and
the zero is kept. A recording of a real unit becomes a test fixture.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from dehyst.drivers.apt.codec import (
    BAYS,
    GAUGE_CONNECTED,
    HOST,
    RACK,
    UNIT,
    ZEROED,
    Decoder,
    encode_apt,
)
from dehyst.drivers.call_times import CallTimes
from dehyst.drivers.interface import DeviceTimeout
from dehyst.drivers.ksg101.driver import FULL_SCALE
from dehyst.drivers.recorded import RecordedExchange, record_exchange
from dehyst.drivers.serial_port import SerialPort

REQUESTS: tuple[tuple[str, dict[str, int]], ...] = (
    ("hw_stop_updatemsgs", {}),
    ("hw_req_info", {}),
    ("pz_req_maxtravel", {"chan": 1}),
    ("tsg_req_iosettings", {"chan": 1}),
    ("tsg_req_reading", {"chan": 1}),
    ("pz_req_pzstatusupdate", {"chan": 1}),
)
READING = encode_apt("tsg_req_reading", chan=1)


@dataclass(frozen=True)
class GaugeProbeTuning:
    """Waits [s], generous because a truncated reply would make a false recording: an FTDI chip
    holds bytes back for 16 ms. No benchmark sets them."""

    first_byte_s: float = 0.3
    quiet_s: float = 0.05


TUNING = GaugeProbeTuning()


@dataclass(frozen=True)
class ProbedGauge:
    """The content of the recorded replies. model: "" if no APT unit answers; travel_um: at 100 %, 0
    if the unit does not know it; reading_um: NaN at full scale or without travel; answers: message
    name -> its values in words; skipped: number of bytes that belong to no message."""

    model: str = ""
    firmware: str = ""
    serial_number: str = ""
    travel_um: float = 0.0
    reading_um: float = math.nan
    gauge_connected: bool = False
    zeroed: bool = False
    answers: dict[str, str] = field(default_factory=dict)
    skipped: int = 0


def record_requests(
    port: SerialPort,
    progress: Callable[[float], None] = lambda share: None,
    clock: Callable[[], float] = time.monotonic,
    requests: Sequence[tuple[str, dict[str, int]]] = REQUESTS,
) -> list[RecordedExchange]:
    """Send every request and record all replies, each until the line is quiet; stop after the first
    two if nothing answers. requests: of another APT unit, with the same first two."""
    start_s, exchanges = clock(), []
    waits_s = TUNING.first_byte_s, TUNING.quiet_s
    for number, (name, values) in enumerate(requests):
        sent = encode_apt(name, **values)
        exchanges.append(record_exchange(port, sent, waits_s, clock, start_s))
        progress((number + 1) / len(requests))
        if number == 1 and not interpret_gauge_requests(exchanges).model:
            break
    return exchanges


def interpret_gauge_requests(exchanges: list[RecordedExchange]) -> ProbedGauge:
    """Interpret the replies, also those of a rack; pure, so that it works on a fixture file."""
    decoder, found = Decoder((HOST,), (UNIT, RACK, *BAYS)), {}
    for exchange in exchanges:
        decoder.reset()
        for message in decoder.feed(exchange.reply):
            found[message.name] = message.values
    info = found.get("hw_get_info")
    if info is None:
        return ProbedGauge(skipped=decoder.skipped)
    minor, interim, major, _ = bytes(info["firmware"])
    travel_um = float(found.get("pz_get_maxtravel", {}).get("travel_100nm", 0)) / 10.0
    counts = int(found.get("tsg_get_reading", {}).get("reading", FULL_SCALE))
    status = int(found.get("pz_get_pzstatusupdate", {}).get("status", 0))
    known = travel_um > 0 and abs(counts) < FULL_SCALE
    return ProbedGauge(
        _text(info["model"]),
        f"{major}.{interim}.{minor}",
        str(info["serial_number"]),
        travel_um,
        counts / FULL_SCALE * travel_um if known else math.nan,
        bool(status & GAUGE_CONNECTED),
        bool(status & ZEROED),
        {name: _words(values) for name, values in found.items()},
        decoder.skipped,
    )


def time_readings(
    port: SerialPort, count: int, clock: Callable[[], float] = time.monotonic
) -> CallTimes:
    """Time round trips of readings, one after the other. Raises DeviceTimeout."""
    times, decoder = CallTimes(kept=count), Decoder()
    for _ in range(count):
        started_s = clock()
        port.write(READING)
        deadline_s, answered = started_s + TUNING.first_byte_s, False
        while not answered:
            data = port.read_until_deadline(deadline_s)
            if not data:
                raise DeviceTimeout(f"{port.path}: no reading within {TUNING.first_byte_s:g} s")
            answered = any(m.name == "tsg_get_reading" for m in decoder.feed(data))
        times.add(clock() - started_s)
    return times


def _text(raw: Any) -> str:
    return bytes(raw).split(b"\0")[0].decode("ascii", "replace").strip()


def _words(values: dict[str, Any]) -> str:
    return ", ".join(
        f"{name} {_text(v) if isinstance(v, bytes) and name != 'firmware' else v!r}"
        for name, v in values.items()
    )
