"""Print one screen about each axis of a running daemon."""

import argparse
from typing import TYPE_CHECKING, Any

from dehyst.daemon.client.connection import add_connection, connect_axes
from dehyst.daemon.json_text import print_json
from dehyst.models.errors import DehystError

if TYPE_CHECKING:
    from dehyst.daemon.client.client import Client
    from dehyst.models.model import Model

EPILOG = """\
Prints state and reason, position, output, model, inverse, deadlines, health, the commanding client,
and the newest events. It changes nothing and needs no lease.

exit status: 0: no problem; 1: something needs attention (lines that begin with !: no loop, a failed
device, a mismatch, a frozen trim, missed deadlines, lost samples); 2: no daemon, or bad usage.
--json: {"ok", "attention", "status", "model", "events"}; for several axes {"ok", "axes": {"x": the
same, ...}}.

example: dehyst status || echo "look at the stage"
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst status`."""
    parser.epilog = EPILOG
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    add_connection(parser)


def run(args: argparse.Namespace) -> int:
    """Query once and print; return 0, or 1 if something needs attention."""
    from dehyst.daemon.terminal.overview import describe_kind, find_troubles, overview

    found: dict[str, dict[str, Any]] = {}
    screens = []
    with connect_axes(args, "status") as stage:
        for axis, client in stage.clients.items():
            status, events = client.status(), client.events()
            model, troubles = _model(client), find_troubles(status)
            screens.append("\n".join(overview(status, model, events, troubles)))
            found[axis] = {
                "ok": not troubles,
                "attention": troubles,
                "status": status,
                "model": None if model is None else describe_kind(model),
                "events": events,
            }
    ok = all(one["ok"] for one in found.values())
    if not args.json:
        print("\n\n".join(screens))
    elif len(found) == 1:
        print_json(next(iter(found.values())))
    else:
        print_json({"ok": ok, "axes": found})
    return 0 if ok else 1


def _model(client: "Client") -> "Model | None":
    try:
        return client.model()
    except DehystError:  # no loop has run yet
        return None
