"""An emulated MDT693B (or MDT694B): bytes in, bytes out, without a port or a clock of its own.

mdt693b_commands defines its answers. This module simulates the line discipline and the electrical
side: echo, line buffer, one command after another with latency, jitter and a rate limit, replies in
chunks, faults on demand, DAC step, ADC readback with offset, noise and lag.

    unit = Mdt693bUnit(Mdt693bKnobs(dialect="1.10"), on_output=stage.drive, clock=time.monotonic)
    unit.feed(b"xvoltage=12.5\\r"); unit.take()     # b">" (and the stage gets 12.5 V)
"""

import math
import random
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from msgspec import structs

from dehyst.drivers.emulated.mdt693b_commands import Mdt693bRegisters, execute_line
from dehyst.drivers.emulated.mdt693b_dialects import DIALECTS, ReplyStyle
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bFaults, Mdt693bKnobs

EXT_GAINS = {75: 7.5, 100: 10.0, 150: 15.0}
"""Limit switch [V] -> output volts per volt at EXT, where 10 V is full output."""
LONGEST_LINE = 256
"""Characters of a command line that are kept."""


@dataclass
class _Readback:
    """The ADC's reading of one output: a first-order lag of the true voltage."""

    seen_v: float
    at_s: float


@dataclass(frozen=True)
class _Waiting:
    """A command line that will be carried out at `due_s`."""

    due_s: float
    line: str


