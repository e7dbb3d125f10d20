"""What the page derives from a controller's status."""

from collections import deque

import msgspec
import numpy as np

from dehyst.daemon.bus.messages import GatewayStatus, Status
from dehyst.daemon.gateway.publisher import status_message
from dehyst.daemon.page.watching import note_health
from dehyst.daemon.rings.status import STATUS

GATEWAY = GatewayStatus(
    pid=1, uptime_s=2.0, samples_published=0, samples_lost=0, commands=0, rejected={},
    lease_client=0, lease_label="", lease_left_s=0.0, history_s=0.0, restarts_of_core=0,
)  # fmt: skip


def status(wall_s: float, health: float) -> Status:
    """Return a status as the gateway sends it; wall_s = 0: the loop has not reported yet."""
    record = np.zeros(1, STATUS)[0]
    record["wall_ns"] = round(wall_s * 1e9)
    return status_message(record, "stage", 1, True, msgspec.structs.replace(GATEWAY, health=health))


def test_a_loop_that_has_said_nothing_has_no_place_on_the_health_axis() -> None:
    healths: deque[tuple[float, float]] = deque(maxlen=10)
    for wall_s, health in ((0.0, 0.0), (0.0, -0.5), (2e9, -0.4), (2e9, -0.4), (2e9 + 1, 0.3)):
        note_health(healths, status(wall_s, health))
    np.testing.assert_allclose(healths, [(2e9, -0.4), (2e9 + 1, 0.3)], rtol=1e-12)
