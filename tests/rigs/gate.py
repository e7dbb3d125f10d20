"""The gate before the loop, with a clock that the test controls."""

import numpy as np

from dehyst.daemon.bus.messages import Chunk, Reply, Request, Setpoint
from dehyst.daemon.bus.refusal_codes import CODES
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.rings.records import COMMAND, State

S = 1_000_000_000
ROOM = 65536


class Gate:
    """An admission with a clock that the test controls, and clients whose own clock is off."""

    def __init__(self) -> None:
        self.now = 1000 * S
        self.gate = Admission("um", 10.0, 2.0, Lease(3 * S), may_stay=False)
        core = self.gate.core
        core.alive, core.state, core.reachable = True, State.READY, (-5.0, 5.0)
        core.period_ns, core.status_ns = 1_000_000, self.now
        self.leases: dict[int, int] = {}
        self.skew = {1: -77 * S, 2: 10_000 * S}

    def sent(self, client: int, ago_s: float = 0.0) -> int:
        return self.now + self.skew[client] - round(ago_s * S)

    def ask(self, command: object, room: int = ROOM) -> tuple[Reply, np.ndarray]:
        reply, records = self.gate.handle(self.now, command, room)  # type: ignore[arg-type]
        assert reply.code in CODES
        assert reply.ok or not records.size
        assert records.dtype == COMMAND
        return reply, records

    def request(self, client: int, action: str, **more: object) -> Reply:
        fields: dict = {
            "client": client, "lease": self.leases.get(client, 0), "sent_ns": self.sent(client),
            "action": action,
        }  # fmt: skip
        reply, self.records = self.ask(Request(**(fields | more)))
        if reply.ok and action in ("acquire", "take-over"):
            self.leases[client] = reply.lease
        return reply

    def setpoint(self, sequence: int, value: float = 1.0, client: int = 1, **more: object) -> Reply:
        fields: dict = {
            "client": client, "lease": self.leases.get(client, 0), "sequence": sequence,
            "sent_ns": self.sent(client), "value": value, "unit": "um",
        }  # fmt: skip
        reply, self.records = self.ask(Setpoint(**(fields | more)))
        return reply

    def chunk(
        self, index: int, times_s: np.ndarray, values: np.ndarray | None = None, **more: object
    ) -> Reply:
        values = np.zeros(times_s.size) if values is None else values
        fields: dict = {
            "client": 1, "lease": self.leases.get(1, 0), "trajectory": 9, "index": index,
            "sent_ns": self.sent(1), "unit": "um",
            "offset_ns": np.round(times_s * 1e9).astype("<i8").tobytes(),
            "value": values.astype("<f8").tobytes(),
        }  # fmt: skip
        room = int(more.pop("room", ROOM))  # type: ignore[call-overload]
        reply, self.records = self.ask(Chunk(**(fields | more)), room)
        return reply


def grid(start_s: float, seconds: float, step_s: float = 0.001) -> np.ndarray:
    return start_s + step_s * np.arange(round(seconds / step_s))
