"""The command line: `dehyst COMMAND ...`, with one module of dehyst.daemon.commands per command."""

import argparse
import importlib
import io
import os
import signal
import sys
import warnings
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any, NoReturn

# before numpy is imported: on matrices as small as ours, BLAS threads cost fifty times their gain
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from dehyst import __version__
from dehyst.daemon import kernel_cache, log_lines
from dehyst.daemon.interrupts import INTERRUPTED, LightEnd, ended_at_once
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.option_words import at_command_line
from dehyst.daemon.printable import one_line
from dehyst.daemon.terminal.parser import Parser
from dehyst.drivers import system
from dehyst.models.errors import BadInput, DehystError, NotNow

# name: help line. Modules are imported only when they are used: numba and zenoh load slowly.
COMMANDS = {
    "run": "run the daemon in the foreground (without --config: on a simulated stage)",
    "demo": "demonstrate everything on a simulated stage in a few minutes",
    "setup": "guided set-up, from two plugged-in units to a validated model",
    "acquire": "play a drive in volts in open loop and record the stage's response",
    "identify": "identify a model from a recording",
    "excite": "design a drive for identification, or check a recording's excitation",
    "simulate": "simulate a model on a recording's drive",
    "validate": "check how well models predict recordings not used to identify them",
    "convert": "convert a recording to another file format: .csv, .csv.gz, .npz, .mcap",
    "invert": "turn a trajectory in micrometres into a drive in volts",
    "diagnose": "name the physics that a model lacks, and add it to the model",
    "paper": "repeat the source paper's experiments, errors and figures next to the paper's",
    "bench": "compare kinds of hysteresis model on the same recordings",
    "image": "image a grid with a simulated microscope: raw, compensated, learned",
    "scan": "write a two-axis scan path: raster, spiral or Lissajous figure",
    "send": "send a set-point to a running daemon, or stop or hold the stage",
    "play": "stream a trajectory to a running daemon",
    "status": "show where the stage is, and whether the daemon needs attention (exit status 1)",
    "watch": "live view of a running daemon",
    "zero": "compare gauge and model, and set the gauge's zero",
    "doctor": "show what the doctor found about mismatches between stage and model",
    "accept": "use the model that the doctor offers, on trial",
    "reject": "reject the model that the doctor offers, or return to the previous one",
    "page": "serve a web page for one or more controllers",
    "epics": "serve a controller as EPICS process variables",
    "serve": "serve a controller to programs that use another controller's protocol (PI's GCS)",
    "record": "record a running daemon's telemetry into a file",
    "config": "write a commented configuration",
    "drivers": "list the driver plugins, with the error of each broken one",
    "latency": "test whether this machine meets the loop's deadlines",
    "probe": "record a unit's raw bytes and timings into a fixture file",
    "emulate": "emulate an amplifier and gauge readers on pseudo terminals, with a simulated stage",
    "warm": "compile all kernels now, so that the next start is quick",
    "completion": "print a script for tab completion",
    "keys": "make certificates for a controller and its clients",
    "core": "run only the real-time process (for systemd)",
    "gateway": "run only the network process (for systemd)",
    "safe": "bring the output to its configured safe state (for systemd)",
}


COMPILING = {
    *("demo", "setup", "acquire", "identify", "excite", "simulate", "validate", "invert"),
    *("diagnose", "latency", "scan", "paper", "image", "bench"),
}
"""Commands that may have to compile kernels first and report it on a terminal. PROCESSES, the
daemon's own, report it in a pipe as well."""
PROCESSES = {"core", "gateway", "emulate"}


LASTING = {"run", "core", "gateway", "doctor", "page", "safe", "emulate"}
SHORT = {"--check", "-h", "--help"}


def _lasts(command: str | None, arguments: list[str]) -> bool:
    """Return True for a process of the daemon: neither its log nor an early SIGHUP may end it."""
    if command not in LASTING or SHORT & set(arguments):
        return False
    if command == "doctor":  # without a configuration it only prints the findings
        return any(a.split("=")[0] == "--config" for a in arguments)
    return command != "emulate" or "DEHYST_SUPERVISED" in os.environ


NEEDS_LINUX = {
    *("run", "demo", "setup", "acquire", "latency", "probe", "emulate"),
    *("core", "gateway", "safe"),
}
"""Commands that open devices or keep deadlines; the rest also runs on Windows and macOS."""


def _check_system(command: str | None, arguments: list[str]) -> None:
    devices = command in NEEDS_LINUX or (command == "config" and "pin" in arguments)
    if system.LINUX or {"-h", "--help"} & set(arguments):
        return
    if devices or (command == "doctor" and _lasts(command, arguments)):
        raise BadInput(
            "needs Linux, for the loop's deadlines and the devices' ports; this system runs only "
            "the commands for recordings and models (identify, diagnose, invert, ...) and the "
            "clients of a daemon on another machine (send, play, watch, record, page, ...)"
        )


def build_parser(*commands: str | None) -> Parser:
    """Return the parser; only the arguments of these commands are added, if this system can run
    them."""
    parser = Parser(
        prog="dehyst",
        description="Hysteresis compensation service for piezo stages.",
        epilog="example: dehyst identify recording.csv -o model.toml",
    )
    parser.add_argument("--version", action="version", version=f"dehyst {__version__}")
    sub = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    parser.commands = {}
    for name, text in COMMANDS.items():
        child = parser.commands[name] = sub.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + ".",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name in commands and (system.LINUX or name not in NEEDS_LINUX):
            module = importlib.import_module(f"dehyst.daemon.commands.{name}")
            module.configure(child)
            child.set_defaults(run=module.run)
            if name == "completion":  # it needs the arguments of all commands
                child.set_defaults(build_whole=build_whole_parser)
    return parser


