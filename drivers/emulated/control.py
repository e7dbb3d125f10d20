"""The control socket of the emulated bench: faults and changes on demand, as JSON.

Each datagram is one object with one or more of these keys:

    {"fault": "unplug", "device": "mdt693b" | "ksg101" | "both", "for_s": 2, "dialect": "1.05"}
                     ("kpz101", "kpc101", "bpc303" if that is the amplifier; if omitted, the
                     amplifier; if it has gauges of its own, there is no "ksg101")
    {"fault": "stall", "device": ..., "for_s": 2}       the host's writes block
    {"fault": "stuck" | "nan" | "range" | "late", "for_s": 2, "late_s": 0.02}   the gauge's readings
    {"amplifier": {"hang": true}, "for_s": 2}           fields of Mdt693bFaults, or of the unit's
    {"gauge": {"mute": true}, "for_s": 2}               fields of Ksg101Faults, or of the unit's
    {"stage": {"creep_gain_per_decade": 0.05}, "jump": false}    settings of the stage
    {"inputs": {"temperature_k": 3.0, "ext_v": 0.5, "other_v": 40.0}}
    {"clear": true}      a healthy bench again (the stage's settings are kept)
    {"save": true}       write the log now

On a bench with several axes, "axis": "y" selects the gauge, stage and inputs, and the state to
return (if omitted, the first axis; the state of each is under "axes"). Without for_s a fault lasts
until it is cleared. An amplifier that is unplugged with a "dialect" has that firmware when it is
plugged in again, and any unit with a "serial_number" has that number. With "reply_to" (path of the
sender's own datagram socket) the answer goes there: {"ok": true, "state": {...}} or {"ok": false,
"error": ...}.
"""

import contextlib
import functools
import json
import math
import os
import socket
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, structs

from dehyst.drivers.emulated.bench import Bench
from dehyst.drivers.emulated.mdt693b_dialects import DIALECTS
from dehyst.drivers.emulated.mdt693b_unit import Mdt693bUnit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import DeviceTimeout, DriverConfigError, DriverError
from dehyst.drivers.settings import Settings, read_settings, read_values
from dehyst.drivers.simulated.stage import FAULTS as READING_FAULTS


class Inputs(Settings, frozen=True):
    """Inputs that act on the stage in addition to the amplifier."""

    driver = "inputs of the bench"

    ext_v: Annotated[float, Meta(description="at the amplifier's EXT input")] | None = None
    other_v: Annotated[float, Meta(description="voltage of the other axis")] | None = None
    temperature_k: Annotated[float, Meta(description="above the start")] | None = None


class Order(Settings, frozen=True):
    """One datagram; see the module docstring."""

    driver = "control of the bench"

    fault: (
        Annotated[
            Literal["unplug", "stall", "stuck", "nan", "range", "late"],
            Meta(description="of a port (the first two), or of the gauge's readings"),
        ]
        | None
    ) = None
    axis: Annotated[str, Meta(description="axis of the gauge and stage; the first if left out")] = (
        ""
    )
    device: (
        Annotated[
            Literal["mdt693b", "kpz101", "kpc101", "bpc303", "ksg101", "both"],
            Meta(description="device of the port; the amplifier if left out"),
        ]
        | None
    ) = None
    for_s: (
        Annotated[float, Meta(ge=0, description="duration; until cleared if left out")] | None
    ) = None
    dialect: Annotated[str, Meta(description="firmware after an unplug")] | None = None
    serial_number: (
        Annotated[int, Meta(ge=0, description="serial number after an unplug")] | None
    ) = None
    late_s: Annotated[float, Meta(ge=0, description="delay of the fault late")] = 0.02
    amplifier: (
        Annotated[dict[str, Any], Meta(description="fields of the amplifier's faults")] | None
    ) = None
    gauge: Annotated[dict[str, Any], Meta(description="fields of the gauge's faults")] | None = None
    stage: Annotated[dict[str, Any], Meta(description="settings of the stage")] | None = None
    jump: Annotated[bool, Meta(description="a new gain moves the stage at once")] = False
    inputs: Annotated[dict[str, Any], Meta(description="fields of Inputs")] | None = None
    clear: Annotated[bool, Meta(description="a healthy bench again, before the rest")] = False
    save: Annotated[bool, Meta(description="write the log now")] = False
    reply_to: Annotated[str, Meta(description="socket of the sender")] | None = None

    def check(self) -> None:
        """Refuse a dialect that is not in the table."""
        if self.dialect is not None and self.dialect not in DIALECTS:
            raise self.wrong("dialect", f"one of {', '.join(DIALECTS)}")


