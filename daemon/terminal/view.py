"""The live view of a daemon on a terminal: plot, state, deadlines, volts, events."""

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from dehyst.daemon.bus.messages import Event, Rejection, Status
from dehyst.daemon.bus.printable import printable
from dehyst.daemon.rings.records import TELEMETRY, Flag, Mode, State, name_of
from dehyst.daemon.rings.status import cells, counts, positioning
from dehyst.daemon.terminal.braille import Curve, Plot

POINTS = 4000
EVENTS = 6
COLUMNS = 3
STATES = {"running": "green", "ready": "cyan", "holding": "yellow", "fault": "bold red"}


class RecentTelemetry:
    """The newest `seconds` of telemetry, thinned to at most POINTS samples."""

    def __init__(self, seconds: float, period_ns: int) -> None:
        self.seconds = seconds
        self.keep = max(2, round(seconds * 1e9 / period_ns))
        self._parts: deque[NDArray[Any]] = deque()
        self._size = 0
        self.flags = 0  # of everything since `take_flags`

    def add(self, samples: NDArray[Any]) -> None:
        """Take (n,) TELEMETRY records."""
        if not samples.size:
            return
        self.flags |= int(np.bitwise_or.reduce(samples["flags"]))
        self._parts.append(samples)
        self._size += samples.size
        while self._parts and self._size - self._parts[0].size >= self.keep:
            self._size -= self._parts.popleft().size

    def take_flags(self) -> int:
        """Flags seen since the last call."""
        flags, self.flags = self.flags, 0
        return flags

    def samples(self) -> NDArray[Any]:
        """(n,) the window, every k-th sample where there are more than POINTS."""
        if not self._parts:
            return np.zeros(0, TELEMETRY)
        joined = np.concatenate(list(self._parts))[-self.keep :]
        return joined[:: max(1, joined.size // POINTS)]

    def newest(self) -> Any:
        """The newest record, or None."""
        return self._parts[-1][-1] if self._parts else None

    def error_rms(self) -> float:
        """rms of measured minus target over the window; NaN without targets."""
        samples = self.samples()
        error = samples["measured"] - samples["target"]
        error = error[np.isfinite(error)]
        return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def flag_names(flags: int) -> str:
    """The flags in words."""
    return ", ".join((f.name or "").lower().replace("_", " ") for f in Flag if flags & f)


def line(status: Status | None, window: RecentTelemetry, lost: int) -> str:
    """One line a second, for a pipe."""
    newest = window.newest()
    if newest is None or status is None:
        return "waiting for telemetry"
    unit, flags = status.unit, flag_names(window.take_flags())
    return (
        f"{State(int(newest['state'])).name.lower():8s} seq {newest['seq']:d}  "
        f"target {_figure(newest['target'], unit)}  measured {_figure(newest['measured'], unit)}  "
        f"rms error {_figure(window.error_rms(), unit)}  {newest['volts']:.3f} V  "
        f"missed {status.missed}  lost {lost}  {printable(positioning(status))}"
        + (f"  [{flags}]" if flags else "")
    )


def _figure(value: float, unit: str) -> str:
    return f"{value:.4g} {printable(unit)}" if np.isfinite(value) else "-"


def screen(
    status: Status | None,
    window: RecentTelemetry,
    lost: int,
    events: deque[Event],
    rejections: deque[Rejection],
) -> Layout:
    """The whole view."""
    head, height = _head(status, window, lost)
    layout = Layout()
    layout.split_column(
        Layout(head, size=height), Layout(name="plots"), Layout(name="foot", size=8)
    )
    samples = window.samples()
    unit = status.unit if status else "um"
    if samples.size:
        t_s = (samples["scheduled_ns"] - samples["scheduled_ns"][-1]) / 1e9
        target, measured = samples["target"], samples["measured"]
        both = [Curve("target", target, "blue"), Curve("measured", measured, "red")]
        error = [Curve("error", measured - target, "magenta")]
        layout["plots"].split_column(
            Layout(Plot(t_s, both, unit), ratio=2), Layout(Plot(t_s, error, unit), ratio=1)
        )
    else:
        layout["plots"].update(Panel("waiting for telemetry"))
    layout["foot"].update(_foot(events, rejections))
    return layout


def _head(status: Status | None, window: RecentTelemetry, lost: int) -> tuple[Panel, int]:
    """The numbers, and how many lines they take."""
    if status is None:
        return Panel("waiting for the daemon's status"), 3
    newest = window.newest()
    state = State(int(newest["state"])).name.lower() if newest is not None else status.state
    unit, gateway = status.unit, status.gateway
    mode = status.mode if newest is None else name_of(Mode, int(newest["mode"]))
    shown = Text(
        printable(state) if status.core_alive else "no loop", style=STATES.get(state, "white")
    )
    texts: list[Text | str] = [
        Text.assemble("state ", shown, f"  ({mode})"),
        f"{status.volts:.3f} V" if newest is None else f"{newest['volts']:.3f} V",
        f"rms error {_figure(window.error_rms(), unit)} over {window.seconds:g} s",
        "target -" if newest is None else f"target {_figure(newest['target'], unit)}",
        "measured -" if newest is None else f"measured {_figure(newest['measured'], unit)}",
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
    panel = Panel(
        Group(table, Text(flags, style="yellow")), title=f"dehyst {printable(status.name)}"
    )
    return panel, table.row_count + 3


def _foot(events: deque[Event], rejections: deque[Rejection]) -> Panel:
    lines = [(e.time_ns, f"{e.code}: {e.text}", "red" if e.level > 1 else "") for e in events]
    lines += [(r.time_ns, f"refused {r.count} x: {r.text}", "yellow") for r in rejections]
    shown = sorted(lines)[-EVENTS:]
    return Panel(
        Group(*(Text(printable(text), style=style) for _, text, style in shown)), title="events"
    )
