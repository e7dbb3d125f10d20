"""One axis as EPICS records: a motor record, and further records for values it has no field for.

A put to VAL takes the command lease and moves; with completion (`caput -c`, ophyd) it returns when
the axis is on target. With VELO below VMAX, the move follows a path of that velocity with ramps of
ACCL seconds; at VMAX the daemon moves as fast as its slew limit allows. STOP stops and holds. A
refused put raises the record's alarm and fails at the client; the reason is in MSG.
"""

import asyncio
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from caproto import AlarmSeverity, AlarmStatus, ChannelType
from caproto.server import PVGroup, pvproperty

from dehyst.daemon import clock
from dehyst.daemon.client.held_axes import HeldAxes
from dehyst.daemon.client.readings import AxisView
from dehyst.daemon.client.telemetry import StatusFeed
from dehyst.daemon.epics.profile import move_profile
from dehyst.models.errors import DehystError

log = logging.getLogger(__name__)
UPDATE_S = 0.1
"""Update interval of the monitors [s], for people and archivers; scans use completion."""
DONE_S = 120.0
"""Time [s] for which a move may be off target after the end of its path, before it fails at the
client."""
MONITORS_S = 0.05
"""How long a put's completion waits for the monitors of the same update [s], which another task of
the server sends in batches of 10 ms: a client that received the completion first would still read
the position before the move."""
TEXT = 40
"""Length of an EPICS string [characters]."""


@dataclass(frozen=True)
class AxisSource:
    """Sources of an axis's records in addition to its telemetry. feed: status and doctor's reports;
    model: requests the digest of the model in use; fastest: speed at the slew limit [unit/s];
    observe: puts are refused."""

    feed: StatusFeed
    model: Callable[[], str]
    fastest: float
    observe: bool


