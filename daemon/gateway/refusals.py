"""Why a command is not admitted: the codes, and what is raised."""

CODES = {
    "ok": "done",
    "duplicate": "this chunk was taken before; nothing happened",
    "bad-message": "not a message of this version",
    "no-core": "the loop does not run",
    "state": "the loop follows no commands in its present state",
    "no-lease": "the sender holds no lease, or an older one",
    "lease-taken": "another client commands",
    "old": "older than the newest set-point, or a repeated one",
    "late": "too long on its way",
    "unit": "another unit than the daemon's",
    "not-finite": "NaN or infinite",
    "unreachable": "outside the reachable range",
    "order": "a chunk or time stamp out of order",
    "dense": "points closer than the loop's period",
    "over": "this trajectory has ended or was withdrawn",
    "queue-full": "more trajectory ahead than the daemon accepts",
    "stay": "the configuration does not allow a place to be kept without a client",
    "no-offer": "no such offer, or it cannot be taken now",
    "flood": "more commands than the daemon reads",
}


class NotAdmitted(Exception):
    """A command that is not admitted. code: in CODES; the text is for the client."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code
