"""The emulated MDT693B as a serial port: the unit of mdt693b_unit on a pty.

In a program (its outputs drive a plant through `on_output`):

    with Mdt693bEmulator("/tmp/mdt693b", Mdt693bKnobs(dialect="1.05"), on_output=drive) as amp:
        ...; amp.fault(hang=True); amp.unplug(); amp.plug(dialect="1.10")

As a process of its own, with commands on its standard input, one per line, each answered by one
line of JSON (`help` lists them):

    python -m dehyst.drivers.emulated.mdt693b_port --link /tmp/mdt693b --dialect 1.05
"""

import argparse
import json
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dehyst.drivers.emulated.mdt693b_dialects import DIALECTS
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bFaults, Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_unit import Mdt693bUnit
from dehyst.drivers.emulated.pty_device import PtyServer, serve

FAULTS = Mdt693bFaults.__struct_fields__


class Mdt693bEmulator(PtyServer):
    """A PtyServer with an Mdt693bUnit. All methods may be called from any thread; the plant
    receives the output in the serving thread."""

    unit: Mdt693bUnit

    def __init__(
        self,
        link_path: str | Path,
        knobs: Mdt693bKnobs | None = None,
        on_output: Callable[[str, float, float], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(Mdt693bUnit(knobs, on_output, clock), link_path, clock)

    def replug(self, dialect: str | None = None) -> None:
        """Plug the cable in again; with `dialect`, the unit now has another firmware."""
        if dialect is not None:
            self.call(lambda: self.unit.set_dialect(dialect))
        self.plug()

    def inject(self, data: bytes) -> None:
        """Send unsolicited bytes from the unit, now."""
        self.call(lambda: self.unit.inject(data))

    def output_v(self, axis: str = "x") -> float:
        """Return the present voltage at an output."""
        return self.call(lambda: self.unit.output_v(axis))


class ControlLines:
    """Commands on standard input, one per line, typed or piped by the emulator's user."""

    def __init__(self, emulator: Mdt693bEmulator, stop: threading.Event) -> None:
        self._emulator = emulator
        self._stop = stop
        self._rest = b""

    def take(self, data: bytes) -> None:
        """Take bytes of standard input; end of input changes nothing."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            print(json.dumps(self.answer(line.decode("utf-8", "replace").split())), flush=True)

    def answer(self, words: list[str]) -> dict[str, Any]:
        """Carry out one command."""
        emulator = self._emulator
        match words:
            case ["unplug"]:
                emulator.unplug()
            case ["plug"]:
                emulator.plug()
            case ["plug", dialect] if dialect in DIALECTS:
                emulator.replug(dialect)
            case ["stall", ("on" | "off") as state]:
                emulator.stall_writes(state == "on")
            case ["fault", name, value] if name in FAULTS:
                default = getattr(Mdt693bFaults(), name)
                try:
                    emulator.fault(**{name: _parse(default, value)})
                except ValueError as error:
                    return {"ok": False, "error": str(error)}
            case ["clear"]:
                emulator.clear_faults()
            case ["state"]:
                pass
            case ["quit"]:
                self._stop.set()
            case _:
                return {
                    "ok": False,
                    "error": "commands: unplug, plug [DIALECT], stall on|off, fault NAME VALUE, "
                    f"clear, state, quit; faults: {', '.join(FAULTS)}",
                }
        unit = emulator.unit
        outputs = {axis: unit.output_v(axis) for axis in unit.knobs.axes}
        return {
            "ok": True,
            "plugged": emulator.plugged,
            "outputs_v": outputs,
            "commands": unit.commands_done,
            "sets": unit.sets_done,
            "sets_of_all": unit.sets_of_all,
        }


def _parse(default: object, text: str) -> object:
    """Convert `text` to the type of `default`; bytes are in hexadecimal."""
    if isinstance(default, bool):
        if text not in ("on", "off"):
            raise ValueError(f"{text!r} is neither on nor off")
        return text == "on"
    if isinstance(default, bytes):
        return bytes.fromhex(text)
    return type(default)(text)  # type: ignore[call-arg]


def main(arguments: list[str] | None = None) -> int:
    """Run the emulator in the foreground until SIGTERM, SIGINT or `quit`."""
    parser = argparse.ArgumentParser(
        prog="python -m dehyst.drivers.emulated.mdt693b_port",
        description="An emulated MDT693B on a pseudo-terminal.",
        epilog="example: python -m dehyst.drivers.emulated.mdt693b_port --link /tmp/mdt693b",
    )
    plain = Mdt693bKnobs()
    parser.add_argument("--link", required=True, help="path at which the port appears")
    parser.add_argument("--dialect", choices=sorted(DIALECTS), default=plain.dialect)
    parser.add_argument("--limit-v", type=int, choices=(75, 100, 150), default=plain.limit_v)
    parser.add_argument("--latency-s", type=float, default=plain.latency_s)
    parser.add_argument("--jitter-s", type=float, default=plain.jitter_s)
    parser.add_argument("--chunk-size", type=int, default=0, help="bytes per write of a reply")
    parser.add_argument("--start-v", type=float, default=0.0, help="output at power-on")
    parser.add_argument("--serial-number", default=plain.serial_number)
    parser.add_argument("--no-echo", dest="echo", action="store_false")
    options = vars(parser.parse_args(arguments))
    emulator = Mdt693bEmulator(options.pop("link"), Mdt693bKnobs(**options))
    stop = threading.Event()

    def end(number: int, frame: object) -> None:
        stop.set()
        emulator.wake()

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    emulator.plug()
    print(json.dumps({"ready": emulator.port}), flush=True)
    try:
        serve([emulator], stop, [(sys.stdin.fileno(), ControlLines(emulator, stop).take)])
    finally:
        emulator.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main())
