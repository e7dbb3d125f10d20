"""The control socket of the emulated bench: faults and changes on demand, as JSON.

Each datagram is one object with one or more of these keys:

    {"fault": "unplug", "device": "mdt693b" | "ksg101" | "both", "for_s": 2, "dialect": "1.05"}
    {"fault": "stall", "device": ..., "for_s": 2}       the host's writes block
    {"fault": "stuck" | "nan" | "range" | "late", "for_s": 2, "late_s": 0.02}   the gauge's readings
    {"amplifier": {"hang": true}, "for_s": 2}           fields of Mdt693bFaults
    {"gauge": {"mute": true}, "for_s": 2}               fields of Ksg101Faults
    {"stage": {"creep_gain_per_decade": 0.05}, "jump": false}    settings of the stage
    {"inputs": {"temperature_k": 3.0, "ext_v": 0.5, "other_v": 40.0}}
    {"clear": true}      a healthy bench again (the stage's settings stay)
    {"save": true}       write the history now

Without for_s a fault stays until it is cleared; an amplifier that is unplugged with a dialect has
that firmware when it is plugged in again. With "reply_to" (path of the sender's own
datagram socket) the answer goes there: {"ok": true, "state": {...}} or {"ok": false, "error": ...}.
"""

import contextlib
import functools
import json
import os
import socket
import tempfile
import threading
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dehyst.drivers.interface import DeviceTimeout, DriverConfigError, DriverError
from dehyst.drivers.ksg101_emulator import Ksg101Faults
from dehyst.drivers.mdt693b_dialects import DIALECTS
from dehyst.drivers.mdt693b_unit import Mdt693bFaults
from dehyst.drivers.stage import FAULTS as READING_FAULTS

if TYPE_CHECKING:
    from dehyst.drivers.bench import Bench

FOREVER_S = float("inf")
DEVICES = ("mdt693b", "ksg101", "both")
KEYS = (
    "fault",
    "device",
    "for_s",
    "dialect",
    "late_s",
    "amplifier",
    "gauge",
    "stage",
    "jump",
    "inputs",
    "clear",
    "save",
    "reply_to",
)
INPUTS = ("ext_v", "other_v", "temperature_k")


