"""Handles requests for several axes of one controller: a lease of all or none, a stop of all.

Pure, like dehyst.daemon.gateway.admission, which it uses: takes times as arguments and returns
records.
"""

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from dehyst.daemon.bus.messages import Reply, Request, new_number
from dehyst.daemon.bus.refusal_codes import NotAdmitted
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.loop_records import NOTHING

TOGETHER = ("acquire", "take-over", "renew", "give-up", "stop", "release", "clear")
Records = NDArray[Any]


def handle_together(
    now_ns: int, request: Request, gates: Mapping[str, tuple[Admission, int]], asked: str
) -> tuple[Reply, dict[str, Records]]:
    """Return (answer, COMMAND records by axis). gates: each axis's admission and the room in its
    ring, by axis name; asked: the axis to whose key the request was sent.

    If one axis refuses a lease, none is given and existing leases remain unchanged. A stop is
    passed to every axis that can take it; if one cannot be stopped, the answer says so.
    """
    first, _ = gates[asked]
    strangers = [name for name in request.axes if name not in gates]
    if strangers or asked not in request.axes or len(set(request.axes)) < len(request.axes):
        text = f"axes {', '.join(request.axes)}: there are {', '.join(gates)}, each at most once"
        return first.refuse(now_ns, "bad-message", text), {}
    if request.action not in TOGETHER:
        text = f"{request.action} is for one axis; send it to each axis"
        return first.refuse(now_ns, "bad-message", text), {}
    if request.action in ("acquire", "take-over"):
        return _lease_all(now_ns, request, {name: gates[name][0] for name in request.axes}, asked)
    refused: Reply | None = None
    records: dict[str, Records] = {}
    for name in request.axes:
        gate, room = gates[name]
        reply, records[name] = gate.handle(now_ns, request, room)
        if name == asked:
            answer = reply
        if not reply.ok and refused is None:
            refused = _of_axis(name, reply)
    return refused or answer, records


def _lease_all(
    now_ns: int, request: Request, gates: Mapping[str, Admission], asked: str
) -> tuple[Reply, dict[str, Records]]:
    for name, gate in gates.items():
        try:
            gate.check_free(now_ns, request)
        except NotAdmitted as no:
            return gate.refuse(now_ns, no.code, f"{name}: {no}; no axis was given"), {}
    number = new_number()
    for gate in gates.values():
        gate.give_lease(now_ns, request, number)
    return gates[asked].granted(now_ns, request), dict.fromkeys(gates, NOTHING)


def _of_axis(name: str, reply: Reply) -> Reply:
    return Reply(ok=False, code=reply.code, text=f"{name}: {reply.text}"[:500])
