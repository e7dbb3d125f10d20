"""Message and file classes that several threads may read at once."""

import msgspec


def resolve_classes(*kinds: type) -> None:
    """Work out how to read these classes, now, in the thread that imports their module. msgspec
    does this where a class is first used; two threads that do it at once end the process with
    a segmentation fault (msgspec 0.22)."""
    for kind in kinds:
        msgspec.msgpack.Decoder(kind)
