"""The complete dialect, one row per command; any other command results in error 2."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dehyst.daemon.client.client import Refusal
from dehyst.daemon.client.readings import AxisView
from dehyst.daemon.gcs.controller import UNITS, GcsController, GcsSession
from dehyst.daemon.gcs.grammar import GcsCode, GcsCommand, GcsError, join_lines
from dehyst.daemon.gcs.waves import TABLES
from dehyst.models.errors import BadInput, DehystError

log = logging.getLogger(__name__)
REFUSED = {
    "lease-taken": GcsCode.NO_SERVO,
    "no-lease": GcsCode.NO_SERVO,
    "unreachable": GcsCode.OUT_OF_LIMITS,
}
"""GCS error codes for the daemon's refusals; all others are COMMUNICATION."""


def answer_command(controller: GcsController, session: GcsSession, command: GcsCommand) -> str:
    """Return the answer to one command, "" if there is none; an error is kept for `ERR?`."""
    word = command.word
    try:
        if word not in TABLE:
            code = GcsCode.UNKNOWN_COMMAND if word else GcsCode.COMMAND_TOO_LONG
            raise GcsError(code, "it is not spoken here" if word else "the line is too long")
        if word in STOPS:  # a stop never waits for another command
            return TABLE[word].do(controller, session, command.args)
        with controller.lock:
            return TABLE[word].do(controller, session, command.args)
    except GcsError as error:
        session.error, why = error.code, str(error)
    except Refusal as error:
        session.error, why = REFUSED.get(error.code, GcsCode.COMMUNICATION), str(error)
    except BadInput as error:
        session.error, why = GcsCode.OUT_OF_LIMITS, str(error)
    except DehystError as error:
        session.error, why = GcsCode.COMMUNICATION, str(error)
    if session.error != GcsCode.STOP:
        log.info("%s %s: %s", word, " ".join(command.args)[:60], why)
    return ""


def _help(controller: GcsController, session: GcsSession, args: Sequence[str]) -> str:
    rows = [f"{word} {entry.says}" for word, entry in TABLE.items()]
    return join_lines(["The following commands are valid:", *rows, "end of help"])


@dataclass(frozen=True)
class Entry:
    """One command. do: its function; says: its line in the answer to HLP?."""

    do: Callable[[GcsController, GcsSession, Sequence[str]], str]
    says: str


def _each(value: Callable[[GcsController, str, AxisView], str]) -> Callable[..., str]:
    def answer(controller: GcsController, session: GcsSession, args: Sequence[str]) -> str:
        return controller.each(args, lambda name, view: value(controller, name, view))

    return answer


def _generators(value: Callable[[GcsController, str], str]) -> Callable[..., str]:
    def answer(controller: GcsController, session: GcsSession, args: Sequence[str]) -> str:
        return controller.generators(args, lambda axis: value(controller, axis))

    return answer


def _constant(text: str) -> Callable[..., str]:
    return lambda controller, session, args: text