class AxisRecords(PVGroup):
    """Records of the axis `axis`."""

    def __init__(self, prefix: str, axis: str, axes: HeldAxes, source: AxisSource) -> None:
        super().__init__(prefix)
        self._axis, self._axes, self._source = axis, axes, source
        self._move, self._reach = 0, (math.nan, math.nan)
        self._updating = asyncio.Lock()

    # -- puts -----------------------------------------------------------------------------------

    async def _run(self, job: Any, *args: Any) -> None:
        """Run a job on the bus in another thread. Raises what the job raises, and writes the error
        to MSG."""
        if self._source.observe:
            await self.message.write("this server only observes")
            raise PermissionError("this server only observes")
        try:
            await asyncio.to_thread(job, *args)
        except DehystError as error:
            await self.message.write(str(error)[:400])
            raise
        await self.message.write("")

    async def _put_motor(self, instance: Any, value: float) -> float:
        """VAL: move to the target; return when the axis is on target or was sent elsewhere."""
        self._move += 1
        mine = self._move
        await self._run(self._begin, float(value))
        await instance.write(float(value), verify_value=False)
        await self._field("DMOV", 0)
        end_ns = clock.monotonic_ns() + round(DONE_S * clock.NS)
        while True:
            view = self._view()
            if view.flying:  # a path lasts as long as its velocity says
                end_ns = clock.monotonic_ns() + round(DONE_S * clock.NS)
            if self._move != mine:
                return float(instance.value)
            if view.lost:
                raise RuntimeError(view.lost)
            if view.on_target and not view.flying:
                break
            if clock.monotonic_ns() > end_ns:
                raise TimeoutError(f"not on target within {DONE_S:g} s")
            await asyncio.sleep(UPDATE_S / 4)
        await self._update()
        await asyncio.sleep(MONITORS_S)
        return float(value)

    def _begin(self, value: float) -> None:
        view = self._view()
        fields = self.motor.fields
        velocity, fastest = fields["VELO"].value, fields["VMAX"].value
        start = view.asked if math.isfinite(view.asked) and not view.lost else view.predicted
        # at rest the stage is usually outside the reach: the path begins at the reach's edge
        start = min(max(start, view.low), view.high)
        if 0 < velocity < fastest and math.isfinite(start) and start != value:
            t_s, path = move_profile(
                start, value, velocity, max(0.0, fields["ACCL"].value), view.period_s
            )
            self._axes.fly(t_s, {self._axis: path})
        else:
            self._axes.go({self._axis: value})

    async def _put_held(self, instance: Any, value: int) -> int:
        """HELD: 1 takes the command lease without moving; 0 releases the axes."""
        await self._run(self._axes.take if value else self._axes.let_go)
        return int(bool(value))

    async def _stop(self, _instance: Any, value: int) -> int:
        """STOP: stop at once and hold."""
        if value:
            self._move += 1
            await self._run(self._axes.stop)
            if math.isfinite(at := self._view().asked):
                await self.motor.write(at, verify_value=False)
        return 0

    async def _set_mode(self, instance: Any, value: int | str) -> int | str:
        """SPMG: Stop and Pause stop at once and hold, as many motor screens ask for it."""
        if value in (0, 1, "Stop", "Pause"):
            await self._stop(instance, 1)
        return value

    async def _set_velocity(self, _instance: Any, value: float) -> float:
        """VELO: refuse what is no velocity, with which the next move would be the fastest."""
        if not (math.isfinite(value) and value > 0):
            text = f"VELO {value:g}: a velocity is greater than 0"
            await self.message.write(text)
            raise ValueError(text)
        return value

    # -- monitors -------------------------------------------------------------------------------

    async def _keep_up(self, instance: Any, async_lib: Any) -> None:
        """Describe the axis, then keep its fields up to date."""
        for name, putter in (
            ("STOP", self._stop),
            ("SPMG", self._set_mode),
            ("VELO", self._set_velocity),
        ):
            instance.fields[name].putter = putter
        view = self._view()
        speed = self._source.fastest
        for name, value in (
            ("VMAX", speed),
            ("VELO", speed),
            ("ACCL", 0.1),
            ("MRES", 1e-4),
            ("ERES", 1e-4),
            ("UREV", 1.0),
            ("SREV", 1),
            ("RDBD", view.tolerance),
            ("DESC", f"axis {self._axis}"),
        ):
            await self._field(name, value)
        if math.isfinite(view.predicted):
            await instance.write(view.predicted, verify_value=False)
        while True:
            try:
                await self._update()
            except Exception as error:  # one bad update must not end all of them
                log.warning("axis %s: %s", self._axis, error)
            await async_lib.library.sleep(UPDATE_S)

    def _offer(self) -> str:
        """Return the doctor's newest report if it offers a model, else ""."""
        reports = self._source.feed.doctor
        newest = reports[-1] if reports else None
        if newest is None or newest.offer is None:
            return ""
        return f"{newest.state}: {newest.says}"[:400]

    def _view(self) -> AxisView:
        return self._axes.look()[self._axis]

    async def _field(self, name: str, value: Any) -> None:
        field = self.motor.fields[name]
        if field.value != value:
            await field.write(value, verify_value=False)

    async def _update(self) -> None:
        """Write the fields, one update at a time, so that an older view cannot overwrite the fields
        of a newer one."""
        async with self._updating:
            await self._write_fields()

    async def _write_fields(self) -> None:
        view, said = self._view(), self._source.feed.status
        done = not view.moving and not view.flying
        # dial limits stay 0 (none): a client that finds the stage outside the reach, as is common
        # at 0 V, would refuse to move it inside; the daemon itself refuses unreachable targets
        limits = {"LLM": view.low, "HLM": view.high}
        values: dict[str, Any] = {
            **limits,
            "RBV": view.place,
            "DRBV": view.place,
            "DVAL": self.motor.value,
            "DMOV": int(done),
            "MOVN": int(not done),
            "EGU": view.unit,
        }
        for name, value in values.items():
            if not (isinstance(value, float) and math.isnan(value)):
                await self._field(name, value)
        await self.volts.write(view.volts)
        await self.predicted.write(view.predicted)
        await self.error.write(view.place - view.asked)
        if said is not None:
            await self.state.write(said.state[:TEXT])
            await self.trim.write(said.trim)
            await self.health.write(said.gateway.health)
            await self.offer.write(self._offer())
            if (said.reach_min, said.reach_max) != self._reach:  # a new model, or the first one
                self._reach = said.reach_min, said.reach_max
                await self.model.write((await asyncio.to_thread(self._source.model))[:TEXT])
        await self.held.write(int(math.isfinite(view.asked) and not view.lost), verify_value=False)
        severity, status = AlarmSeverity.NO_ALARM, AlarmStatus.NO_ALARM
        if said is None or not said.core_alive:
            severity, status = AlarmSeverity.INVALID_ALARM, AlarmStatus.COMM
        elif said.state == "fault":
            severity, status = AlarmSeverity.MAJOR_ALARM, AlarmStatus.HWLIMIT
        elif said.gateway.mismatch:
            severity, status = AlarmSeverity.MINOR_ALARM, AlarmStatus.SOFT
        if self.motor.alarm.severity != severity or self.motor.alarm.status != status:
            await self.motor.alarm.write(status=status, severity=severity)

    motor = pvproperty(
        value=0.0, name="", record="motor", precision=4, put=_put_motor, startup=_keep_up
    )
    volts = pvproperty(value=math.nan, name=":VOLTS", read_only=True, units="V", precision=3)
    error = pvproperty(value=math.nan, name=":ERROR", read_only=True, precision=4)
    predicted = pvproperty(value=math.nan, name=":PREDICTED", read_only=True, precision=4)
    trim = pvproperty(value=math.nan, name=":TRIM", read_only=True, precision=4)
    state = pvproperty(value="", name=":STATE", read_only=True, dtype=ChannelType.STRING)
    model = pvproperty(value="", name=":MODEL", read_only=True, dtype=ChannelType.STRING)
    health = pvproperty(value=math.nan, name=":HEALTH", read_only=True, precision=2)
    offer = pvproperty(
        value="", name=":OFFER", read_only=True, dtype=ChannelType.CHAR, max_length=400
    )
    message = pvproperty(
        value="", name=":MSG", read_only=True, dtype=ChannelType.CHAR, max_length=400
    )
    held = pvproperty(value=0, name=":HELD", dtype=ChannelType.INT, put=_put_held)