class Control:
    """The bench's end of the socket; `take` runs in the serving thread."""

    def __init__(self, bench: "Bench", log: Path | None = None) -> None:
        self._bench = bench
        self._log = log
        self._timers: list[threading.Timer] = []
        self._path = bench.directory / "control"
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._path))

    def fileno(self) -> int:
        """For the serving loop."""
        return self._socket.fileno()

    def close(self) -> None:
        """Take the socket away."""
        for timer in self._timers:
            timer.cancel()
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def take(self, data: bytes) -> None:
        """One datagram."""
        reply_to = None
        try:
            command = json.loads(data)
            if not isinstance(command, dict):
                raise DriverConfigError("a control message is a JSON object")
            reply_to = command.get("reply_to")
            self._carry_out(command)
            answer: dict[str, Any] = {"ok": True, "state": self._state()}
        except (DriverError, ValueError, TypeError) as error:
            answer = {"ok": False, "error": str(error)}
        if isinstance(reply_to, str):
            with contextlib.suppress(OSError):  # the asker has gone
                self._socket.sendto(json.dumps(answer).encode(), reply_to)

    def _state(self) -> dict[str, Any]:
        bench = self._bench
        bench.follow()
        unit = bench.amplifier.unit
        return {
            "plugged": {"mdt693b": bench.amplifier.plugged, "ksg101": bench.gauge.plugged},
            "output_v": unit.output_v(bench.settings.axis),
            "drive_v": bench.stage.drive_v,
            "displacement_um": bench.stage.displacement_um,
            "sets": unit.sets_done,
            "readings": bench.gauge_unit.readings_done,
        }

    def _carry_out(self, command: dict[str, Any]) -> None:
        unknown = sorted(set(command) - set(KEYS))
        if unknown:
            raise DriverConfigError(f"unknown key '{unknown[0]}'; known: {', '.join(KEYS)}")
        for_s = float(command.get("for_s", FOREVER_S))
        bench = self._bench
        if command.get("dialect", "1.10") not in DIALECTS:
            raise DriverConfigError(f"unknown dialect; known: {', '.join(DIALECTS)}")
        if command.get("clear"):
            self._clear()
        if "stage" in command:
            bench.follow()
            bench.stage.change(jump=bool(command.get("jump", False)), **command["stage"])
        if "inputs" in command:
            self._inputs(command["inputs"])
        if "amplifier" in command:
            known = [f.name for f in fields(Mdt693bFaults)]
            changes = _known(command["amplifier"], known, "amplifier")
            for name in ("before_reply", "after_reply"):
                if name in changes:
                    changes[name] = str(changes[name]).encode("latin-1")
            bench.amplifier.fault(**changes)
            back = {name: getattr(Mdt693bFaults(), name) for name in changes}
            self._later(for_s, lambda: bench.amplifier.fault(**back))
        if "gauge" in command:
            names = [f.name for f in fields(Ksg101Faults)]
            changes = _known(command["gauge"], names, "gauge")
            self._gauge_fault(changes, for_s)
        if "fault" in command:
            self._fault(command, for_s)
        if command.get("save"):
            if self._log is None or bench.history is None:
                raise DriverConfigError("the bench was started without a log")
            bench.history.save(self._log)

    def _fault(self, command: dict[str, Any], for_s: float) -> None:
        kind, bench = command["fault"], self._bench
        if kind == "late":
            self._gauge_fault({"delay_s": float(command.get("late_s", 0.02))}, for_s)
        elif kind in READING_FAULTS:
            bench.follow()
            bench.stage.fault(kind, for_s)
        elif kind in ("unplug", "stall"):
            device = command.get("device", "mdt693b")
            if device not in DEVICES:
                raise DriverConfigError(f"unknown device '{device}'; known: {', '.join(DEVICES)}")
            pairs = {"mdt693b": bench.amplifier, "ksg101": bench.gauge}
            for name, server in pairs.items():
                if device not in (name, "both"):
                    continue
                if kind == "unplug":
                    server.unplug()
                    if "dialect" in command and server is bench.amplifier:
                        bench.amplifier.unit.set_dialect(str(command["dialect"]))
                    self._later(for_s, server.plug)
                else:
                    server.stall_writes(True)
                    self._later(for_s, functools.partial(server.stall_writes, False))
        else:
            known = ("unplug", "stall", *READING_FAULTS)
            raise DriverConfigError(f"unknown fault '{kind}'; known: {', '.join(known)}")

    def _gauge_fault(self, changes: dict[str, Any], for_s: float) -> None:
        unit = self._bench.gauge_unit
        unit.faults = replace(unit.faults, **changes)
        back = {name: getattr(Ksg101Faults(), name) for name in changes}

        def end() -> None:
            unit.faults = replace(unit.faults, **back)

        self._later(for_s, lambda: self._bench.gauge.call(end))

    def _inputs(self, inputs: dict[str, Any]) -> None:
        values = {k: float(v) for k, v in _known(inputs, INPUTS, "inputs").items()}
        bench = self._bench
        if "ext_v" in values:  # the amplifier sums and clips it
            bench.amplifier.unit.set_ext(bench.settings.axis, values.pop("ext_v"))
        bench.follow()
        bench.stage.set_inputs(**values)

    def _clear(self) -> None:
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        bench = self._bench
        bench.amplifier.clear_faults()
        bench.gauge.stall_writes(False)
        bench.gauge_unit.faults = Ksg101Faults()
        bench.stage.clear_fault()
        for server in bench.servers:
            server.plug()

    def _later(self, for_s: float, action: Callable[[], None]) -> None:
        """Do `action` in the serving thread after for_s; never for an endless fault."""
        if for_s == FOREVER_S:
            return
        self._timers = [timer for timer in self._timers if timer.is_alive()]
        timer = threading.Timer(max(0.0, for_s), action)
        timer.daemon = True
        timer.start()
        self._timers.append(timer)


def _known(table: Any, known: Any, what: str) -> dict[str, Any]:
    if not isinstance(table, dict):
        raise DriverConfigError(f"'{what}' must be an object")
    unknown = sorted(set(table) - set(known))
    if unknown:
        raise DriverConfigError(f"{what}: unknown '{unknown[0]}'; known: {', '.join(known)}")
    return dict(table)


def ask(control: str | Path, command: dict[str, Any], timeout_s: float = 5.0) -> dict[str, Any]:
    """Send a command to a bench's control socket and return its state.

    Raises DriverConfigError with the bench's words when it refuses, DeviceTimeout when no bench
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
