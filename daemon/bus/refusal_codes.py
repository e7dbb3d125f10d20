"""Table of the refusal codes: their meanings in words, and which of them are temporary."""

from typing import NamedTuple


class RefusalCode(NamedTuple):
    """A refusal code. says: its meaning in words; waits: the same command may be admitted later, so
    clients repeat it; otherwise the refusal is final."""

    says: str
    waits: bool = False


class NotAdmitted(Exception):
    """Raised for a command that is refused. code: a key of CODES; the text is for the client."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


CODES = {
    "ok": RefusalCode("done"),
    "duplicate": RefusalCode(
        "this chunk was accepted before; nothing happened (the answer has ok: true)"
    ),
    "bad-message": RefusalCode("not a message of this version"),
    "no-core": RefusalCode("the loop does not run", waits=True),
    "starting": RefusalCode("the loop is starting and follows no commands yet", waits=True),
    "state": RefusalCode("the loop follows no commands in its present state"),
    "no-lease": RefusalCode("the sender holds no lease, or an older one"),
    "lease-taken": RefusalCode("another client commands"),
    "old": RefusalCode(
        "older than the newest set-point or the client's own stop, or a repeated one"
    ),
    "late": RefusalCode("too old on arrival", waits=True),
    "unit": RefusalCode("another unit than the daemon's"),
    "not-finite": RefusalCode("NaN or infinite"),
    "unreachable": RefusalCode("outside the reachable range"),
    "order": RefusalCode("a chunk or time stamp out of order"),
    "offset": RefusalCode(
        "a point before the start of its trajectory, or more than a year after it"
    ),
    "dense": RefusalCode("points closer than the loop's period"),
    "span": RefusalCode("one chunk spans more than the daemon accepts ahead"),
    "over": RefusalCode(
        "this trajectory has ended or was withdrawn, or another client has stopped the stage and "
        "the lease was not acquired since"
    ),
    "queue-full": RefusalCode("more trajectory ahead than the daemon accepts", waits=True),
    "stay": RefusalCode("the configuration does not allow keeping a position without a client"),
    "no-offer": RefusalCode("no such offer, or it cannot be accepted now"),
    "flood": RefusalCode("more commands than the daemon can process", waits=True),
}
