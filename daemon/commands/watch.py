"""Live view of a running daemon."""

import argparse
import sys
from datetime import datetime

from dehyst.daemon.client.connection import (
    add_connection,
    address_of,
    connect,
    print_json,
    print_json_line,
    say,
)

EPILOG = """On a terminal: target, measured and error as plots, state, deadlines, devices, events;
Ctrl-C leaves. In a pipe: one line a second, events as they come. --json: one JSON status a second.
Watching changes nothing and needs no lease.

examples: dehyst watch --for 10
          dehyst watch --list --connect tcp/127.0.0.1:7447     (which controllers are there)
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst watch`."""
    parser.epilog = EPILOG
    parser.add_argument("--for", dest="seconds", type=float, metavar="S", help="leave after S s")
    parser.add_argument(
        "--window", type=float, default=10.0, metavar="S", help="seconds in the plots (default: 10)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON status a second")
    parser.add_argument("--list", action="store_true", help="one line a controller, then leave")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Until --for or Ctrl-C."""
    if args.list:
        return list_all(args)
    from rich.console import Console
    from rich.live import Live

    from dehyst.daemon import clock
    from dehyst.daemon.bus.printable import printable
    from dehyst.daemon.terminal import view

    with connect(args, "watch") as client:
        feed, stream = client.feed(), client.stream()
        feed.status = client.status()
        window = view.RecentTelemetry(args.window, feed.status.period_ns)
        begun_ns = shown_ns = clock.monotonic_ns()
        console = Console()
        live = None
        if console.is_terminal and not args.json:
            feed.events.extend(client.events())
            live = Live(console=console, screen=True, auto_refresh=False)
            live.start()
        try:
            while args.seconds is None or clock.monotonic_ns() - begun_ns < args.seconds * clock.NS:
                window.add(stream.read(0.1))
                now_ns = clock.monotonic_ns()
                if now_ns - shown_ns < (clock.NS // 4 if live else clock.NS):
                    continue
                shown_ns = now_ns
                if live is not None:
                    size = console.size.width, console.size.height
                    told = feed.events, feed.rejections
                    live.update(
                        view.screen(feed.status, window, stream.lost, *told, size), refresh=True
                    )
                elif args.json:
                    print_json_line(feed.status)
                else:
                    while feed.events:
                        event = feed.events.popleft()
                        when = datetime.fromtimestamp(event.wall_ns * 1e-9)
                        print(printable(f"event    {when:%H:%M:%S} {event.code}: {event.text}"))
                    print(view.line(feed.status, window, stream.lost))
                sys.stdout.flush()
        except KeyboardInterrupt:
            return 0
        finally:
            if live is not None:
                live.stop()
    return 0


def list_all(args: argparse.Namespace) -> int:
    """Who is there, at a daemon or through a router: 1 where nobody is."""
    from dehyst.daemon.bus import encoding
    from dehyst.daemon.bus.keys import Keys
    from dehyst.daemon.bus.messages import Status
    from dehyst.daemon.bus.printable import printable
    from dehyst.daemon.bus.security import client_settings
    from dehyst.daemon.bus.session import Bus, BusError
    from dehyst.daemon.client.client import daemons

    where, credentials = address_of(args)
    with Bus.connect([where], security=client_settings(credentials)) as bus:
        names = daemons(bus, args.base)
        found: dict[str, Status | None] = {}
        for name in names:
            try:
                answer = next(bus.ask(Keys(args.base, name).rpc("status"), timeout_s=1.0))
                found[name] = encoding.decode(Status, answer)
            except (BusError, encoding.BadMessage):
                found[name] = None  # it has just gone, or may not be asked
    if args.json:
        print_json(found)
        return 0 if names else 1
    for name, status in found.items():
        if status is None:
            print(f"{name:20s} does not answer")
            continue
        state = status.state if status.core_alive else "no loop"
        lost = status.gateway.samples_lost
        row = (
            f"{name:20s} {state:9s} {1e9 / status.period_ns:g} Hz  reach {status.reach_min:.4g} "
            f"to {status.reach_max:.4g} {status.unit}  missed {status.missed}  lost {lost}  "
            f"commanded by {status.gateway.lease_label or 'nobody'}"
        )
        print(printable(row))
    if not names:
        say(f"no controller with keys below {args.base}/ is to be seen at {where}")
    return 0 if names else 1
