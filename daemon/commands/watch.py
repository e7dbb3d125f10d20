"""Live view of a running daemon."""

import argparse
import os
import sys
from contextlib import ExitStack
from datetime import datetime
from typing import TYPE_CHECKING

from dehyst.daemon.client.connection import add_connection, address_of, connect_axes, say
from dehyst.daemon.json_text import print_json, print_json_line
from dehyst.daemon.terminal.number_options import positive, within

if TYPE_CHECKING:
    from rich.console import Console

    from dehyst.daemon.client.client import Client
    from dehyst.daemon.terminal import view

EPILOG = """\
On a terminal it shows the position in large digits, plots of target, measured and error, state,
deadlines, devices and events; q or Ctrl-C quits. In a pipe, and on a terminal that cannot redraw
(TERM=dumb), it prints one line per second, and each event when it happens; with --json, one JSON
status per second. It shows all axes of a controller by their short names (x, y, ...). Watching
changes nothing and needs no lease.

examples: dehyst watch --for 10
          dehyst watch --list --connect tcp/127.0.0.1:7447     (list the controllers)
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst watch`."""
    parser.epilog = EPILOG
    parser.add_argument(
        "--for", dest="seconds", type=positive, metavar="S", help="stop after S seconds"
    )
    parser.add_argument(
        "--window",
        type=within(0.1, 3600.0),
        default=10.0,
        metavar="S",
        help="length of the plots (default: 10)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON status per second")
    parser.add_argument(
        "--list", action="store_true", help="list the controllers, one per line, and exit"
    )
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Watch until --for, q or Ctrl-C."""
    if args.list:
        return list_all(args)
    from rich.live import Live

    from dehyst.daemon import clock
    from dehyst.daemon.terminal import view
    from dehyst.daemon.terminal.keys import pressed, single_keys
    from dehyst.daemon.terminal.stdout_console import StdoutConsole

    with connect_axes(args, "watch") as stage, ExitStack() as held:
        watched = {axis: Watched(client, args.window) for axis, client in stage.clients.items()}
        begun_ns = shown_ns = clock.monotonic_ns()
        console = StdoutConsole()
        live = None
        if draws_screens(console) and not args.json:
            for axis in watched.values():
                axis.feed.events.extend(axis.client.events())
            live = Live(console=console, screen=True, auto_refresh=False)
            held.enter_context(single_keys())
            live.start()
        try:
            while args.seconds is None or clock.monotonic_ns() - begun_ns < args.seconds * clock.NS:
                for axis in watched.values():
                    axis.read(0.1 / len(watched))
                now_ns = clock.monotonic_ns()
                if live is not None and "q" in pressed().lower():
                    return 0
                if now_ns - shown_ns < (clock.NS // 4 if live else clock.NS):
                    continue
                shown_ns = now_ns
                if live is not None:
                    size = console.size.width, console.size.height
                    views = [axis.view() for axis in watched.values()]
                    live.update(view.screens(views, size), refresh=True)
                elif args.json:
                    said = {name: axis.feed.status for name, axis in watched.items()}
                    print_json_line(said if len(said) > 1 else next(iter(said.values())))
                else:
                    for name, axis in watched.items():
                        axis.print_lines(f"{name} " if len(watched) > 1 else "")
                sys.stdout.flush()
        except KeyboardInterrupt:
            return 0
        finally:
            if live is not None:
                live.stop()
    return 0


def draws_screens(console: "Console") -> bool:
    """Return whether the output is a terminal that can redraw its screen: TERM says so, except on
    Windows, where it is not set."""
    known = os.name == "nt" or bool(os.environ.get("TERM"))
    return console.is_terminal and known and not console.is_dumb_terminal


class Watched:
    """One axis being watched. seconds: length of its plots."""

    def __init__(self, client: "Client", seconds: float) -> None:
        from dehyst.daemon.terminal import view

        self.client, self.feed, self.stream = client, client.feed(), client.stream()
        self.feed.status = status = client.status()
        self.seconds, self.period_ns = seconds, status.period_ns
        self.window = view.RecentTelemetry(seconds, status.period_ns)

    def read(self, timeout_s: float) -> None:
        """Take new telemetry; if the loop has restarted at another rate, begin a new window."""
        from dehyst.daemon.terminal import view

        status = self.feed.status
        if status is not None and status.period_ns not in (0, self.period_ns):
            self.period_ns = status.period_ns
            self.window = view.RecentTelemetry(self.seconds, self.period_ns)
        self.window.add(self.stream.read(timeout_s))

    def view(self) -> "view.AxisScreen":
        """Return what the screen shows about the axis."""
        from dehyst.daemon.terminal import view

        feed = self.feed
        return view.AxisScreen(
            feed.status, self.window, self.stream.lost, feed.events, feed.rejections
        )

    def print_lines(self, head: str) -> None:
        """Print the new events and one line with the present state."""
        from dehyst.daemon.printable import printable
        from dehyst.daemon.terminal import view

        while self.feed.events:
            event = self.feed.events.popleft()
            when = datetime.fromtimestamp(event.wall_ns * 1e-9)
            print(printable(f"{head}event    {when:%H:%M:%S} {event.code}: {event.text}"))
        print(head + view.line(self.feed.status, self.window, self.stream.lost))


def list_all(args: argparse.Namespace) -> int:
    """List the controllers that answer, directly or via a router; return 1 if there are none."""
    from dehyst.daemon.bus import encoding
    from dehyst.daemon.bus.keys import Keys
    from dehyst.daemon.bus.messages import Status
    from dehyst.daemon.bus.security import client_settings
    from dehyst.daemon.bus.session import Bus, BusError
    from dehyst.daemon.client.finding import daemons
    from dehyst.daemon.printable import printable
    from dehyst.daemon.rings.status import is_starting, rate

    where, credentials = address_of(args)
    with Bus.connect([where], security=client_settings(credentials)) as bus:
        names = daemons(bus, args.base)
        found: dict[str, Status | None] = {}
        for name in names:
            try:
                answer = next(bus.ask(Keys(args.base, name).rpc("status"), timeout_s=1.0))
                found[name] = encoding.decode(Status, answer)
            except (BusError, encoding.BadMessage):
                found[name] = None  # it has just ended, or these credentials may not query it
    if args.json:
        print_json(found)
        return 0 if names else 1
    for name, status in found.items():
        if status is None:
            print(f"{name:20s} does not answer")
            continue
        if is_starting(status):
            print(f"{name:20s} starting")
            continue
        state = status.state if status.core_alive else "no loop"
        lost = status.gateway.samples_lost
        row = (
            f"{name:20s} {state:9s} {rate(status)}  reach {status.reach_min:.4g} "
            f"to {status.reach_max:.4g} {status.unit}  missed {status.missed}  lost {lost}  "
            f"commanded by {status.gateway.lease_label or 'nobody'}"
        )
        print(printable(row))
    if not names:
        say(f"no controller with keys below {args.base}/ answers at {where}")
    return 0 if names else 1
