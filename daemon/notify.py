"""sd_notify: report the service's state to systemd. Without $NOTIFY_SOCKET nothing happens."""

import os
import socket


def send(*lines: str) -> bool:
    """Send e.g. "READY=1", "WATCHDOG=1", "STATUS=...", "STOPPING=1". Return True if it was sent.

    The socket is a path, or an abstract name that begins with @ (sd_notify(3)). Never raises: a
    service manager that does not listen must not stop the stage.
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
    """Return half of the interval within which systemd expects WATCHDOG=1 [s]; None if it does
    not expect it."""
    for_us = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    usec = os.environ.get("WATCHDOG_USEC", "")
    return int(usec) / 2e6 if for_us and usec.isdigit() and int(usec) > 0 else None
