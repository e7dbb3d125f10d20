"""Read untrusted files within bounds, so that a silent pipe or an endless device cannot block."""

import os
import stat
from pathlib import Path


class NotReadable(Exception):
    """The file cannot be read; the text says why."""


def check_ordinary(path: Path) -> int:
    """Return the size of an ordinary file. Raises NotReadable for anything else, such as a pipe."""
    try:
        status = os.stat(path)
    except (OSError, ValueError) as error:
        raise NotReadable(getattr(error, "strerror", None) or str(error)) from None
    if not stat.S_ISREG(status.st_mode):
        raise NotReadable("it is not an ordinary file")
    return status.st_size


def read_text(path: Path, most_bytes: int) -> str:
    """Return the UTF-8 text of an ordinary file of at most `most_bytes`. Raises NotReadable."""
    size = check_ordinary(path)
    if size > most_bytes:
        raise NotReadable(f"{size} bytes; at most {most_bytes} are read")
    try:
        return path.read_text("utf-8-sig")  # editors on Windows put a byte order mark first
    except OSError as error:
        raise NotReadable(error.strerror or str(error)) from None
    except UnicodeDecodeError:
        raise NotReadable("it is not UTF-8 text") from None
