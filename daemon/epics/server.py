"""The Channel Access server of one controller: a set of records per axis, on one address."""

import asyncio
import contextlib
import logging
import os
import signal
from collections.abc import Callable

from caproto.asyncio.server import Context

from dehyst.daemon import notify
from dehyst.daemon.client.group import Group
from dehyst.daemon.client.held_axes import HeldAxes
from dehyst.daemon.epics.records import AxisRecords, AxisSource
from dehyst.daemon.rings.records import model_digest
from dehyst.models.modelfile import dumps

BEACONS = "Failed to send beacon"
"""Start of caproto's message, with a traceback every few seconds, if no CA repeater listens."""


def axis_sources(group: Group, observe: bool) -> dict[str, AxisSource]:
    """Return the sources by axis. group: a connection that only queries and listens."""
    found = {}
    for axis, client in group.clients.items():
        limits, status = client.config().limits, client.status()
        span = status.reach_max - status.reach_min
        fastest = limits.slew_v_per_s * span / (limits.max_v - limits.min_v)
        feed = client.feed()
        feed.status = status
        feed.doctor.extend(client.doctor())

        def digest(client: object = client) -> str:
            return model_digest(dumps(client.model()))  # type: ignore[attr-defined]

        found[axis] = AxisSource(feed, digest, fastest, observe)
    return found


def records_of(held: HeldAxes, sources: dict[str, AxisSource], prefix: str) -> list[AxisRecords]:
    """Return the records of every axis: PREFIXx, PREFIXy; for a single unnamed axis, PREFIX without
    its last colon."""
    return [
        AxisRecords(f"{prefix}{axis}" if axis else prefix.rstrip(":"), axis, held, source)
        for axis, source in sources.items()
    ]


def serve_records(
    records: list[AxisRecords], address: str, port: int, ready: Callable[[int], None]
) -> None:
    """Serve until SIGTERM or Ctrl-C. address: of the interface; port: for TCP and UDP searches, 0:
    from the environment ($EPICS_CA_SERVER_PORT, else 5064). Raises OSError."""
    if port:
        os.environ["EPICS_CA_SERVER_PORT"] = str(port)
    # send beacons to this address only: a loopback server must not send to the network
    os.environ.setdefault("EPICS_CAS_AUTO_BEACON_ADDR_LIST", "NO")
    os.environ.setdefault("EPICS_CAS_BEACON_ADDR_LIST", address)
    logging.getLogger("caproto.ctx").addFilter(_is_not_of_beacons)
    asyncio.run(_serve(records, address, ready))


def _is_not_of_beacons(record: logging.LogRecord) -> bool:
    """Return False for log lines about undelivered beacons, which are normal."""
    return not str(record.msg).startswith(BEACONS)


async def _serve(records: list[AxisRecords], address: str, ready: Callable[[int], None]) -> None:
    pvdb = {name: channel for group in records for name, channel in group.pvdb.items()}
    context = Context(pvdb, [address])
    loop = asyncio.get_running_loop()
    task = loop.create_task(context.run())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: _end(loop, task))  # Windows' loops take no handlers
    while context.port is None and not task.done():
        await asyncio.sleep(0.02)
    if not task.done():
        ready(context.port)
        notify.send("READY=1")
    every_s = notify.watchdog_s()
    while every_s and not task.done():
        notify.send("WATCHDOG=1")
        await asyncio.wait([task], timeout=every_s)
    with contextlib.suppress(asyncio.CancelledError):
        await task


def _end(loop: asyncio.AbstractEventLoop, task: "asyncio.Task[None]") -> None:
    with contextlib.suppress(RuntimeError):  # a second signal: the loop is already closed
        loop.call_soon_threadsafe(task.cancel)
