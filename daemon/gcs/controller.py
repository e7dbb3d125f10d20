"""Implements the GCS commands that motion programs use, for the axes of one controller.

`dialect.TABLE` lists them. An open-loop stage is controlled as if it were closed-loop: `SVO` takes
the command lease, the model (or the gauge) determines when an axis is on target, and an axis stays
where it was sent until its servo is switched off or the connection that commanded it ends.
"""

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.daemon.client.held_axes import HeldAxes
from dehyst.daemon.client.readings import AxisView
from dehyst.daemon.gcs.grammar import GcsCode, GcsError, groups, integer, join_lines, parse_number
from dehyst.daemon.gcs.waves import MOST_CYCLES, MOST_POINTS, MOST_RATE, TABLES, Waves, segment
from dehyst.models.errors import DehystError

log = logging.getLogger(__name__)
SERVO_PERIOD, RANGE_LOW, RANGE_HIGH, AXIS_UNIT = 0x0E000200, 0x07000000, 0x07000001, 0x07000601
PARAMETERS = {
    SERVO_PERIOD: "Servo Update Time (s)",
    RANGE_LOW: "Range Limit min",
    RANGE_HIGH: "Range Limit max",
    AXIS_UNIT: "Axis Unit",
}
UNITS = {"um": "UM", "nm": "NM", "mrad": "MRAD", "urad": "URAD"}


@dataclass
class GcsSession:
    """State of one connection: its last error."""

    error: GcsCode = GcsCode.NO_ERROR


