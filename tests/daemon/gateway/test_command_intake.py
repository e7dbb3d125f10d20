"""The gateway's queue of set-points under a flood, without a bus."""

from typing import Any

import numpy as np

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Setpoint
from dehyst.daemon.clock import monotonic_ns
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.command_intake import CROWD, WAITING_PUTS, AxisInbox, CommandIntake
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.rings.records import State


class Stand:
    """Stands in for the bus and the loop; keeps what the intake passes on."""

    room = 65536

    def __init__(self) -> None:
        self.values: list[float] = []

    def sender(self, *_: Any) -> Any:
        return self

    def put(self, _payload: bytes) -> None:
        """Ignore a refusal."""

    def push(self, records: np.ndarray) -> None:
        self.values += records["value"].tolist()


def test_of_a_flood_the_newest_of_each_sender_is_looked_at() -> None:
    stand: Any = Stand()
    lease = Lease(10**9)
    admission = Admission("um", 10.0, 2.0, lease)
    core = admission.core
    core.alive, core.state, core.reachable = True, State.READY, (0.0, 1e6)
    number = lease.give(monotonic_ns(), 1, "one", monotonic_ns())
    inbox = AxisInbox(stand, Keys("dehyst", "a"), stand, admission)
    intake = CommandIntake([inbox])

    def put(client: int, sequence: int) -> None:
        message = Setpoint(
            client=client, lease=number, sequence=sequence, sent_ns=monotonic_ns(),
            value=float(sequence), unit="um",
        )  # fmt: skip
        intake.put(inbox, f"dehyst/@v1/a/pubsub/setpoint_um/{client}", encoding.encode(message))

    for i in range(CROWD):  # few: each one is handled
        put(1, i + 1)
    while intake._take_one_each():
        pass
    assert stand.values == [float(i + 1) for i in range(CROWD)]
    count = 3 * WAITING_PUTS
    for i in range(count):
        put(1, 1000 + i)
        put(2, 1000 + i)  # without the lease
    while intake._take_one_each():
        pass
    assert stand.values[CROWD:] == [1000.0 + count - 1]
    assert admission.rejected["lease-taken"] == 1
    assert inbox.flooded + admission.rejected["flood"] == 2 * count - 2
