"""Prepare message and file classes so that several threads may decode them at once."""

import msgspec


def resolve_classes(*kinds: type) -> None:
    """Resolve these classes' fields now, in the thread that imports their module. msgspec otherwise
    does so at a class' first use; if two threads do it at once, the process ends with a
    segmentation fault (msgspec 0.22)."""
    for kind in kinds:
        msgspec.msgpack.Decoder(kind)