def build_whole_parser() -> Parser:
    """Return the parser with the arguments of all commands."""
    return build_parser(*COMMANDS)


def _in_hertz(command: str | None, arguments: list[str]) -> list[str]:
    """Turn `identify --rate 1000`, a rate of samples, into --rate-hz, to distinguish it from
    `--rate`, which asks for a rate-dependent model."""
    out = list(arguments)
    for i, word in enumerate(out):
        after = out[i + 1] if i + 1 < len(out) else ""
        if command == "identify" and word == "--rate" and _is_number(after):
            out[i] = "--rate-hz"
        elif command == "identify" and word.startswith("--rate="):
            out[i] = word.replace("--rate=", "--rate-hz=", 1)
    return out


ALIASES = {"identify": (("--rate", "--rate-hz"),)}
"""Options of a command that mean the same, although they are not two names of one for argparse."""


def _is_number(text: str) -> bool:
    with suppress(ValueError):
        float(text)
        return not Path(text).exists()
    return False


def _reporting_compilation(command: str | None, said_by: str) -> AbstractContextManager[None]:
    if command not in COMPILING | PROCESSES:
        return nullcontext()
    # both import numba, which these commands need anyway
    from dehyst.daemon.kernel_cache import load_lightly
    from dehyst.daemon.terminal.compiling import compiling_reported

    load_lightly()
    process = command in PROCESSES
    return compiling_reported(said_by, in_pipes=process, ends=not process)


def open_closed_streams() -> bool:
    """Open a standard stream that the caller has closed (`>&-`) as the null device, so that no file
    takes its number; return whether stdout was closed."""
    no_stdout = sys.stdout is None
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115
    return no_stdout


STDOUT = "stdout"


class _NamedStdout(io.FileIO):
    """Descriptor 1, which names itself in the error where it cannot be written, as files do."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            error.filename = STDOUT
            raise


def name_stdout() -> None:
    """Make an error of stdout, such as a full disk, name stdout; otherwise it would look like the
    error of a file that the command writes."""
    before = sys.stdout
    if isinstance(before, io.TextIOWrapper) and before.fileno() == 1:
        before.flush()
        sys.stdout = io.TextIOWrapper(
            io.BufferedWriter(_NamedStdout(1, "w", closefd=False)),
            encoding=before.encoding,
            errors=before.errors,
            line_buffering=before.line_buffering,
            write_through=before.write_through,
        )


def _complain(text: str) -> None:
    """Print an error on stderr; where even that cannot be written, the exit status remains."""
    with suppress(OSError):
        print(text, file=sys.stderr)


def main(argv: list[str] | None = None, no_stdout: bool = False) -> int:
    """Run one command. Return 0 on success, 1 for a finding or if it is not possible now, 2 for
    bad usage or input, which is reported in one line on stderr. no_stdout: stdout is closed."""
    arguments = sys.argv[1:] if argv is None else argv
    command = next((a for a in arguments if a in COMMANDS), None)
    said_by = f"dehyst {command}" if command else "dehyst"
    parser: Parser | None = None
    if system.LINUX and command and argv is None and _lasts(command, arguments):
        # ignore SIGHUP until a process that reloads installs its handler; others do not reload
        signal.signal(signal.SIGHUP, lambda *_: None)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGHUP})
        realtime.take_place(command)
        log_lines.keep_going(command)
    try:
        _check_system(command, arguments)
        for complaint in kernel_cache.protect():
            print(f"dehyst: {complaint}", file=sys.stderr)
        with ended_at_once(said_by):
            kernel_cache.drop_stale()
            whole = build_parser(command)
            parser = whole.commands[command] if command else whole
            parser.typed, parser.aliases = arguments, ALIASES.get(command or "", ())
            args = whole.parse_args(_in_hertz(command, arguments))
            reporting = _reporting_compilation(command, said_by)
        if no_stdout and getattr(args, "json", False):
            raise BadInput("--json: stdout is closed; leave it open, or leave out --json")
        with reporting, at_command_line():
            code = int(args.run(args) or 0)
        sys.stdout.flush()  # the interpreter would silently lose what cannot be written
        return code
    except DehystError as error:
        said = parser.as_typed(str(error)) if parser else str(error)
        _complain(f"{said_by}: {one_line(said)}")
        return 1 if isinstance(error, NotNow) else 2
    except BrokenPipeError:  # the reader of our output has gone, e.g. `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, a folder that is not there, a name that is too long
        if error.errno is None:
            raise
        if error.filename == STDOUT:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what is still in its buffer
            _complain(f"{said_by}: {STDOUT}: {error.strerror}")
            return 1
        where = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        _complain(f"{said_by}: {one_line(where)}")
        return 2
    except (KeyboardInterrupt, SystemError) as error:
        # in a callback from compiled code, the interrupt is the cause of a SystemError
        if not isinstance(error.__cause__ or error, KeyboardInterrupt):
            raise
        _complain(f"{said_by}: interrupted")
        return INTERRUPTED


def run_process() -> NoReturn:
    """Run `main` as a separate process. Library warnings are not shown to the user; characters that
    the screen's encoding lacks are shown escaped."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    no_stdout = open_closed_streams()
    if not no_stdout:
        name_stdout()
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # of an encoding such as ASCII
    end = LightEnd()
    try:
        end.code = main(no_stdout=no_stdout)
    except SystemExit as ended:
        if isinstance(ended.code, int):
            end.code = ended.code
        raise
    sys.exit(end.code)


if __name__ == "__main__":
    run_process()
