"""sd_notify: tell systemd how the service is. Without $NOTIFY_SOCKET nothing happens."""

import os
import socket


def send(*lines: str) -> bool:
    """Send e.g. "READY=1", "WATCHDOG=1", "STATUS=...", "STOPPING=1"; True when it was sent.

    The socket is a path, or an abstract name that begins with @ (sd_notify(3)). Never raises: a
    service manager that does not listen is no reason for the stage to stop.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    name = "\0" + address[1:] if address.startswith("@") else address
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as link:
            link.setblocking(False)
            link.sendto("\n".join(lines).encode(), name)
    except OSError:
        return False
    return True


def watchdog_s() -> float | None:
    """Half of the interval in which systemd wants to hear WATCHDOG=1; None: it does not."""
    for_us = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    usec = os.environ.get("WATCHDOG_USEC", "")
    return int(usec) / 2e6 if for_us and usec.isdigit() and int(usec) > 0 else None
