"""A failed device is reconnected, whatever errors its reconnection raises meanwhile."""

import pytest
from tests.rigs.gateway_bench import wait_until

from dehyst.daemon.loop.devices import DeviceLink
from dehyst.drivers.interface import DeviceGone, DriverError


class Odd:
    """A third-party device: its reconnection raises these errors in turn, then succeeds."""

    def __init__(self, *errors: Exception) -> None:
        self.errors = list(errors)

    def reconnect(self) -> None:
        if self.errors:
            raise self.errors.pop(0)

    def close(self) -> None:
        pass


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_that_no_driver_should_raise_does_not_end_the_reconnection() -> None:
    device = Odd(DeviceGone("unplugged"), AttributeError("no such name"), OSError(5, "I/O error"))
    link = DeviceLink("sensor", device)
    link.down(DriverError("it failed"))
    wait_until("it is back", link.came_back)
    link.close()
    assert link.ok
    assert list(link.news) == [
        "sensor: DriverError: it failed",
        "sensor: not back yet: unplugged",
        "sensor: not back yet: AttributeError: no such name",
        "sensor: not back yet: OSError: [Errno 5] I/O error",
        "sensor: back",
    ]
