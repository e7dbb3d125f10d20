"""The live view of a daemon on a terminal: plot, state, deadlines, volts, events."""

from collections import deque
from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from dehyst.daemon.bus.messages import Event, Rejection, Status
from dehyst.daemon.printable import printable
from dehyst.daemon.rings.records import TELEMETRY, Flag, Mode, State, name_of
from dehyst.daemon.rings.status import cells, counts, is_starting, place, positioning, rate
from dehyst.daemon.terminal.braille import Curve, Plot
from dehyst.daemon.terminal.readout import readout
from dehyst.models.signals.error_size import rms

POINTS = 4000  # of a curve: several per dot of a terminal
EVENT_LINES = 6  # at most: the plots need the height
COLUMNS = 3  # of numbers, in 100 characters
ROOMY = 100, 32
"""Columns and rows from which all numbers are shown; a smaller terminal gives more to the plots."""
STARTING = (
    "starting: kernels are compiled and devices opened; set-points are accepted once it is ready"
)
STATES = {"running": "green", "ready": "cyan", "holding": "yellow", "fault": "bold red"}


class RecentTelemetry:
    """The newest `seconds` of telemetry, thinned to fewer than 2 * POINTS samples."""

    def __init__(self, seconds: float, period_ns: int) -> None:
        self.seconds = seconds
        self.keep = max(2, round(seconds * 1e9 / period_ns)) if period_ns > 0 else 2
        self._parts: deque[NDArray[Any]] = deque()
        self._size = 0
        self.flags = 0  # all flags since the last `take_flags`

    def add(self, samples: NDArray[Any]) -> None:
        """Add (n,) TELEMETRY records."""
        if not samples.size:
            return
        self.flags |= int(np.bitwise_or.reduce(samples["flags"]))
        self._parts.append(samples)
        self._size += samples.size
        while self._parts and self._size - self._parts[0].size >= self.keep:
            self._size -= self._parts.popleft().size

    def take_flags(self) -> int:
        """Return the flags seen since the last call."""
        flags, self.flags = self.flags, 0
        return flags

    def samples(self) -> NDArray[Any]:
        """Return (n,) samples of the window, every k-th of them if there are more than POINTS."""
        if not self._parts:
            return np.zeros(0, TELEMETRY)
        joined = np.concatenate(list(self._parts))[-self.keep :]
        return joined[:: max(1, -(-joined.size // POINTS))]

    def newest(self) -> Any:
        """Return the newest record, or None."""
        return self._parts[-1][-1] if self._parts else None

    def place(self) -> float:
        """Return the mean reading of the newest batch; NaN if its last reading is not valid."""
        if not self._parts or not np.isfinite(self._parts[-1]["measured"][-1]):
            return float("nan")
        return float(np.nanmean(self._parts[-1]["measured"]))

    def error_rms(self) -> float:
        """Return the rms of measured minus target over the window; NaN without targets."""
        samples = self.samples()
        error = samples["measured"] - samples["target"]
        return rms(error[np.isfinite(error)])


def flag_names(flags: int) -> str:
    """Return the names of the flags, separated by commas."""
    return ", ".join((f.name or "").lower().replace("_", " ") for f in Flag if flags & f)


def line(status: Status | None, window: RecentTelemetry, lost: int) -> str:
    """Return the line that is printed once a second into a pipe."""
    newest = window.newest()
    if status is not None and is_starting(status):
        return STARTING
    if newest is None or status is None:
        return "waiting for telemetry"
    unit, flags = status.unit, flag_names(window.take_flags())
    return (
        f"{State(int(newest['state'])).name.lower():8s} seq {newest['seq']:d}  "
        f"{place(newest['measured'], newest['target'], newest['volts'], printable(unit))}  "
        f"rms error {_figure(window.error_rms(), unit)}  missed {status.missed}  "
        f"lost {lost}  {printable(positioning(status))}" + (f"  [{flags}]" if flags else "")
    )


def _figure(value: float, unit: str) -> str:
    return f"{value:.4g} {printable(unit)}" if np.isfinite(value) else "-"


def screen(
    status: Status | None,
    window: RecentTelemetry,
    lost: int,
    events: deque[Event],
    rejections: deque[Rejection],
    size: tuple[int, int],
) -> Layout:
    """Return the whole view of one axis. size: columns and rows of the terminal; a small one uses
    most of its rows for the plots."""
    small = size[0] < ROOMY[0] or size[1] < ROOMY[1]
    said = _newest(status, events, rejections)
    head: RenderableType
    if small:
        head = _short_head(status, window, lost)
        foot: RenderableType = said[-1] if said else Text("no events yet", style="dim")
    else:
        head = _head(status, window, lost)
        while len(said) > 1 and _rows(Group(*said), size[0] - 4) > EVENT_LINES:
            del said[0]
        foot = Panel(Group(*(said or [Text("none yet", style="dim")])), title="events")
    layout = Layout()
    layout.split_column(
        Layout(head, size=_rows(head, size[0])),
        Layout(_plots(status, window), name="plots"),
        Layout(foot, size=_rows(foot, size[0])),
    )
    return layout


def _rows(shown: RenderableType, width: int) -> int:
    """Return the rows that this takes at the given width, with long lines wrapped."""
    return len(Console(width=width).render_lines(shown))


class AxisScreen(NamedTuple):
    """The arguments of `screen` for one axis, without the size."""

    status: Status | None
    window: RecentTelemetry
    lost: int
    events: deque[Event]
    rejections: deque[Rejection]


def screens(views: Sequence[AxisScreen], size: tuple[int, int]) -> Layout:
    """Return the whole view of several axes, one above the other; for one axis, as `screen`."""
    if len(views) == 1:
        return screen(*views[0], size)
    layout = Layout()
    each = size[0], min(size[1] // len(views), ROOMY[1] - 1)
    layout.split_column(*(Layout(screen(*view, each)) for view in views))
    return layout


def _plots(status: Status | None, window: RecentTelemetry) -> Layout:
    layout = Layout()
    samples = window.samples()
    unit = status.unit if status else "um"
    if not samples.size:
        starts = status is not None and is_starting(status)
        layout.update(Panel(STARTING if starts else "waiting for telemetry"))
        return layout
    t_s = (samples["scheduled_ns"] - samples["scheduled_ns"][-1]) / 1e9
    target, measured = samples["target"], samples["measured"]
    both = [Curve("target", target, "blue"), Curve("measured", measured, "red")]
    error = [Curve("error", measured - target, "magenta")]
    layout.split_column(
        Layout(Plot(t_s, both, unit), ratio=2), Layout(Plot(t_s, error, unit), ratio=1)
    )
    return layout


def _state(status: Status, newest: Any) -> tuple[Text, str]:
    """Return the loop's state, coloured, and the mode of the inverse."""
    state = State(int(newest["state"])).name.lower() if newest is not None else status.state
    mode = status.mode if newest is None else name_of(Mode, int(newest["mode"]))
    words = printable(state) if status.core_alive else "no loop"
    words = "starting" if is_starting(status) else words
    return Text(words, style=STATES.get(state, "white")), mode


def _short_head(status: Status | None, window: RecentTelemetry, lost: int) -> Group:
    """Return the most important numbers, in as few lines as possible."""
    if status is None:
        return Group(Text("waiting for the daemon's status"))
    newest, s, unit = window.newest(), status, status.unit
    state, mode = _state(status, newest)
    flags = flag_names(window.take_flags())
    device = "".join(
        f"  {name} FAILED" for name in ("actuator", "sensor") if not getattr(s, f"{name}_ok")
    )
    volts = s.volts if newest is None else newest["volts"]
    lines = [
        Text.assemble(
            f"{printable(s.name)}: ", state, f" ({printable(mode)})  ", (flags, "yellow")
        ),
        Text(
            f"{place(window.place(), _of(newest, 'target'), volts, unit)}  rms error "
            f"{_figure(window.error_rms(), unit)} over {window.seconds:g} s",
            style="bold",
        ),
        Text(printable(positioning(s))),
        Text.assemble(
            f"{rate(s)}  missed {s.missed} of {s.samples}  lost here {lost}  by "
            f"{printable(s.gateway.lease_label) or 'nobody'}",
            (device, "bold red"),
        ),
    ]
    return Group(*lines)


def _of(newest: Any, name: str) -> float:
    return float("nan") if newest is None else float(newest[name])


def _head(status: Status | None, window: RecentTelemetry, lost: int) -> Panel:
    """Return a panel with all numbers."""
    if status is None:
        return Panel("waiting for the daemon's status")
    newest, unit, gateway = window.newest(), status.unit, status.gateway
    shown, mode = _state(status, newest)
    texts: list[Text | str] = [
        Text.assemble("state ", shown, f"  ({mode})"),
        f"rms error {_figure(window.error_rms(), unit)} over {window.seconds:g} s",
        f"telemetry lost here {lost}",
        f"commanded by {gateway.lease_label or 'nobody'}",
        f"refused: {counts(gateway.rejected)}",
        *cells(status),
    ]
    table = Table.grid(padding=(0, 3))
    for _ in range(COLUMNS):
        table.add_column()
    for first in range(0, len(texts), COLUMNS):
        row = texts[first : first + COLUMNS]
        table.add_row(*(printable(t) if isinstance(t, str) else t for t in row))
    flags = flag_names(window.take_flags())
    volts = status.volts if newest is None else float(newest["volts"])
    figures = readout(window.place(), _of(newest, "target"), volts, printable(unit))
    return Panel(
        Group(figures, table, Text(flags, style="yellow")),
        title=f"dehyst {printable(status.name)}",
        subtitle="q quits",
    )


def _newest(
    status: Status | None, events: deque[Event], rejections: deque[Rejection]
) -> list[Text]:
    """Return the newest events and refusals with their times, oldest first."""
    # a refusal has only the controller's monotonic time; the status has both clocks
    wall_ns = 0 if status is None else status.wall_ns - status.time_ns
    lines = [(e.wall_ns, f"{e.code}: {e.text}", "red" if e.level > 1 else "") for e in events]
    lines += [(r.time_ns + wall_ns, f"refused {r.count} x: {r.text}", "yellow") for r in rejections]
    return [
        Text(f"{datetime.fromtimestamp(when * 1e-9):%H:%M:%S} {printable(text)}", style=style)
        for when, text, style in sorted(lines)[-EVENT_LINES:]
    ]
