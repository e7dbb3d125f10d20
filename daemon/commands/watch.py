"""Live view of a running daemon."""

import argparse
import sys

from dehyst.daemon.remote import add_connection, connect, print_json

EPILOG = """On a terminal: target, measured and error as plots, state, deadlines, devices, events;
Ctrl-C leaves. In a pipe: one line a second, events as they come. --json: one JSON status a second.
Watching changes nothing and needs no lease.

example: dehyst watch --for 10
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst watch`."""
    parser.epilog = EPILOG
    parser.add_argument("--for", dest="seconds", type=float, metavar="S", help="leave after S s")
    parser.add_argument(
        "--window", type=float, default=10.0, metavar="S", help="seconds in the plots (default: 10)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON status a second")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Until --for or Ctrl-C."""
    from rich.console import Console
    from rich.live import Live

    from dehyst.daemon import clock, view

    with connect(args, "watch") as client:
        feed, stream = client.feed(), client.stream()
        feed.status = client.status()
        window = view.Window(args.window, feed.status.period_ns)
        begun_ns = shown_ns = clock.monotonic_ns()
        console = Console()
        live = None
        if console.is_terminal and not args.json:
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
                    live.update(
                        view.screen(feed.status, window, stream.lost, feed.events, feed.rejections),
                        refresh=True,
                    )
                elif args.json:
                    print_json(feed.status)
                else:
                    while feed.events:
                        event = feed.events.popleft()
                        print(f"event    {event.code}: {event.text}")
                    print(view.line(feed.status, window, stream.lost))
                sys.stdout.flush()
        except KeyboardInterrupt:
            return 0
        finally:
            if live is not None:
                live.stop()
    return 0
