"""What the MDT693B driver learns from a unit before driving it, using only queries: no output
moves."""

import re
from dataclasses import dataclass

from dehyst.drivers.interface import DriverConfigError, ForeignUnit
from dehyst.drivers.mdt693b.link import CommandRefused, Mdt693bLink

NATIVE = {"set": "{axis}voltage={volts:.3f}", "read": "{axis}voltage?", "limit": "vlimit?"}
NATIVE |= {"min": "{axis}min?", "max": "{axis}max?"}
COMPATIBLE = {"set": "{axis}V{volts:.3f}", "read": "{axis}R?", "limit": "%"}
COMPATIBLE |= {"min": "{axis}L?", "max": "{axis}H?"}
"""The same commands in the MDT693A's syntax, for a unit in its compatibility mode."""


@dataclass(frozen=True)
class UnitFacts:
    """Facts about a unit. words: command templates that it understands; minimum_v, maximum_v: what
    may be written to the axis; identity: for the log."""

    words: dict[str, str]
    minimum_v: float
    maximum_v: float
    serial_number: str
    kind: str
    identity: str


def learn(link: Mdt693bLink, axis: str, max_v: float | None) -> UnitFacts:
    """Query a unit's identity and limits and bring the link in step. max_v: the configured limit.

    Raises DriverConfigError when the axis does not exist, when no range is left, or when master
    scan adds a voltage to every set-point.
    """
    try:
        words, limit_v = NATIVE, float(link.ask(NATIVE["limit"]).value)
    except CommandRefused:
        words, limit_v = COMPATIBLE, float(link.ask(COMPATIBLE["limit"]).value)
    link.barrier = words["limit"]
    try:
        minimum_v = float(link.ask(words["min"].format(axis=axis)).value)
        axis_max_v = float(link.ask(words["max"].format(axis=axis)).value)
    except CommandRefused:
        raise DriverConfigError(
            f"setting axis: this unit has no axis {axis!r}; an MDT694B has only x"
        ) from None
    # The axis maximum is by default 0.5 V above the limit switch: the switch decides.
    maximum_v = min(limit_v, axis_max_v, limit_v if max_v is None else max_v)
    if not minimum_v < maximum_v:
        raise DriverConfigError(
            f"the unit allows axis {axis} only {minimum_v:g} to {maximum_v:g} V, which leaves "
            "nothing to drive; check its minimum and maximum and the setting max_v"
        )
    scan_v = _master_scan_v(link)
    if scan_v != 0.0:
        raise DriverConfigError(
            f"the unit's master scan adds {scan_v:g} V to every axis, so the output would differ "
            "from every set-point; switch it off on the unit (msenable=0)"
        )
    serial = _ask_if_known(link, "serial?") or ""
    lines = (_ask_if_known(link, "id?") or "MDT693B").split("\r")
    model = next((x.split()[1] for x in lines if x.startswith("Model ")), lines[0].strip())
    firmware = next((x.split()[-1] for x in lines if x.startswith("Firmware ")), "unknown")
    friendly = next((x[14:].strip() for x in lines if x.startswith("Friendly Name:")), "")
    dialect = link.dialect.framing.name
    identity = (
        f"{model} firmware {firmware} ({dialect} dialect) serial {serial or 'blank'} axis {axis}"
    )
    # The answers so far identify the unit; this exchange proves that no reply is outstanding.
    link.in_step = False
    link.get_in_step()
    kind = f"{model} firmware {firmware}" + (f" named {friendly}" if friendly else "")
    return UnitFacts(words, minimum_v, maximum_v, serial, kind, identity)


def check_model(path: str, kind: str, wanted: str) -> None:
    """Raise ForeignUnit if a model is configured and the unit reports another one."""
    if not kind.startswith(wanted):
        raise ForeignUnit(
            f"{path}: the unit is an {kind}, but the configuration asks for an {wanted}; use the "
            "driver mdt693b for it"
        )


def check_serial(path: str, serial: str, wanted: str | None) -> None:
    """Raise ForeignUnit unless the unit is the one in the configuration. None: any unit is
    accepted; "": a unit whose serial number is blank."""
    if wanted is not None and serial != wanted:
        raise ForeignUnit(
            f"{path}: the unit has serial number {serial!r}, but the configuration asks for "
            f"{wanted!r}"
        )


def _master_scan_v(link: Mdt693bLink) -> float:
    """Return the voltage that master scan adds, 0 if it is off or missing."""
    state = (_ask_if_known(link, "msenable?") or "").strip("[] ").lower()
    if not re.search(r"[1-9]|\b(on|enabled?)\b", state):
        return 0.0
    number = re.search(r"-?\d+(\.\d+)?", _ask_if_known(link, "msvoltage?") or "")
    return float(number.group()) if number else 0.0


def _ask_if_known(link: Mdt693bLink, command: str) -> str | None:
    try:
        return link.ask(command).value
    except CommandRefused:
        return None
