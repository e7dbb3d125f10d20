"""The stage as a bluesky device: set, trigger, read, describe, and fly a trajectory.

    from bluesky import RunEngine
    from bluesky import plans
    from dehyst.bluesky import Stage

    stage = Stage("stage")
    RunEngine()(plans.scan([stage], stage, 2.0, 8.0, 13))

bluesky requires methods, not a base class, so nothing of it is imported here. The stage itself is
implemented in dehyst.daemon.client.positioner; this module only adapts it to bluesky's interface.
"""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dehyst.daemon.client.positioner import Positioner
from dehyst.daemon.client.readings import Flight, Reading, model_place
from dehyst.models.errors import BadInput

Answer = dict[str, dict[str, Any]]
FIELDS = ("", "_setpoint", "_drive")
"""Suffixes of each event's fields: reading, target, volts."""


class Doing:
    """A bluesky status: whether an action is done, and how it ended."""

    def __init__(self, future: "Future[Any]") -> None:
        self._future = future

    def __repr__(self) -> str:
        """Return what the RunEngine prints for a failed status."""
        error = self.exception()
        return f"failed: {error}" if error else "done" if self.done else "under way"

    @property
    def done(self) -> bool:
        """Return whether the action is over, successful or not."""
        return self._future.done()

    @property
    def success(self) -> bool:
        """Return whether the action is over and was successful."""
        return self.done and self._future.exception() is None

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return why the action failed; None while it runs or if it did not fail."""
        return self._future.exception(timeout) if timeout or self.done else None

    def add_callback(self, callback: Callable[["Doing"], None]) -> None:
        """Call `callback` when the action is over, at once if it already is."""
        self._future.add_done_callback(lambda _: callback(self))

    def wait(self, timeout: float | None = None) -> None:
        """Wait for the end. Raises the exception that made it fail."""
        self._future.result(timeout)


def _done() -> Doing:
    """Return the status of an action that is over."""
    future: Future[None] = Future()
    future.set_result(None)
    return Doing(future)


class BlueskyStage:
    """The stage as a bluesky device.

    name: prefix of the fields; positioner: None makes one for the daemon that $DEHYST_CONNECT
    names; average_s: averaging time of each reading [s]; every: one in `every` samples of a flight
    becomes an event.
    """

    parent = None

    def __init__(
        self,
        name: str = "stage",
        positioner: Positioner | None = None,
        *,
        average_s: float = 0.1,
        every: int = 1,
    ) -> None:
        self.name, self.average_s, self.every = name, average_s, every
        self._positioner = positioner if positioner is not None else Positioner()
        self._newest: Reading | None = None
        self._way: tuple[Any, Any] | None = None
        self._flight: Future[Flight] | None = None
        self.hints = {"fields": [name]}

    def close(self) -> None:
        """Release the stage and close the connection."""
        self._positioner.close()

    # -- a place ---------------------------------------------------------------------------------

    def set(self, value: float) -> Doing:
        """Go to `value`; done when the stage is there. It stays there."""
        return Doing(self._positioner.go(value))

    def stop(self, *, success: bool = False) -> None:
        """Stop the motion in progress and hold; later the output ramps to the safe voltage. Called
        by a run that fails or is aborted by the user."""
        if not success:
            self._positioner.stop()

    def check_value(self, value: float) -> None:
        """Raise BadInput if `value` is out of the stage's reach."""
        low, high = self.limits
        if not low <= value <= high:
            raise BadInput(f"{value:g} {self._unit} is out of reach, {low:g} to {high:g}")

    @property
    def limits(self) -> tuple[float, float]:
        """Return the smallest and largest set-point that the stage reaches."""
        return self._positioner.reach

    @property
    def position(self) -> float:
        """Return the measured position."""
        return self._positioner.read().result().measured

    # -- a reading -------------------------------------------------------------------------------

    def trigger(self) -> Doing:
        """Take a reading."""
        future = self._positioner.read(self.average_s)
        future.add_done_callback(self._keep)
        return Doing(future)

    def _keep(self, future: "Future[Reading]") -> None:
        if future.exception() is None:
            self._newest = future.result()

    def read(self) -> Answer:
        """Return the reading that trigger() took, or a new one if there is none."""
        newest = self._newest if self._newest is not None else self._positioner.read().result()
        self._newest = None
        values = (newest.measured, newest.target, newest.volts)
        return {
            self.name + field: {"value": value, "timestamp": newest.wall_s}
            for field, value in zip(FIELDS, values, strict=True)
        }

    def describe(self) -> Answer:
        """Describe the fields of read()."""
        units = (self._unit, self._unit, "V")
        source = f"dehyst:{self._positioner.name}"
        return {
            self.name + field: {
                "source": f"{source}/{what}",
                "dtype": "number",
                "shape": [],
                "units": unit,
                "precision": 4,
            }
            for field, unit, what in zip(
                FIELDS, units, ("measured", "target", "volts"), strict=True
            )
        }

    def read_configuration(self) -> Answer:
        """Return the settings with which readings are taken."""
        now = time.time()
        return {name: {"value": v, "timestamp": now} for name, (v, _) in self._configured().items()}

    def describe_configuration(self) -> Answer:
        """Describe the fields of read_configuration()."""
        return {
            name: {"source": "dehyst", "dtype": kind, "shape": []}
            for name, (_, kind) in self._configured().items()
        }

    def _configured(self) -> dict[str, tuple[Any, str]]:
        stage = self._positioner
        values: dict[str, tuple[Any, str]] = {
            "tolerance": (stage.tolerance, "number"),
            "settle_s": (stage.settle_s, "number"),
            "average_s": (self.average_s, "number"),
            "period_s": (stage.period_s, "number"),
            "arrived_by": (stage.by, "string"),
        }
        return {f"{self.name}_{name}": value for name, value in values.items()}

    @property
    def _unit(self) -> str:
        return self._positioner.unit

    # -- a flight --------------------------------------------------------------------------------

    def prepare(self, value: tuple[ArrayLike, ArrayLike]) -> Doing:
        """Set the trajectory that kickoff() starts: (n,) times [s] and (n,) targets."""
        t_s, targets = (np.array(part, float) for part in value)
        self._way = (t_s, targets)
        return _done()

    def kickoff(self) -> Doing:
        """Start the trajectory. Raises BadInput if none was prepared."""
        if self._way is None:
            raise BadInput("no trajectory: call prepare(stage, (t_s, targets)) before kickoff")
        self._flight = self._positioner.fly(*self._way)
        return _done()

    def complete(self) -> Doing:
        """Return a status that is done when the trajectory is over and fails if it ended early.
        Raises BadInput before kickoff()."""
        if self._flight is None:
            raise BadInput("no trajectory was started: call kickoff before complete")
        over: Future[None] = Future()

        def judge(flight: "Future[Flight]") -> None:
            error = flight.exception()
            if error is None and not (played := flight.result().played).completed:
                error = BadInput(f"the trajectory ended early: {played.reason}")
            over.set_exception(error) if error is not None else over.set_result(None)

        self._flight.add_done_callback(judge)
        return Doing(over)

    def describe_collect(self) -> dict[str, Answer]:
        """Describe the fields of collect(), in a stream named after the stage."""
        fields = self.describe()
        place = {**fields[self.name], "source": f"dehyst:{self._positioner.name}/predicted"}
        return {self.name: {**fields, f"{self.name}_predicted": place}}

    def collect(self) -> Iterator[dict[str, Any]]:
        """Yield the samples of the flight as events, one event per `every` samples."""
        if self._flight is None:
            return
        flight, self._flight = self._flight.result(), None
        samples, wall_s = flight.samples[:: self.every], flight.wall_s[:: self.every]
        columns = {
            self.name: samples["measured"],
            f"{self.name}_setpoint": samples["target"],
            f"{self.name}_drive": samples["volts"],
            f"{self.name}_predicted": model_place(samples),
        }
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        for at_s, row in zip(wall_s.tolist(), rows, strict=True):
            yield {
                "time": at_s,
                "data": dict(zip(columns, row, strict=True)),
                "timestamps": dict.fromkeys(columns, at_s),
            }
