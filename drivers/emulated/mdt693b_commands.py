"""How the emulated MDT693B handles each command line (firmware 1.10 help text and manual).

`execute_line` takes the registers of the unit, one line without its terminator and a function that
reads the ADC, changes the registers and returns the bytes of the reply. Two tables, QUERIES and
SETTERS, hold the commands that are the same for every axis; the axis commands are parsed by letter.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from dehyst.drivers.emulated.mdt693b_dialects import ReplyStyle
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs

ReadVolts = Callable[[str], float]

HELP = """Product help
?                  lists the available commands
ID?                product header and firmware version
SERIAL?            serial number
FRIENDLY?/=        friendly name
RESTORE            factory settings
ECHO?/=            echo, 0 or 1
VLIMIT?            output voltage limit
INTENSITY?/=       display intensity, 0 to 15
XVOLTAGE?/=        output voltage; also YVOLTAGE, ZVOLTAGE
ALLVOLTAGE=        all output voltages
XYZVOLTAGE?/=      the output voltages x,y,z
XMIN?/= XMAX?/=    limits of an output; also YMIN, YMAX, ZMIN, ZMAX
SYSMIN?/= SYSMAX?/= limits of all outputs
MSENABLE?/=        master scan, 0 or 1
MSVOLTAGE?/=       master scan voltage
DACSTEP?/=         step of the arrow commands
CM?/=              MDT693A compatibility mode, 0 or 1
ROTARYMODE?/=      rotary mode
PUSHDISABLE?/=     push to adjust, 0 or 1"""


class _BadArgument(Exception):
    """The argument cannot be used."""


@dataclass
class Mdt693bRegisters:
    """All state that commands can change. Voltages in V, by axis letter."""

    axes: str
    limit_v: int
    echo: bool
    compatibility: bool
    compatibility_only: bool
    serial_number: str
    friendly_name: str
    range_error: bytes
    bare_numbers: bool
    compatibility_prompt: bytes
    set_v: dict[str, float]
    min_v: dict[str, float]
    max_v: dict[str, float]
    scan_on: bool = False
    scan_v: float = 0.0
    intensity: int = 15
    dac_step: int = 1
    rotary_mode: int = 0
    push_disable: int = 0
    sys_min_v: float = 0.0
    sys_max_v: float = field(default=150.0)

    @classmethod
    def at_power_on(cls, knobs: Mdt693bKnobs) -> Self:
        """Return the state after power-on: limits from the switch, the recalled output."""
        axes, highest_v = knobs.axes, knobs.limit_v + 0.5
        return cls(
            axes=axes,
            limit_v=knobs.limit_v,
            echo=knobs.echo,
            compatibility=knobs.compatibility,
            compatibility_only=knobs.compatibility_only,
            serial_number=knobs.serial_number,
            friendly_name=knobs.friendly_name,
            range_error=knobs.range_error,
            bare_numbers=knobs.bare_numbers,
            compatibility_prompt=knobs.compatibility_prompt,
            set_v=dict.fromkeys(axes, knobs.start_v),
            min_v=dict.fromkeys(axes, 0.0),
            max_v=dict.fromkeys(axes, highest_v),
            sys_max_v=highest_v,
        )

    def check_v(self, axis: str, volts: float) -> None:
        """Raise _BadArgument unless an axis may be set to `volts`."""
        low, high = max(self.min_v[axis], self.sys_min_v), min(self.max_v[axis], self.sys_max_v)
        if not low <= volts <= high:
            raise _BadArgument

    def restore(self) -> None:
        """Restore factory settings: the outputs go to zero and the echo is on."""
        self.set_v = dict.fromkeys(self.axes, 0.0)
        self.min_v = dict.fromkeys(self.axes, 0.0)
        self.max_v = dict.fromkeys(self.axes, self.limit_v + 0.5)
        self.sys_min_v, self.sys_max_v = 0.0, self.limit_v + 0.5
        self.echo, self.compatibility = True, False
        self.scan_on, self.scan_v = False, 0.0
        self.intensity, self.dac_step, self.rotary_mode, self.push_disable = 15, 1, 0, 0


def execute_line(
    registers: Mdt693bRegisters, style: ReplyStyle, line: str, read: ReadVolts
) -> bytes:
    """Carry out one command line; return the bytes of the reply without the echo."""
    prompted = registers.compatibility and style.prompt  # the mode when the command arrived
    try:
        reply = _carry_out(registers, style, line.strip(), read)
    except _BadArgument:
        reply = style.bad_argument(registers.range_error)
    if prompted:
        reply = reply.removesuffix(style.prompt) + registers.compatibility_prompt
    return reply


def _carry_out(s: Mdt693bRegisters, style: ReplyStyle, text: str, read: ReadVolts) -> bytes:
    if s.compatibility:
        reply = _compatible(s, style, text, read)
        if reply is not None:
            return reply
        if s.compatibility_only and not text.lower().startswith("cm"):
            return style.not_defined()
    name, equals, argument = text.partition("=")
    key = name.strip().lower()
    if equals:
        return _set(s, style, key, argument.strip())
    return _ask(s, style, key, read)


def _ask(s: Mdt693bRegisters, style: ReplyStyle, key: str, read: ReadVolts) -> bytes:
    if key == "restore":
        s.restore()
        return style.restored
    if key in QUERIES:
        return QUERIES[key](s, style)
    if key == "xyzvoltage?" and style.knows_xyz and len(s.axes) == 3:
        return style.line("[" + ",".join(style.volts(read(a)) for a in s.axes) + "]")
    axis, what = key[:1], key[1:]
    if axis and axis in s.axes:
        if what == "voltage?":
            return style.line(f"[{style.volts(read(axis))}]")
        if what == "min?":
            return style.bare(style.limit(s.min_v[axis]))
        if what == "max?":
            return style.bare(style.limit(s.max_v[axis]))
    return style.not_defined()


def _set(s: Mdt693bRegisters, style: ReplyStyle, key: str, argument: str) -> bytes:
    if key == "echo":
        s.echo = bool(_whole(argument, 1))
        return QUERIES["echo?"](s, style)
    if key in SETTERS:
        SETTERS[key](s, argument)
        return style.ok()
    if key == "allvoltage":
        _set_outputs(s, dict.fromkeys(s.axes, _volts(argument)))
        return style.ok()
    if key == "xyzvoltage" and style.knows_xyz and len(s.axes) == 3:
        parts = argument.split(",")
        if len(parts) != 3:
            raise _BadArgument
        _set_outputs(s, dict(zip(s.axes, map(_volts, parts), strict=True)))
        return style.ok()
    axis, what = key[:1], key[1:]
    if axis and axis in s.axes and what in ("voltage", "min", "max"):
        volts = _volts(argument)
        if what == "voltage":
            _set_outputs(s, {axis: volts})
        elif not 0.0 <= volts <= s.limit_v + 0.5:
            raise _BadArgument
        else:
            (s.min_v if what == "min" else s.max_v)[axis] = volts
        return style.ok()
    return style.not_defined()


def _compatible(s: Mdt693bRegisters, style: ReplyStyle, text: str, read: ReadVolts) -> bytes | None:
    """Handle the MDT693A commands (XV10, AV10, XR?, XL?, XH?, %, E, I); return None for other
    lines.

    Two independent MDT693A clients send AV and I.
    """
    upper = text.upper()
    if upper == "%":
        return style.line(f"[ {s.limit_v}]", trailer=True)
    if upper == "E":
        s.echo = not s.echo
        return style.ok()
    if upper == "I":
        return _identity(s, style)
    if together := re.fullmatch(r"AV(-?\d+(?:\.\d*)?)", upper):
        return _set(s, style, "allvoltage", together[1])
    match = re.fullmatch(r"([XYZ])(?:([RLH])\?|([VLH])(-?\d+(?:\.\d*)?))", upper)
    if match is None or match.group(1).lower() not in s.axes:
        return None
    axis, ask, what, value = match.group(1).lower(), *match.groups()[1:]
    if ask == "R":
        return style.line(f"[{style.volts(read(axis))}]")
    if ask:
        limit = s.min_v[axis] if ask == "L" else s.max_v[axis]
        return style.line(f"[{style.volts(limit)}]")
    return _set(s, style, axis + {"V": "voltage", "L": "min", "H": "max"}[what], value)


def _set_outputs(s: Mdt693bRegisters, volts: dict[str, float]) -> None:
    for axis, value in volts.items():
        s.check_v(axis, value)
    s.set_v = s.set_v | volts


def _volts(argument: str) -> float:
    if not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)", argument):
        raise _BadArgument
    return float(argument)


def _whole(argument: str, highest: int) -> int:
    if not argument.isdecimal() or int(argument) > highest:
        raise _BadArgument
    return int(argument)


def _set_scan_voltage(s: Mdt693bRegisters, argument: str) -> None:
    volts = _volts(argument)
    if not 0.0 <= volts <= s.limit_v:
        raise _BadArgument
    s.scan_v = volts


def _set_system_limit(s: Mdt693bRegisters, name: str, argument: str) -> None:
    volts = _volts(argument)
    if not 0.0 <= volts <= s.limit_v + 0.5:
        raise _BadArgument
    setattr(s, name, volts)


def _identity(s: Mdt693bRegisters, style: ReplyStyle) -> bytes:
    model = "MDT693B" if len(s.axes) == 3 else "MDT694B"
    lines = [
        f"\r\r\rModel {model} Piezo Control Module",
        f"Firmware Version: {style.firmware}",
        f"Voltage Range: 0V to {s.limit_v}V",
        f"Serial#:{s.serial_number}",
        f"Friendly Name:{s.friendly_name}",
        "Thorlabs, Inc. Newton, NJ 07860",
        "www.thorlabs.com\r",
    ]
    return style.line("\r".join(lines))


def _whole_number(s: Mdt693bRegisters, style: ReplyStyle, value: int) -> bytes:
    return style.line(str(value) if s.bare_numbers else f"[{value}]")


QUERIES: dict[str, Callable[[Mdt693bRegisters, ReplyStyle], bytes]] = {
    "?": lambda s, style: style.line(HELP.replace("\n", "\r")),
    "id?": _identity,
    "serial?": lambda s, style: style.line(s.serial_number, star=False, trailer=True),
    "friendly?": lambda s, style: style.line(s.friendly_name),
    "echo?": lambda s, style: style.line(f"[Echo {'On' if s.echo else 'Off'}]"),
    "vlimit?": lambda s, style: style.line(f"[ {s.limit_v}]", trailer=True),
    "intensity?": lambda s, style: _whole_number(s, style, s.intensity),
    "sysmin?": lambda s, style: style.bare(style.limit(s.sys_min_v)),
    "sysmax?": lambda s, style: style.bare(style.limit(s.sys_max_v)),
    "msenable?": lambda s, style: _whole_number(s, style, int(s.scan_on)),
    "msvoltage?": lambda s, style: style.line(f"[{style.volts(s.scan_v)}]"),
    "dacstep?": lambda s, style: _whole_number(s, style, s.dac_step),
    "cm?": lambda s, style: style.line(
        f"[MDT693A Compatibility Mode {'On' if s.compatibility else 'Off'}]", trailer=True
    ),
    "rotarymode?": lambda s, style: _whole_number(s, style, s.rotary_mode),
    "pushdisable?": lambda s, style: _whole_number(s, style, s.push_disable),
}

SETTERS: dict[str, Callable[[Mdt693bRegisters, str], None]] = {
    "friendly": lambda s, a: setattr(s, "friendly_name", a),
    "intensity": lambda s, a: setattr(s, "intensity", _whole(a, 15)),
    "sysmin": lambda s, a: _set_system_limit(s, "sys_min_v", a),
    "sysmax": lambda s, a: _set_system_limit(s, "sys_max_v", a),
    "msenable": lambda s, a: setattr(s, "scan_on", bool(_whole(a, 1))),
    "msvoltage": _set_scan_voltage,
    "dacstep": lambda s, a: setattr(s, "dac_step", _whole(a, 1000)),
    "cm": lambda s, a: setattr(s, "compatibility", bool(_whole(a, 1))),
    "rotarymode": lambda s, a: setattr(s, "rotary_mode", _whole(a, 2)),
    "pushdisable": lambda s, a: setattr(s, "push_disable", _whole(a, 1)),
}
