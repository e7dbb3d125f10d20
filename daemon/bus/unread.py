"""End connections whose other side reads nothing."""

import os
import socket
import stat
from contextlib import suppress

from dehyst.drivers import system


def end_unread_connections(after_ms: int) -> None:
    """Let the kernel end a connection whose other side has read nothing for `after_ms`.

    zenoh writes to a link without a time limit, and closing such a link waits for the write: a few
    of them block its threads, and thereby all clients. Connections inherit the limit from the
    listening socket (TCP_USER_TIMEOUT, tcp(7)).
    """
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # the directory's own descriptor is already closed
            if stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                _end_unread(int(name), after_ms)


def _end_unread(descriptor: int, after_ms: int) -> None:
    with socket.socket(fileno=os.dup(descriptor)) as one:
        inet = one.family in (socket.AF_INET, socket.AF_INET6)
        if inet and one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
            system.end_unread(one, after_ms)