class Mdt693bUnit:
    """The emulated unit. on_output(axis, volts, time_s) is called whenever an output changes, with
    the voltage after DAC rounding, master scan and EXT, clipped at the limit switch; `time_s` is on
    the unit's clock and never runs backwards."""

    def __init__(
        self,
        knobs: Mdt693bKnobs | None = None,
        on_output: Callable[[str, float, float], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.knobs = knobs or Mdt693bKnobs()
        self.faults = Mdt693bFaults()
        self.style: ReplyStyle = DIALECTS[self.knobs.dialect]
        self.registers = Mdt693bRegisters.at_power_on(self.knobs)
        self.ext_v = dict.fromkeys(self.knobs.axes, 0.0)
        self.commands_done = 0
        self.sets_done = 0
        self.sets_of_all = 0
        self._on_output = on_output
        self._clock = clock
        self._random = random.Random(self.knobs.seed)
        self._line = b""
        self._last_terminator = b""
        self._queue: deque[_Waiting] = deque()
        self._outgoing: deque[tuple[float, bytes]] = deque()
        self._free_s = -math.inf
        self._started_s = -math.inf
        now = clock()
        self._output = {axis: self._voltage(axis) for axis in self.knobs.axes}
        self._readback = {axis: _Readback(v, now) for axis, v in self._output.items()}
        for axis, volts in self._output.items():
            self._tell(axis, volts, now)

    # -- for the pty server

    def feed(self, data: bytes) -> None:
        """Take bytes from the host that arrive now."""
        now = self._clock()
        if self.faults.hang:
            return
        for byte in data:
            char = bytes([byte])
            if self.registers.echo:
                self._outgoing.append((now, char))
            if char in b"\r\n":
                pair = self._last_terminator + char
                self._last_terminator = char
                if pair in (b"\r\n", b"\n\r") and not self._line:
                    self._last_terminator = b""  # CR LF is one terminator, CR CR is two
                    continue
                self._accept(self._line.decode("latin-1"), now)
                self._line = b""
            else:
                self._last_terminator = b""
                if len(self._line) < LONGEST_LINE:
                    self._line += char
        self._merge_echo()

    def take(self) -> bytes:
        """Carry out the commands that are due; return the next chunk that is due by now."""
        now = self._clock()
        while self._queue and self._queue[0].due_s <= now:
            self._carry_out(self._queue.popleft())
        if self._outgoing and self._outgoing[0][0] <= now:
            return self._outgoing.popleft()[1]
        return b""

    def next_due_s(self) -> float | None:
        """Return the clock time at which take() next has something."""
        due = [q[0].due_s for q in (self._queue,) if q]
        due += [q[0][0] for q in (self._outgoing,) if q]
        return min(due, default=None)

    def link_lost(self) -> None:
        """Handle a pulled cable. The outputs and the registers are kept."""
        self._line = b""
        self._last_terminator = b""
        self._queue.clear()
        self._outgoing.clear()

    # -- for a test or a plant

    def output_v(self, axis: str) -> float:
        """Return the present voltage at the output terminal."""
        return self._output[axis]

    def set_ext(self, axis: str, volts: float) -> None:
        """Apply `volts` (0 to 10) to the EXT input of an axis."""
        self.ext_v[axis] = volts
        self._update(self._clock())

    def set_dialect(self, dialect: str) -> None:
        """Change the firmware, as if a different unit were plugged in at the same port."""
        self.style = DIALECTS[dialect]

    def set_serial_number(self, number: int) -> None:
        """Report the serial number of a different unit at the same port."""
        self.registers.serial_number = str(number)

    def inject(self, data: bytes) -> None:
        """Send unsolicited bytes from the unit, now."""
        self._outgoing.append((self._clock(), data))

    # -- internal

    def _accept(self, line: str, now: float) -> None:
        start = max(now, self._free_s, self._started_s + self.knobs.min_period_s)
        took = self.knobs.latency_s + self.knobs.jitter_s * self._random.random()
        self._started_s, self._free_s = start, start + took
        self._queue.append(_Waiting(start + took, line))

    def _carry_out(self, waiting: _Waiting) -> None:
        if self.faults.hang:
            return
        self.commands_done += 1
        before = self.registers.set_v  # a set replaces the table
        reply = execute_line(
            self.registers, self.style, waiting.line, lambda axis: self._read(axis, waiting.due_s)
        )
        if self.registers.set_v is not before:
            self.sets_done += 1
            self.sets_of_all += waiting.line.strip().lower().startswith("xyzvoltage=")
            if self.faults.lose_sets:
                self.registers.set_v = before
        self._update(waiting.due_s)
        if not self.faults.mute:
            self._reply(reply, waiting.due_s)

    def _reply(self, reply: bytes, due_s: float) -> None:
        faults = self.faults
        if faults.count > 0:
            self.faults = structs.replace(faults, count=faults.count - 1)
            if faults.garbage:
                reply = bytes(self._random.choice(b"abcxyz0123456789[].,") for _ in range(12))
            if faults.half:
                reply = reply[: len(reply) // 2]
            reply = faults.before_reply + reply + faults.after_reply
            due_s += faults.delay_s
        size = self.knobs.chunk_size or len(reply)
        for start in range(0, len(reply), max(1, size)):
            self._outgoing.append((due_s, reply[start : start + size]))
            due_s += self.knobs.chunk_gap_s

    def _merge_echo(self) -> None:
        """Merge the echo of bytes that arrived in one read into one write."""
        if not self.knobs.chunk_size and len(self._outgoing) > 1:
            due, whole = self._outgoing[0][0], b"".join(chunk for _, chunk in self._outgoing)
            if all(d == due for d, _ in self._outgoing):
                self._outgoing.clear()
                self._outgoing.append((due, whole))

    def _voltage(self, axis: str) -> float:
        registers = self.registers
        command_v = registers.set_v[axis] + (registers.scan_v if registers.scan_on else 0.0)
        if self.knobs.dac_step_v > 0.0:
            command_v = round(command_v / self.knobs.dac_step_v) * self.knobs.dac_step_v
        ext_v = 0.0 if registers.scan_on else self.ext_v[axis]
        volts = command_v + EXT_GAINS[registers.limit_v] * ext_v
        return min(max(volts, 0.0), float(registers.limit_v))

    def _update(self, now: float) -> None:
        for axis in self.knobs.axes:
            volts = self._voltage(axis)
            if volts != self._output[axis]:
                self._follow(axis, now)
                self._output[axis] = volts
                self._tell(axis, volts, now)

    def _tell(self, axis: str, volts: float, now: float) -> None:
        if self._on_output is not None:
            self._on_output(axis, volts, now)

    def _follow(self, axis: str, now: float) -> float:
        """Advance the lagging readback of an axis to the time `now` and return it."""
        state, lag_s = self._readback[axis], self.knobs.readback_lag_s
        gone = 1.0 if lag_s <= 0.0 else -math.expm1(-max(0.0, now - state.at_s) / lag_s)
        state.seen_v += (self._output[axis] - state.seen_v) * gone
        state.at_s = max(state.at_s, now)
        return state.seen_v

    def _read(self, axis: str, now: float) -> float:
        volts = self._follow(axis, now) + self.knobs.readback_offset_v
        volts += self._random.gauss(0.0, self.knobs.readback_noise_v)
        if self.faults.readback_error_axis in ("", axis):
            volts += self.faults.readback_error_v
        if self.knobs.adc_step_v > 0.0:
            volts = round(volts / self.knobs.adc_step_v) * self.knobs.adc_step_v
        return volts
