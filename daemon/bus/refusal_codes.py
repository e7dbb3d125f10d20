"""Why a command is refused: one table of the codes, in words, and which of them ask for time."""

from typing import NamedTuple


class Code(NamedTuple):
    """says: in words; waits: the same command may be admitted later, so a client repeats it;
    otherwise the refusal is final."""

    says: str
    waits: bool = False


CODES = {
    "ok": Code("done"),
    "duplicate": Code("this chunk was accepted before; nothing happened (the answer has ok: true)"),
    "bad-message": Code("not a message of this version"),
    "no-core": Code("the loop does not run", waits=True),
    "starting": Code("the loop is starting and follows no commands yet", waits=True),
    "state": Code("the loop follows no commands in its present state"),
    "no-lease": Code("the sender holds no lease, or an older one"),
    "lease-taken": Code("another client commands"),
    "old": Code("older than the newest set-point, or a repeated one"),
    "late": Code("too old on arrival", waits=True),
    "unit": Code("another unit than the daemon's"),
    "not-finite": Code("NaN or infinite"),
    "unreachable": Code("outside the reachable range"),
    "order": Code("a chunk or time stamp out of order"),
    "dense": Code("points closer than the loop's period"),
    "span": Code("one chunk spans more than the daemon accepts ahead"),
    "over": Code("this trajectory has ended or was withdrawn"),
    "queue-full": Code("more trajectory ahead than the daemon accepts", waits=True),
    "stay": Code("the configuration does not allow keeping a position without a client"),
    "no-offer": Code("no such offer, or it cannot be accepted now"),
    "flood": Code("more commands than the daemon reads", waits=True),
}
