"""An emulated MDT693B (or MDT694B): bytes in, bytes out, no port and no clock of its own.

What it answers is in mdt693b_commands; this module is the line discipline and the electrical
side around it: echo, line buffer, one command after another with latency, jitter and a rate
limit, replies in chunks, faults on demand, DAC step, ADC readback with offset, noise and lag.

    unit = Mdt693bUnit(Mdt693bKnobs(dialect="1.10"), on_output=stage.drive, clock=time.monotonic)
    unit.feed(b"xvoltage=12.5\\r"); unit.take()     # b">" (and the stage is told 12.5 V)
"""

import math
import random
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from dehyst.drivers.mdt693b_commands import Mdt693bSettings, answer
from dehyst.drivers.mdt693b_dialects import DIALECTS, ReplyStyle

DAC_STEP_V = 2.75e-3
ADC_STEP_V = 3.0e-3
EXT_GAINS = {75: 7.5, 100: 10.0, 150: 15.0}
LONGEST_LINE = 256


@dataclass(frozen=True)
class Mdt693bKnobs:
    """How the emulated unit is built and how it behaves; the defaults are a plausible unit.

    dialect: firmware "1.05", "1.06", "1.09" or "1.10". axes: "xyz", or "x" for an MDT694B.
    echo: echo at power-on. limit_v: the limit switch, 75, 100 or 150. range_error: what a modern
    unit answers to an argument out of range (b"!" is the other candidate). latency_s, jitter_s:
    from the end of a command to its reply; the jitter is added, uniform from 0 to jitter_s. The
    defaults give about 320 sets/s; 0 and 0 are as fast as the pty. min_period_s: least time
    between two commands. chunk_size, chunk_gap_s: bytes per write of a reply (0: whole) and the
    time between the writes. readback_*: the ADC's offset, rms noise and lag. dac_step_v,
    adc_step_v: 0 switches the rounding off. start_v: the recalled output at power-on.
    compatibility: MDT693A commands at power-on; compatibility_only: then it takes no others.
    """

    dialect: str = "1.10"
    axes: str = "xyz"
    serial_number: str = "150226175403"
    friendly_name: str = "MDT693B"
    echo: bool = True
    compatibility: bool = False
    compatibility_only: bool = False
    limit_v: int = 150
    range_error: bytes = b"CMD_ARG_INVALID"
    latency_s: float = 0.0026
    jitter_s: float = 0.0003
    min_period_s: float = 0.0
    chunk_size: int = 0
    chunk_gap_s: float = 0.0
    readback_offset_v: float = 0.2
    readback_noise_v: float = 1.5e-3
    readback_lag_s: float = 0.1
    dac_step_v: float = DAC_STEP_V
    adc_step_v: float = ADC_STEP_V
    start_v: float = 0.0
    seed: int = 0


@dataclass
class Mdt693bFaults:
    """Faults that can be switched while the unit runs.

    hang: takes bytes, does nothing, answers nothing; what came in meanwhile is lost. mute: does
    what it is told and answers nothing. lose_sets: acknowledges sets without carrying them out.
    readback_error_v: added to the readback. before_reply, after_reply: bytes (NUL, LF, a stale
    "*" or ">") sent before and after each of the next `count` replies; garbage: random printable
    bytes in place of the next `count` replies; half: the next `count` replies are cut in half;
    delay_s: the next `count` replies come this much later.
    """

    hang: bool = False
    mute: bool = False
    lose_sets: bool = False
    readback_error_v: float = 0.0
    before_reply: bytes = b""
    after_reply: bytes = b""
    garbage: bool = False
    half: bool = False
    delay_s: float = 0.0
    count: int = 0


@dataclass
class _Readback:
    """The ADC's view of one output: a first-order lag behind the true voltage."""

    seen_v: float
    at_s: float


@dataclass(frozen=True)
class _Waiting:
    """A command line that will be carried out at `due_s`."""

    due_s: float
    line: str