class GcsController:
    """Executes commands. held: the axes; version: of this program. Each connection calls it from
    its own thread."""

    def __init__(self, held: HeldAxes, version: str) -> None:
        self.held, self.version = held, version
        views = held.look()
        self.names = {(axis or "1").upper(): axis for axis in views}
        self._servo: dict[str, bool] = dict.fromkeys(self.names, False)
        self._commands: dict[str, GcsSession] = {}  # by axis: who switched it on or moved it last
        self.waves = Waves(tuple(self.names))
        self.lock = threading.Lock()

    # -- a connection ---------------------------------------------------------------------------

    def leave(self, session: GcsSession) -> None:
        """Switch the servos off that an ended connection commanded. All axes are released with the
        last servo, as for any client; while another connection commands an axis, they stay."""
        with self.lock:
            commanded = [name for name, one in self._commands.items() if one is session]
            if not commanded:
                return
            flying = any(self.view_of(name).flying for name in commanded)
            for name in list(self.names) if flying else commanded:  # a wave ends for all axes
                self._servo[name] = False
                self._commands.pop(name, None)
            if any(self._servo.values()):
                return
            try:
                self.held.let_go()
            except DehystError as error:
                log.warning("a connection ended, and the controller does not answer: %s", error)

    # -- shared by the commands ------------------------------------------------------------------

    def _axes(self, args: Sequence[str]) -> list[str]:
        """Return the names of the given axes, all if none is given. Raises GcsError."""
        for name in args:
            if name.upper() not in self.names:
                raise GcsError(GcsCode.INVALID_AXIS, f"there is no axis {name}")
        return [name.upper() for name in args] or list(self.names)

    def view_of(self, name: str) -> AxisView:
        return self.held.look()[self.names[name]]

    def each(self, args: Sequence[str], value: Callable[[str, AxisView], str]) -> str:
        return join_lines(f"{name}={value(name, self.view_of(name))}" for name in self._axes(args))

    def _pairs(self, args: Sequence[str]) -> list[tuple[str, str]]:
        """Return (axis, value) pairs. Raises GcsError."""
        pairs = groups(args, 2)
        return [(self._axes([name])[0], text) for name, text in pairs]

    def is_held(self, name: str) -> bool:
        """Return whether the servo is on; it is switched off if another client has taken over."""
        if self._servo[name] and self.view_of(name).lost:
            self._servo[name] = False
        return self._servo[name]

    def _need_servo(self, name: str) -> None:
        if not self.is_held(name):
            lost = self.view_of(name).lost
            raise GcsError(
                GcsCode.NO_SERVO, f"the servo of axis {name} is off; {lost or 'SVO first'}"
            )
        if self.view_of(name).flying:
            raise GcsError(GcsCode.WAVE_GENERATOR_ACTIVE, f"axis {name} plays a wave")

    def _move(self, session: GcsSession, targets: dict[str, float]) -> str:
        for name, value in targets.items():
            self._need_servo(name)
            view = self.view_of(name)
            if not view.low <= value <= view.high:
                raise GcsError(
                    GcsCode.OUT_OF_LIMITS,
                    f"axis {name}: {value:g} {view.unit} is outside {view.low:g} to {view.high:g}",
                )
        self.held.go({self.names[name]: value for name, value in targets.items()})
        self._commands.update(dict.fromkeys(targets, session))
        return ""

    def asked(self, name: str) -> float:
        view = self.view_of(name)
        return view.asked if np.isfinite(view.asked) and not view.lost else view.predicted

    # -- motion ---------------------------------------------------------------------------------

    def set_servo(self, session: GcsSession, args: Sequence[str]) -> str:
        """SVO: on takes the lease without moving; off on the last axis releases all axes."""
        for name, text in self._pairs(args):
            on = bool(integer(text, 0, 1, "servo"))
            if on:
                self.held.take()
                self._commands[name] = session
                self._servo[name] = True
            else:
                self._commands.pop(name, None)
                self._servo[name] = False
                if not any(self._servo.values()):
                    self.held.let_go()
        return ""

    def move(self, session: GcsSession, args: Sequence[str]) -> str:
        """MOV: move to a target."""
        return self._move(session, {name: parse_number(text) for name, text in self._pairs(args)})

    def move_by(self, session: GcsSession, args: Sequence[str]) -> str:
        """MVR: move relative to the last target."""
        by = {name: parse_number(text) for name, text in self._pairs(args)}
        return self._move(session, {name: self.asked(name) + step for name, step in by.items()})

    def go_home(self, session: GcsSession, args: Sequence[str]) -> str:
        """GOH: move to 0."""
        return self._move(session, dict.fromkeys(self._axes(args), 0.0))

    def stop(self, session: GcsSession, args: Sequence[str]) -> str:
        """STP, HLT: stop all axes, as the axes of one amplifier stop together."""
        self._axes(args)
        self.held.stop()
        raise GcsError(GcsCode.STOP, "stopped by command")

    # -- waves ----------------------------------------------------------------------------------

    def write_wave(self, session: GcsSession, args: Sequence[str]) -> str:
        """WAV: write a segment to a wave table."""
        if len(args) < 3:
            raise GcsError(
                GcsCode.PARAM_COUNT, "WAV takes a table, X, & or +, a kind and its numbers"
            )
        table = integer(args[0], 1, TABLES, "wave table")
        self.waves.write(table, args[1].upper(), segment(args[2].upper(), args[3:]))
        return ""

    def _generator(self, text: str) -> str:
        return self.waves.axes[integer(text, 1, len(self.waves.axes), "wave generator") - 1]

    def _idle(self, axis: str) -> str:
        if self.view_of(axis).flying:
            raise GcsError(GcsCode.WAVE_GENERATOR_ACTIVE, f"the generator of axis {axis} runs")
        return axis

    def select_wave(self, session: GcsSession, args: Sequence[str]) -> str:
        """WSL: select the wave table of a generator."""
        for generator, table in groups(args, 2):
            axis = self._idle(self._generator(generator))
            self.waves.chosen[axis] = integer(table, 0, TABLES, "wave table")
        return ""

    def set_cycles(self, session: GcsSession, args: Sequence[str]) -> str:
        """WGC: set the number of cycles."""
        for generator, count in groups(args, 2):
            axis = self._idle(self._generator(generator))
            self.waves.cycles[axis] = integer(count, 0, MOST_CYCLES, "number of cycles")
        return ""

    def set_offset(self, session: GcsSession, args: Sequence[str]) -> str:
        """WOS: set the offset of a generator."""
        for generator, offset in groups(args, 2):
            self.waves.offset[self._idle(self._generator(generator))] = parse_number(offset)
        return ""

    def set_rate(self, session: GcsSession, args: Sequence[str]) -> str:
        """WTR: set one rate for all generators; the loop always interpolates."""
        for generator, rate, interpolation in groups(args, 3):
            if integer(generator, 0, len(self.waves.axes), "wave generator") == 0:
                for axis in self.waves.axes:
                    self._idle(axis)
            integer(interpolation, 0, 1, "interpolation")
            self.waves.rate = integer(rate, 1, MOST_RATE, "table rate")
        return ""

    def start_waves(self, session: GcsSession, args: Sequence[str]) -> str:
        """WGO: stop (mode 0) or start at once (mode 1)."""
        modes = {
            self._generator(generator): integer(mode, 0, 1, "start mode")
            for generator, mode in groups(args, 2)
        }
        begin = [axis for axis, mode in modes.items() if mode]
        if any(self.view_of(axis).flying for axis, mode in modes.items() if not mode):
            self.held.stop()
        if not begin:
            return ""
        for axis in begin:
            self._need_servo(axis)
        t_s, targets, cycles = self.waves.play_of(begin, self.view_of(begin[0]).period_s)
        self.held.fly(t_s, {self.names[axis]: wave for axis, wave in targets.items()}, cycles)
        self._commands.update(dict.fromkeys(begin, session))
        return ""

    def clear_waves(self, session: GcsSession, args: Sequence[str]) -> str:
        """WCL: clear wave tables."""
        for (table,) in groups(args, 1):
            self.waves.tables.pop(integer(table, 1, TABLES, "wave table"), None)
        return ""

    def generators(self, args: Sequence[str], value: Callable[[str], str]) -> str:
        wanted = [self._generator(text) for text in args] or list(self.waves.axes)
        return join_lines(f"{self.waves.axes.index(axis) + 1}={value(axis)}" for axis in wanted)

    def wave_lengths(self, session: GcsSession, args: Sequence[str]) -> str:
        """WAV?: report parameter 1, the number of points."""
        wanted = [integer(t, 1, TABLES, "wave table") for t, _ in groups(args, 2)] if args else []
        tables = self.waves.tables
        return join_lines(
            f"{table} 1={tables[table].size if table in tables else 0:d}"
            for table in wanted or range(1, TABLES + 1)
        )

    def wave_points(self, session: GcsSession, args: Sequence[str]) -> str:
        """GWD?: report points (start, number, tables) with the header of a GCS array."""
        if len(args) < 2:
            raise GcsError(GcsCode.PARAM_COUNT, "GWD? takes a start point, a number and a table")
        start = integer(args[0], 1, MOST_POINTS, "start point")
        count = integer(args[1], 1, MOST_POINTS, "number of points")
        wanted = [integer(text, 1, TABLES, "wave table") for text in args[2:]]
        columns = [self.waves.tables.get(t, np.zeros(0)) for t in wanted]
        if not columns or any(start - 1 + count > column.size for column in columns):
            raise GcsError(GcsCode.PARAM_OUT_OF_RANGE, "the table does not have these points")
        step_s = self.view_of(self.waves.axes[0]).period_s * self.waves.rate
        header = [
            "# TYPE = 1",
            "# SEPARATOR = 32",
            f"# DIM = {len(columns)}",
            f"# SAMPLE_TIME = {step_s:.6f}",
            f"# NDATA = {count}",
            *(f"# NAME{i} = Wave Table {table}" for i, table in enumerate(wanted)),
            "# END_HEADER",
        ]
        rows = np.column_stack([column[start - 1 : start - 1 + count] for column in columns])
        return join_lines([*header, *(" ".join(f"{v:.6f}" for v in row) for row in rows)])

    # -- queries --------------------------------------------------------------------------------

    def last_error(self, session: GcsSession, args: Sequence[str]) -> str:
        """ERR?: report the code of the last error once."""
        code, session.error = session.error, GcsCode.NO_ERROR
        return f"{int(code)}\n"

    def identify(self, session: GcsSession, args: Sequence[str]) -> str:
        """*IDN?, IDN?: report the device identification."""
        return f"dehyst, {self.held.name}, 0, {self.version}\n"

    def mask(self, which: Callable[[AxisView], bool]) -> str:
        """Return a hexadecimal bit mask over the axes; the first axis is the lowest bit."""
        bits = sum(which(self.view_of(name)) << bit for bit, name in enumerate(self.names))
        return f"{bits:X}\n"

    def status_register(self, session: GcsSession, args: Sequence[str]) -> str:
        """#4, STA?: report 16 bits per axis: moving 0x2000, on target 0x8000, servo on 0x1000."""
        value = 0
        for place, name in enumerate(self.names):
            view = self.view_of(name)
            bits = 0x2000 * view.moving | 0x8000 * view.on_target | 0x1000 * self.is_held(name)
            value |= bits << 16 * place
        return f"0x{value:X}\n"

    def parameters(self, session: GcsSession, args: Sequence[str]) -> str:
        """SPA?: report the few parameters that programs query."""
        rows = []
        for name, text in self._pairs(args) if args else []:
            which, view = integer(text, 0, 0xFFFFFFFF, "parameter"), self.view_of(name)
            known = {
                SERVO_PERIOD: f"{view.period_s:.9f}",
                RANGE_LOW: f"{view.low:.6f}",
                RANGE_HIGH: f"{view.high:.6f}",
                AXIS_UNIT: UNITS.get(view.unit, view.unit.upper()),
            }
            if which not in known:
                raise GcsError(GcsCode.UNKNOWN_PARAMETER, f"parameter 0x{which:X} is not known")
            rows.append(f"{name} 0x{which:X}={known[which]}")
        if not rows:
            raise GcsError(GcsCode.PARAM_COUNT, "SPA? takes pairs of axis and parameter")
        return join_lines(rows)

    def parameter_help(self, session: GcsSession, args: Sequence[str]) -> str:
        """HPA?: list the parameters."""
        rows = [
            f"0x{p:X}=\t0\t1\t{'CHAR' if p == AXIS_UNIT else 'FLOAT'}\taxis\t{says}"
            for p, says in PARAMETERS.items()
        ]
        return join_lines(["The following parameters are valid:", *rows, "end of help"])