AXES = "[{<AxisID>}]"
GENERATORS = "[{<WaveGenID>}]"
TABLE: dict[str, Entry] = {
    "#4": Entry(GcsController.status_register, "- Request Status Register"),
    "#5": Entry(lambda c, s, a: c.mask(lambda v: v.moving), "- Request Motion Status"),
    "#7": Entry(_constant("\xb1\n"), "- Request Controller Ready Status"),
    "#9": Entry(lambda c, s, a: c.mask(lambda v: v.flying), "- Get Wave Generator Status"),
    "#24": Entry(GcsController.stop, "- Stop All Axes"),
    "*IDN?": Entry(GcsController.identify, "- Get Device Identification"),
    "IDN?": Entry(GcsController.identify, "- Get Device Identification"),
    "CSV?": Entry(_constant("2.0\n"), "- Get Current Syntax Version"),
    "VER?": Entry(lambda c, s, a: f"dehyst: {c.version}\n", "- Get Versions Of Firmware"),
    "ERR?": Entry(GcsController.last_error, "- Get Error Number"),
    "HLP?": Entry(_help, "- Get List of Available Commands"),
    "HPA?": Entry(GcsController.parameter_help, "- Get List Of Available Parameters"),
    "SAI?": Entry(
        lambda c, s, a: join_lines(c.names), "[ALL] - Get List Of Current Axis Identifiers"
    ),
    "CST?": Entry(_each(lambda c, n, v: "DEHYST"), f"{AXES} - Get Assignment Of Stages To Axes"),
    "PUN?": Entry(
        _each(lambda c, n, v: UNITS.get(v.unit, v.unit.upper())),
        f"{AXES} - Get Position Unit",
    ),
    "SPA?": Entry(
        GcsController.parameters, "[{<ItemID> <PamID>}] - Get Volatile Memory Parameters"
    ),
    "STA?": Entry(GcsController.status_register, "- Query Status Register Value"),
    "SVO": Entry(GcsController.set_servo, "{<AxisID> <ServoState>} - Set Servo Mode"),
    "SVO?": Entry(_each(lambda c, n, v: f"{int(c.is_held(n))}"), f"{AXES} - Get Servo Mode"),
    "MOV": Entry(GcsController.move, "{<AxisID> <Position>} - Set Target Position"),
    "MOV?": Entry(_each(lambda c, n, v: f"{c.asked(n):.6f}"), f"{AXES} - Get Target Position"),
    "MVR": Entry(GcsController.move_by, "{<AxisID> <Distance>} - Set Target Relative To Target"),
    "GOH": Entry(GcsController.go_home, f"{AXES} - Go To Home Position"),
    "HLT": Entry(GcsController.stop, f"{AXES} - Halt Motion Smoothly"),
    "STP": Entry(GcsController.stop, "- Stop All Axes"),
    "POS?": Entry(_each(lambda c, n, v: f"{v.place:.6f}"), f"{AXES} - Get Real Position"),
    "ONT?": Entry(_each(lambda c, n, v: f"{int(v.on_target)}"), f"{AXES} - Get On-Target State"),
    "TMN?": Entry(_each(lambda c, n, v: f"{v.low:.6f}"), f"{AXES} - Get Minimum Travel Range"),
    "TMX?": Entry(_each(lambda c, n, v: f"{v.high:.6f}"), f"{AXES} - Get Maximum Travel Range"),
    "FRF?": Entry(_each(lambda c, n, v: "1"), f"{AXES} - Get Referencing Result"),
    "OVF?": Entry(_each(lambda c, n, v: "0"), f"{AXES} - Get Overflow State"),
    "VOL?": Entry(_each(lambda c, n, v: f"{v.volts:.6f}"), f"{AXES} - Get Voltage Of Output"),
    "TWG?": Entry(lambda c, s, a: f"{len(c.names)}\n", "- Get Number Of Wave Generators"),
    "TWT?": Entry(_constant(f"{TABLES}\n"), "- Get Number Of Wave Tables"),
    "WAV": Entry(
        GcsController.write_wave,
        "<WaveTableID> <AppendWave> <WaveType> <WaveTypeParameters> - Set Waveform Definition",
    ),
    "WAV?": Entry(
        GcsController.wave_lengths, "[{<WaveTableID> <ParamID>}] - Get Waveform Definition"
    ),
    "GWD?": Entry(
        GcsController.wave_points, "<StartPoint> <Number> {<WaveTableID>} - Get Wave Table Data"
    ),
    "WCL": Entry(GcsController.clear_waves, "{<WaveTableID>} - Clear Wave Table Data"),
    "WSL": Entry(
        GcsController.select_wave, "{<WaveGenID> <WaveTableID>} - Set Connection Of Wave Table"
    ),
    "WSL?": Entry(
        _generators(lambda c, a: f"{c.waves.chosen.get(a, 0)}"),
        f"{GENERATORS} - Get Connection Of Wave Table",
    ),
    "WGC": Entry(GcsController.set_cycles, "{<WaveGenID> <Cycles>} - Set Number Of Cycles"),
    "WGC?": Entry(
        _generators(lambda c, a: f"{c.waves.cycles.get(a, 0)}"),
        f"{GENERATORS} - Get Number Of Cycles",
    ),
    "WOS": Entry(GcsController.set_offset, "{<WaveGenID> <Offset>} - Set Wave Generator Offset"),
    "WOS?": Entry(
        _generators(lambda c, a: f"{c.waves.offset.get(a, 0.0):.6f}"),
        f"{GENERATORS} - Get Wave Generator Offset",
    ),
    "WTR": Entry(
        GcsController.set_rate,
        "{<WaveGenID> <Rate> <Interpolation>} - Set Wave Generator Table Rate",
    ),
    "WTR?": Entry(
        _generators(lambda c, a: f"{c.waves.rate} 1"),
        f"{GENERATORS} - Get Wave Generator Table Rate",
    ),
    "WGO": Entry(
        GcsController.start_waves, "{<WaveGenID> <StartMode>} - Set Wave Generator Start/Stop Mode"
    ),
    "WGO?": Entry(
        _generators(lambda c, a: f"{int(c.view_of(a).flying)}"),
        f"{GENERATORS} - Get Wave Generator Start/Stop Mode",
    ),
}
STOPS = ("#24", "STP", "HLT")