class Mdt693bUnit:
    """See the module. on_output(axis, volts, time_s) is called whenever an output changes: the
    voltage after DAC rounding, master scan and EXT, clipped at the limit switch; `time_s` is on
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
        self.settings = Mdt693bSettings.at_power_on(
            axes=self.knobs.axes,
            limit_v=self.knobs.limit_v,
            echo=self.knobs.echo,
            compatibility=self.knobs.compatibility,
            compatibility_only=self.knobs.compatibility_only,
            serial_number=self.knobs.serial_number,
            friendly_name=self.knobs.friendly_name,
            start_v=self.knobs.start_v,
            range_error=self.knobs.range_error,
        )
        self.ext_v = dict.fromkeys(self.knobs.axes, 0.0)
        self.commands_done = 0
        self.sets_done = 0
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

    # -- what a pty server needs

    def feed(self, data: bytes) -> None:
        """Bytes from the host arrive now."""
        now = self._clock()
        if self.faults.hang:
            return
        for byte in data:
            char = bytes([byte])
            if self.settings.echo:
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
        """The next chunk that leaves by now; carries out the commands that are due by now."""
        now = self._clock()
        while self._queue and self._queue[0].due_s <= now:
            self._carry_out(self._queue.popleft())
        if self._outgoing and self._outgoing[0][0] <= now:
            return self._outgoing.popleft()[1]
        return b""

    def next_due_s(self) -> float | None:
        """Clock time at which take() has something next."""
        due = [q[0].due_s for q in (self._queue,) if q]
        due += [q[0][0] for q in (self._outgoing,) if q]
        return min(due, default=None)

    def link_lost(self) -> None:
        """The cable was pulled. The outputs and the settings stay."""
        self._line = b""
        self._last_terminator = b""
        self._queue.clear()
        self._outgoing.clear()

    # -- what a test or a plant asks for

    def output_v(self, axis: str) -> float:
        """The voltage at the output terminal now."""
        return self._output[axis]

    def set_ext(self, axis: str, volts: float) -> None:
        """Apply `volts` (0 to 10) to the EXT input of an axis."""
        self.ext_v[axis] = volts
        self._update(self._clock())

    def set_dialect(self, dialect: str) -> None:
        """Another firmware, as when a different unit is plugged in at the same port."""
        self.style = DIALECTS[dialect]

    def inject(self, data: bytes) -> None:
        """Bytes that the unit sends by itself, now."""
        self._outgoing.append((self._clock(), data))

    # -- inside

    def _accept(self, line: str, now: float) -> None:
        start = max(now, self._free_s, self._started_s + self.knobs.min_period_s)
        took = self.knobs.latency_s + self.knobs.jitter_s * self._random.random()
        self._started_s, self._free_s = start, start + took
        self._queue.append(_Waiting(start + took, line))

    def _carry_out(self, waiting: _Waiting) -> None:
        if self.faults.hang:
            return
        self.commands_done += 1
        before = self.settings.set_v  # a set puts a new table in its place
        reply = answer(
            self.settings, self.style, waiting.line, lambda axis: self._read(axis, waiting.due_s)
        )
        if self.settings.set_v is not before:
            self.sets_done += 1
            if self.faults.lose_sets:
                self.settings.set_v = before
        self._update(waiting.due_s)
        if not self.faults.mute:
            self._reply(reply, waiting.due_s)

    def _reply(self, reply: bytes, due_s: float) -> None:
        faults = self.faults
        if faults.count > 0:
            faults.count -= 1
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
        """One write for the echo of what came in one read."""
        if not self.knobs.chunk_size and len(self._outgoing) > 1:
            due, whole = self._outgoing[0][0], b"".join(chunk for _, chunk in self._outgoing)
            if all(d == due for d, _ in self._outgoing):
                self._outgoing.clear()
                self._outgoing.append((due, whole))

    def _voltage(self, axis: str) -> float:
        settings = self.settings
        command_v = settings.set_v[axis] + (settings.scan_v if settings.scan_on else 0.0)
        if self.knobs.dac_step_v > 0.0:
            command_v = round(command_v / self.knobs.dac_step_v) * self.knobs.dac_step_v
        ext_v = 0.0 if settings.scan_on else self.ext_v[axis]
        volts = command_v + EXT_GAINS[settings.limit_v] * ext_v
        return min(max(volts, 0.0), float(settings.limit_v))

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
        """Bring the lagging readback of an axis to the time `now`."""
        state, lag_s = self._readback[axis], self.knobs.readback_lag_s
        gone = 1.0 if lag_s <= 0.0 else -math.expm1(-max(0.0, now - state.at_s) / lag_s)
        state.seen_v += (self._output[axis] - state.seen_v) * gone
        state.at_s = max(state.at_s, now)
        return state.seen_v

    def _read(self, axis: str, now: float) -> float:
        volts = self._follow(axis, now) + self.knobs.readback_offset_v
        volts += self._random.gauss(0.0, self.knobs.readback_noise_v) + self.faults.readback_error_v
        if self.knobs.adc_step_v > 0.0:
            volts = round(volts / self.knobs.adc_step_v) * self.knobs.adc_step_v
        return volts
