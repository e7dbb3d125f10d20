"""The folder that the processes of one daemon share, and the roles that they hold in it.

The folder must belong to its user, and nobody else may write into it, or the start is refused: a
user who can put a file there could make the daemon overwrite another file, or command the loop. One
process at a time holds each role (supervisor, driver of the output, network server), by a kernel
lock that ends with its process, however that ends.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dehyst.drivers import system
from dehyst.models.errors import BadInput, NotNow

SUPERVISOR, OUTPUT, NETWORK, DOCTOR = "supervisor", "output", "network", "doctor"
"""The roles. `dehyst core` and `dehyst safe` hold OUTPUT."""
OWN = system.NO_FOLLOW | system.CLOSE_ON_EXEC
LONGEST_NOTE = 4096  # bytes of the holder's name in the lock file


class InUse(BadInput):
    """Another process holds the role."""


def make_run_folder(folder: Path) -> None:
    """Make the folder (mode 0700) if there is none. Raises BadInput if it is not safe."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        found, around = os.lstat(folder), os.stat(folder.parent)
        reason = _why_not(found) or _why_not_in(around)
        if not reason and stat.S_IMODE(found.st_mode) != 0o700:
            os.chmod(folder, 0o700)  # others could read it, but not write into it
    except OSError as error:
        reason = f"it cannot be made: {error.strerror}"
    if reason:
        raise BadInput(
            f"run folder {folder}: {reason}; remove it, or set run_dir to a folder of your own"
        )


def why_not_trusted(folder: Path) -> str:
    """Return why the files in this folder cannot be trusted (others may write); "": they can."""
    try:
        real = folder.resolve()
        return _why_not(os.lstat(real)) or _why_not_in(os.stat(real.parent))
    except OSError as error:
        return error.strerror or str(error)


def _why_not(found: os.stat_result) -> str:
    """Return why this folder must not be used; "": it may be used."""
    if not stat.S_ISDIR(found.st_mode):
        return "it is a link or a file, not a folder"
    if found.st_uid != system.user_id():
        return f"it belongs to user {found.st_uid}, not to you (user {system.user_id()})"
    if system.others_may(found):
        return "others may write into it"
    return ""


def _why_not_in(around: os.stat_result) -> str:
    """Return why no folder in this one is safe: others could replace it; "": it is safe."""
    shared = system.others_may(around) and not around.st_mode & stat.S_ISVTX
    if shared or around.st_uid not in (0, system.user_id()):
        return "others may replace it, because they may write into its parent folder"
    return ""


@contextmanager
def at_work(folder: Path, role: str, command: str, config: Path | str) -> Iterator[None]:
    """Hold a role in the folder during the block. Raises InUse, which names the holding process by
    its command and configuration."""
    make_run_folder(folder)
    advice = (
        "a name and a run folder can have only one daemon; stop the whole daemon (Ctrl-C where "
        "`dehyst run` runs, or systemctl stop dehyst), because `dehyst run` starts a part that "
        "ended alone again; a second daemon needs another name, and devices of its own"
    )
    with locked(folder, role, command, config, advice):
        yield


@contextmanager
def locked(
    folder: Path, role: str, command: str, subject: Path | str, advice: str
) -> Iterator[None]:
    """Hold a lock of this name in any folder during the block. subject: the file or the folder that
    the command was given; advice: what to do about another holder. Raises InUse, which names that
    holder."""
    import fcntl  # POSIX only; reading a folder needs no lock

    path = folder / f"{role}.lock"
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | OWN, 0o600)
    except OSError as error:
        kind = NotNow if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EMFILE) else BadInput
        raise kind(f"{path}: cannot be opened: {error.strerror}") from None
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(file, LONGEST_NOTE, 0).decode("utf-8", "replace").strip()
            raise InUse(f"{folder} is in use by {holder or 'another process'}; {advice}") from None
        note = f"process {os.getpid()} (dehyst {command} of {os.path.abspath(subject)})\n"
        try:
            os.ftruncate(file, 0)
            os.pwrite(file, note.encode("utf-8", "backslashreplace")[:LONGEST_NOTE], 0)
        except OSError:  # a full disk: the lock is still held, but without a name
            os.ftruncate(file, 0)
        yield
    finally:
        os.close(file)
