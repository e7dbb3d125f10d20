"""Ring records of the core as messages for the bus."""

import math
from typing import Any

from dehyst import __version__
from dehyst.daemon.messages import Event, GatewayStatus, Status, Timing
from dehyst.daemon.records import MissCause, Mode, State


def name_of(kind: Any, value: int) -> str:
    """Lower-case name of an enumeration's value; the number where it has none."""
    try:
        return str(kind(value).name).lower()
    except ValueError:
        return str(value)


def event_message(record: Any) -> Event:
    """One EVENT record."""
    return Event(
        time_ns=int(record["time_ns"]),
        wall_ns=int(record["wall_ns"]),
        level=int(record["level"]),
        code=bytes(record["code"]).decode("utf-8", "replace"),
        text=bytes(record["text"]).decode("utf-8", "replace"),
    )


def _timing(values: Any) -> Timing:
    p50, p99, p999, most = (float(v) for v in values)
    return Timing(p50=p50, p99=p99, p999=p999, max=most)


def status_message(
    record: Any,
    name: str,
    unit: str,
    drive_unit: str,
    run: int,
    alive: bool,
    gateway: GatewayStatus,
) -> Status:
    """One STATUS record and what the gateway knows."""
    causes = {
        name_of(MissCause, i): int(n) for i, n in enumerate(record["missed_by"]) if int(n) > 0
    }
    return Status(
        name=name,
        software=__version__,
        core_alive=alive,
        run=run,
        unit=unit,
        drive_unit=drive_unit,
        time_ns=int(record["time_ns"]),
        wall_ns=int(record["wall_ns"]),
        state=name_of(State, int(record["state"])),
        policy="fifo" if record["policy"] else "other",
        priority=int(record["priority"]),
        mode=name_of(Mode, int(record["mode"])),
        samples=int(record["samples"]),
        missed=int(record["missed"]),
        missed_by=causes,
        wake_us=_timing(record["wake_us"]),
        exec_us=_timing(record["exec_us"]),
        io_us=_timing(record["io_us"]),
        actuator_ok=bool(record["actuator_ok"]),
        sensor_ok=bool(record["sensor_ok"]),
        actuator_errors=int(record["actuator_errors"]),
        sensor_errors=int(record["sensor_errors"]),
        volts=float(record["volts"]),
        queue_s=_finite(record["queue_s"]),
        trajectory=int(record["trajectory"]) & (2**63 - 1),
        trajectory_done=bool(record["trajectory_done"]),
        origin=float(record["origin"]),
        reach_min=float(record["reach_min"]),
        reach_max=float(record["reach_max"]),
        latency_s=_finite(record["latency_s"]),
        period_ns=int(record["period_ns"]),
        pid=int(record["pid"]),
        gateway=gateway,
    )


def _finite(value: Any) -> float:
    number = float(value)
    return number if math.isfinite(number) else 0.0
