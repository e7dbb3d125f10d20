"""Record what a unit really answers: raw bytes and times of harmless queries.

Some of the unit's behaviour is not documented anywhere (rate, framing of some replies). A recording
of a real unit settles it and becomes a test fixture. Only queries, an empty line and two words that
no unit knows are sent; no setting is changed and no output moves. `time_sets` does write, but only
the set-point that the output already has.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from dehyst.drivers.call_times import CallTimes
from dehyst.drivers.interface import DeviceTimeout, OutOfRange, ProtocolError
from dehyst.drivers.mdt693b.codec import (
    Ack,
    Answer,
    Dialect,
    Garbled,
    Mdt693bCodec,
    Refused,
    detect_dialect,
)
from dehyst.drivers.mdt693b.link import NO_COMMAND
from dehyst.drivers.mdt693b.tuning import PROBE_TUNING as TUNING
from dehyst.drivers.recorded import RecordedExchange, record_exchange
from dehyst.drivers.serial_port import SerialPort

QUERIES = (
    *("", "*IDN?", "id?", "serial?", "friendly?", "echo?", "vlimit?", "intensity?"),
    *("xvoltage?", "yvoltage?", "zvoltage?", "xyzvoltage?"),
    *("xmin?", "xmax?", "ymin?", "ymax?", "zmin?", "zmax?", "sysmin?", "sysmax?"),
    *("msenable?", "msvoltage?", "dacstep?", "cm?", "rotarymode?", "pushdisable?"),
    *("xr?", "xl?", "xh?", "%", "?"),
)


@dataclass(frozen=True)
class ProbedUnit:
    """The content of the recorded replies. dialect: "legacy", "modern" or ""; answers: command
    -> value, "refused" or "unclear: ..."; the other fields are empty if the unit did not report
    them."""

    dialect: str
    model: str = ""
    firmware: str = ""
    serial_number: str = ""
    answers: dict[str, str] = field(default_factory=dict)


def record_exchanges(
    port: SerialPort,
    progress: Callable[[float], None] = lambda share: None,
    clock: Callable[[], float] = time.monotonic,
) -> list[RecordedExchange]:
    """Send every query and record all replies, each until the line is quiet."""
    start_s = clock()
    exchanges = []
    port.write(NO_COMMAND)  # a half-received command in the unit must not be carried out
    while port.read_until_deadline(clock() + TUNING.quiet_s):
        pass
    for number, query in enumerate(QUERIES):
        waits_s = TUNING.first_byte_s, TUNING.quiet_s
        sent = query.encode("ascii") + b"\r"
        exchanges.append(record_exchange(port, sent, waits_s, clock, start_s))
        progress((number + 1) / len(QUERIES))
        if number == 2 and not any(e.received for e in exchanges):
            break  # nothing answers
    return exchanges


def interpret(exchanges: list[RecordedExchange]) -> ProbedUnit:
    """Interpret the replies; pure, so that it also works on a fixture file."""
    replies = {e.sent.rstrip(b"\r").decode("latin-1"): e.reply for e in exchanges}
    dialect = detect_dialect(replies.get("", b""))
    if dialect is None:
        return ProbedUnit("")
    answers = {query: _answer(dialect, query, reply) for query, reply in replies.items()}
    lines = answers.get("id?", "").split("\r")
    model = next((x.split()[1] for x in lines if x.startswith("Model ")), "")
    firmware = next((x.split()[-1] for x in lines if x.startswith("Firmware ")), "")
    return ProbedUnit(dialect.framing.name, model, firmware, answers.get("serial?", ""), answers)


def time_queries(
    port: SerialPort, dialect: Dialect, count: int, clock: Callable[[], float] = time.monotonic
) -> CallTimes:
    """Time round trips of `xvoltage?`, one after the other. Raises DeviceTimeout, ProtocolError."""
    return _time(port, dialect, "xvoltage?", count, Answer, clock)


def time_sets(
    port: SerialPort,
    dialect: Dialect,
    volts: float,
    count: int,
    clock: Callable[[], float] = time.monotonic,
) -> CallTimes:
    """Time round trips of sets of axis x, all to `volts`, where the output must already be: raises
    OutOfRange when the unit reads back something else."""
    codec = Mdt693bCodec(dialect)
    reading = _exchange(port, codec, "xvoltage?", clock)
    if not isinstance(reading, Answer):
        raise ProtocolError(f"{port.path}: xvoltage? was answered with {reading}")
    if not abs(float(reading.value) - volts) <= TUNING.same_v:
        raise OutOfRange(
            f"axis x reads back {reading.value} V, not {volts:g} V; sets are timed only at the "
            "present output voltage. Nothing was set"
        )
    return _time(port, dialect, f"xvoltage={volts:.3f}", count, Ack, clock)


def _time(
    port: SerialPort,
    dialect: Dialect,
    command: str,
    count: int,
    wanted: type,
    clock: Callable[[], float],
) -> CallTimes:
    times = CallTimes(kept=count)
    codec = Mdt693bCodec(dialect)
    for _ in range(count):
        started_s = clock()
        event = _exchange(port, codec, command, clock)
        times.add(clock() - started_s)
        if not isinstance(event, wanted):
            raise ProtocolError(f"{port.path}: {command!r} was answered with {event}")
    return times


def _exchange(
    port: SerialPort, codec: Mdt693bCodec, command: str, clock: Callable[[], float]
) -> Ack | Answer | Refused | Garbled:
    port.write(codec.send(command))
    deadline_s = clock() + TUNING.first_byte_s
    while True:
        data = port.read_until_deadline(deadline_s)
        for event in codec.receive(data) if data else codec.silence():
            return event
        if not data:
            raise DeviceTimeout(
                f"{port.path}: no answer to {command!r} in {TUNING.first_byte_s:g} s"
            )


def _answer(dialect: Dialect, query: str, reply: bytes) -> str:
    codec = Mdt693bCodec(dialect)
    codec.send(query)
    for event in [*codec.receive(reply), *codec.silence()]:
        if isinstance(event, Answer):
            return event.value
        if isinstance(event, Refused):
            return "refused"
    return f"unclear: {reply[:60]!r}" if reply else "no answer"
