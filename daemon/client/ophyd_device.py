"""The stage as an ophyd-async device directly on the bus: set, trigger, read, fly a trajectory.

    from bluesky.run_engine import RunEngine
    from ophyd_async.core import init_devices
    from dehyst.ophyd import Stage

    engine = RunEngine()
    with init_devices():
        stage = Stage()
    engine(bluesky.plans.scan([stage], stage, 2.0, 8.0, 13))

It needs the package ophyd-async. It flies trajectories of any shape on the samples of the loop;
through EPICS (`dehyst epics`), ophyd-async's own Motor flies at constant velocity only.
"""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from ophyd_async.core import (
    DEFAULT_TIMEOUT,
    AsyncStatus,
    LazyMock,
    StandardReadable,
    StandardReadableFormat,
    soft_signal_r_and_setter,
)

from dehyst.daemon.client.positioner import Flight, Positioner, Reading
from dehyst.models.errors import BadInput


class OphydStage(StandardReadable):
    """The stage as an ophyd-async device.

    connect_to: makes the Positioner when the device is connected; None: the daemon that
    $DEHYST_CONNECT names. average_s: averaging time of each reading [s].
    """

    def __init__(
        self,
        connect_to: Callable[[], Positioner] | None = None,
        name: str = "",
        *,
        average_s: float = 0.1,
    ) -> None:
        self._make, self._average_s = connect_to or Positioner, average_s
        self._positioner: Positioner | None = None
        self._way: tuple[Any, Any] | None = None
        self._flight: Future[Flight] | None = None
        self.flown: Flight | None = None
        """The newest flight, with all its samples."""
        with self.add_children_as_readables(StandardReadableFormat.HINTED_SIGNAL):
            self.readback, self._set_readback = soft_signal_r_and_setter(float, 0.0)
        with self.add_children_as_readables():
            self.setpoint, self._set_setpoint = soft_signal_r_and_setter(float, 0.0)
            self.drive, self._set_drive = soft_signal_r_and_setter(float, 0.0, units="V")
        super().__init__(name=name)

    async def connect(
        self,
        mock: bool | LazyMock = False,
        timeout: float = DEFAULT_TIMEOUT,
        force_reconnect: bool = False,
    ) -> None:
        """Connect to the daemon. Raises what a Client raises."""
        await super().connect(mock, timeout, force_reconnect)
        if not mock and self._positioner is None:
            self._positioner = await asyncio.to_thread(self._make)
            self._show(await self._wait(self._stage.read()))

    def close(self) -> None:
        """Release the stage and close the connection."""
        if self._positioner is not None:
            self._positioner.close()

    @property
    def _stage(self) -> Positioner:
        if self._positioner is None:
            raise BadInput("the device is not connected: `with init_devices(): stage = Stage()`")
        return self._positioner

    async def _wait(self, future: "Future[Any]") -> Any:
        return await asyncio.wrap_future(future)

    def _show(self, reading: Reading) -> None:
        self._set_readback(reading.measured)
        self._set_setpoint(reading.target)
        self._set_drive(reading.volts)

    # -- bluesky's protocols ---------------------------------------------------------------------

    @AsyncStatus.wrap
    async def set(self, value: float) -> None:
        """Go to `value`; done when the stage is there. It stays there."""
        self._show(await self._wait(self._stage.go(value)))

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        """Take a reading."""
        self._show(await self._wait(self._stage.read(self._average_s)))

    async def stop(self, success: bool = False) -> None:
        """Stop the motion in progress and hold; later the output ramps to the safe voltage."""
        if not success:
            await asyncio.to_thread(self._stage.stop)

    @AsyncStatus.wrap
    async def prepare(self, value: tuple[ArrayLike, ArrayLike]) -> None:
        """Set the trajectory that kickoff starts: (n,) times [s] and (n,) targets."""
        t_s, targets = (np.array(part, float) for part in value)
        self._way = (t_s, targets)

    @AsyncStatus.wrap
    async def kickoff(self) -> None:
        """Start the trajectory. Raises BadInput if none was prepared."""
        if self._way is None:
            raise BadInput("no trajectory: call prepare(stage, (t_s, targets)) before kickoff")
        self._flight = self._stage.fly(*self._way)

    @AsyncStatus.wrap
    async def complete(self) -> None:
        """Wait for the end of the trajectory. Raises BadInput if it ended early or was not
        begun."""
        if self._flight is None:
            raise BadInput("no trajectory was started: call kickoff before complete")
        flight, self._flight = self._flight, None
        self.flown = await self._wait(flight)
        if not self.flown.played.completed:
            raise BadInput(f"the trajectory ended early: {self.flown.played.reason}")