def is_served(path: Path) -> bool:
    """Return True if a running bench serves this control socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as caller:
        try:
            caller.connect(str(path))
        except OSError:  # none, or one that a killed bench left
            return False
    return True


class Control:
    """The bench's end of the socket; `take` runs in the serving thread."""

    def __init__(self, bench: Bench, log_path: Path | None = None) -> None:
        self._bench = bench
        self._log_path = log_path
        self._timers: list[threading.Timer] = []
        self._path = bench.directory / "control"
        if is_served(self._path):
            raise DriverConfigError(
                f"{bench.directory}: another emulated bench runs there; end it, or choose another "
                "folder"
            )
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._path))

    def fileno(self) -> int:
        """Return the file descriptor for the serving loop."""
        return self._socket.fileno()

    def close(self) -> None:
        """Remove the socket."""
        for timer in self._timers:
            timer.cancel()
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def take(self, data: bytes) -> None:
        """Handle one datagram."""
        reply_to = None
        try:
            command = json.loads(data)
            if not isinstance(command, dict):
                raise DriverConfigError("a control message must be a JSON object")
            reply_to = command.get("reply_to")
            order = read_settings(Order, command)
            axis = self._axis(order)
            self._carry_out(order, axis)
            answer: dict[str, Any] = {"ok": True, "state": self._state(axis)}
        except (DriverError, ValueError, TypeError) as error:
            answer = {"ok": False, "error": str(error)}
        if isinstance(reply_to, str):
            with contextlib.suppress(OSError):  # the sender has gone
                self._socket.sendto(json.dumps(answer).encode(), reply_to)

    def _axis(self, order: Order) -> str:
        """Return the axis to which an order refers."""
        known = self._bench.stages
        axis = order.axis or next(iter(known))
        if axis not in known:
            raise order.wrong("axis", f"one of {', '.join(known)}")
        return axis

    def _state(self, axis: str) -> dict[str, Any]:
        self._bench.follow()
        axes = {name: self._state_of(name) for name in self._bench.stages}
        return {**axes[axis], "axes": axes}

    def _state_of(self, axis: str) -> dict[str, Any]:
        bench = self._bench
        unit, stage = bench.amplifier.unit, bench.stages[axis]
        return {
            "plugged": {name: server.plugged for name, server in self._ports(axis).items()},
            "output_v": unit.output_v(axis),
            "drive_v": stage.drive_v,
            "displacement_um": stage.displacement_um,
            "sets": unit.sets_done,
            "sets_of_all": unit.sets_of_all,
            "readings": bench.gauge_units[axis].readings_done,
        }

    def _carry_out(self, order: Order, axis: str) -> None:
        bench = self._bench
        if order.clear:
            self._clear()
        if order.stage:
            bench.follow()
            bench.stages[axis].change(jump=order.jump, **order.stage)
        if order.inputs:
            self._inputs(order.inputs, axis)
        if order.amplifier:
            table = dict(order.amplifier)
            for name in ("before_reply", "after_reply"):
                if name in table:
                    table[name] = str(table[name]).encode("latin-1")
            kind = type(bench.amplifier.unit.faults)
            changes = read_values(kind, table)
            bench.amplifier.fault(**changes)
            back = {name: getattr(kind(), name) for name in changes}
            self._later(order.for_s, lambda: bench.amplifier.fault(**back))
        if order.gauge:
            faults = type(bench.gauge_units[axis].faults)
            self._gauge_fault(axis, read_values(faults, order.gauge), order.for_s)
        if order.fault is not None:
            self._fault(order, order.fault, axis)
        if order.save:
            if self._log_path is None or bench.log is None:
                raise DriverConfigError("the bench was started without a log")
            bench.log.save(self._log_path)

    def _fault(self, order: Order, kind: str, axis: str) -> None:
        bench, for_s = self._bench, order.for_s
        if kind == "late":
            self._gauge_fault(axis, {"delay_s": order.late_s}, for_s)
            return
        if kind in READING_FAULTS:
            bench.follow()
            bench.stages[axis].fault(kind, math.inf if for_s is None else for_s)
            return
        servers = self._ports(axis)
        device = order.device or bench.amplifier.link_path.name
        if device not in (*servers, "both"):
            raise order.wrong("device", f"{', '.join(servers)} or both")
        for name, server in servers.items():
            if device not in (name, "both"):
                continue
            if kind == "unplug":
                server.unplug()
                if order.dialect is not None and server is bench.amplifier:
                    self._mdt693b().set_dialect(order.dialect)
                if order.serial_number is not None:
                    server.unit.set_serial_number(order.serial_number)
                self._later(for_s, server.plug)
            else:
                server.stall_writes(True)
                self._later(for_s, functools.partial(server.stall_writes, False))

    def _ports(self, axis: str) -> dict[str, PtyServer]:
        """Return the ports by driver name: the amplifier's, and the gauge's if it has one."""
        bench = self._bench
        ports: dict[str, PtyServer] = {bench.amplifier.link_path.name: bench.amplifier}
        return ports if bench.own_gauges else {**ports, "ksg101": bench.gauges[axis]}

    def _gauge_fault(self, axis: str, changes: dict[str, Any], for_s: float | None) -> None:
        unit = self._bench.gauge_units[axis]
        unit.faults = structs.replace(unit.faults, **changes)
        back = {name: getattr(type(unit.faults)(), name) for name in changes}

        def end() -> None:
            unit.faults = structs.replace(unit.faults, **back)

        self._later(for_s, lambda: self._bench.gauges[axis].call(end))

    def _inputs(self, inputs: dict[str, Any], axis: str) -> None:
        values = read_values(Inputs, inputs)
        bench = self._bench
        if "ext_v" in values:  # the amplifier adds and clips it
            self._mdt693b().set_ext(axis, values.pop("ext_v"))
        bench.follow()
        bench.stages[axis].set_inputs(**values)

    def _mdt693b(self) -> Mdt693bUnit:
        """Return the amplifier's unit, for orders that only an MDT693B supports."""
        unit = self._bench.amplifier.unit
        if not isinstance(unit, Mdt693bUnit):
            raise DriverConfigError(
                f"the emulated {unit.knobs.model} has no dialect and no external input"
            )
        return unit

    def _clear(self) -> None:
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        bench = self._bench
        bench.amplifier.clear_faults()
        for axis, stage in bench.stages.items():
            bench.gauges[axis].clear_faults()
            stage.clear_fault()
        for server in bench.servers:
            server.plug()

    def _later(self, for_s: float | None, action: Callable[[], None]) -> None:
        """Run `action` in the serving thread after for_s; never for an endless fault."""
        if for_s is None:
            return
        self._timers = [timer for timer in self._timers if timer.is_alive()]
        timer = threading.Timer(for_s, action)
        timer.daemon = True
        timer.start()
        self._timers.append(timer)


def ask(control: str | Path, command: dict[str, Any], timeout_s: float = 5.0) -> dict[str, Any]:
    """Send a command to a bench's control socket and return its state.

    Raises DriverConfigError with the bench's message when it refuses, DeviceTimeout when no bench
    answers.
    """
    with (
        tempfile.TemporaryDirectory(prefix="dehyst-ask-") as folder,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as own,
    ):
        path = os.path.join(folder, "s")
        own.bind(path)
        own.settimeout(timeout_s)
        try:
            own.sendto(json.dumps({**command, "reply_to": path}).encode(), str(control))
            answer = json.loads(own.recv(65536))
        except (TimeoutError, FileNotFoundError, ConnectionRefusedError):
            raise DeviceTimeout(f"no emulated bench answers at {control}") from None
    if not answer["ok"]:
        raise DriverConfigError(answer["error"])
    state: dict[str, Any] = answer["state"]
    return state
