"""Serve a controller in another controller's protocol."""

import argparse
import logging
import signal
import sys
import threading
from types import FrameType

from dehyst.daemon.client.connection import connect_axes
from dehyst.daemon.client.open_protocol import add_serving, check_exposure, check_tolerance
from dehyst.models.errors import BadInput

DEFAULT = "127.0.0.1:50000"
EPILOG = """Programs that speak PI's General Command Set 2.0 over TCP (PIPython, PIMikroMove's TCP
port, LabVIEW drivers) then drive the stage as a closed-loop controller: SVO takes the command
lease, MOV moves, ONT? follows the model or the gauge, and the wave generator plays scans on the
loop's own samples. docs/gcs.md lists the supported commands. The protocol has no passwords: anybody
who reaches the port can command the stage, so an address beyond this machine needs
--without-passwords.

examples: dehyst serve --as gcs
          dehyst serve --as gcs --name stage-1 --on-target gauge --tolerance 0.02
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst serve`."""
    parser.epilog = EPILOG
    parser.add_argument("--as", dest="dialect", choices=("gcs",), required=True, help="the dialect")
    parser.add_argument(
        "--listen", default=DEFAULT, metavar="HOST:PORT", help=f"where (default: {DEFAULT})"
    )
    add_serving(parser)


def run(args: argparse.Namespace) -> int:
    """Serve until SIGTERM or Ctrl-C."""
    from dehyst.daemon.kernel_cache import load_lightly

    load_lightly()
    from dehyst import __version__
    from dehyst.daemon.client.group import Group
    from dehyst.daemon.client.held_axes import HeldAxes
    from dehyst.daemon.gcs.controller import GcsController
    from dehyst.daemon.gcs.server import GcsServer

    host, port = address(args.listen, args.without_passwords)
    check_tolerance(args.tolerance)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)

    def connect() -> Group:
        return connect_axes(args, "serve --as gcs")

    with HeldAxes(connect, tolerance=args.tolerance, by=args.on_target) as held:
        try:
            server = GcsServer((host, port), GcsController(held, __version__))
        except OSError as error:
            raise BadInput(f"--listen {args.listen}: {error.strerror or error}") from None
        with server:
            end = _end_at_signals(server)
            print(
                f"dehyst serve: {held.name} as a GCS 2.0 controller at {host}:"
                f"{server.server_address[1]}",
                file=sys.stderr,
                flush=True,
            )
            server.serve_forever(poll_interval=0.2)
            end.join()
    return 0


def _end_at_signals(server: "object") -> threading.Thread:
    """Start a thread that ends the server at SIGTERM or Ctrl-C. A signal handler cannot end it,
    because it runs in the thread that serves."""
    asked = threading.Event()

    def ask(_number: int, _frame: FrameType | None) -> None:
        asked.set()

    def wait() -> None:
        asked.wait()
        server.shutdown()  # type: ignore[attr-defined]

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, ask)
    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


def address(text: str, anywhere: bool) -> tuple[str, int]:
    """Parse HOST:PORT into (host, port). Raises BadInput if it is not valid, or if other machines
    can reach it and `anywhere` is false."""
    host, _, port = text.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdigit() or int(port) > 65535:
        raise BadInput(f"--listen {text}: it must be HOST:PORT with a port from 0 to 65535")
    ways = "add --without-passwords if the network is trusted"
    check_exposure(text, host, anywhere, "the protocol", ways)
    return host, int(port)
