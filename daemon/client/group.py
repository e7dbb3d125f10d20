"""Commands several axes of one controller together, or not at all.

    from dehyst.client import Group

    with Group("stage-1", ["x", "y"]) as stage:
        stage.send({"x": 4.0, "y": 2.0})
        stage.play(t_s, {"x": x_um, "y": y_um})    # on the same samples

A lease covers all axes of the group or none; a trajectory starts on all of them at the same
sample, and if one runs out of points all stop together. Each axis is a Client (`stage["x"]`) on
one shared connection. Threads and forks: as for Client.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Reply, Status, new_number
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.called import python_function
from dehyst.daemon.client.client import Client, open_bus
from dehyst.daemon.client.finding import find_axes
from dehyst.daemon.client.player import LEAD_S, LEARNING_LEAD_S, Played, Player
from dehyst.daemon.client.questions import LONGEST_START_S
from dehyst.daemon.client.repeated import Repeated
from dehyst.daemon.client.together import play_together
from dehyst.daemon.closing import Closing
from dehyst.models.errors import BadInput

if TYPE_CHECKING:  # importing scipy is slow
    from dehyst.daemon.client.learning import LessonTaker


class Group(Closing):
    """Axes of one controller.

    name: name of the controller (`stage-1`: all its axes) or of one axis (`stage-1-x`); None: the
    only controller that answers. axes: which of its axes, in this order; None: all. Other
    arguments: as for Client. Raises BusError if there is no such controller or axis.
    """

    @python_function
    def __init__(
        self,
        name: str | None = None,
        axes: Sequence[str] | None = None,
        connect: str | Sequence[str] | None = None,
        base: str = "dehyst",
        label: str = "",
        credentials: str | Path | None = None,
    ) -> None:
        self.bus, addresses = open_bus(connect, credentials)
        try:
            self.name, found = find_axes(self.bus, base, name, addresses)
            missing = [axis for axis in axes or () if axis not in found]
            if missing:
                raise BusError(
                    f"{name or self.name} has no axis {', '.join(missing)}; it has: "
                    f"{', '.join(found) if '' not in found else 'one axis, without a name'}"
                )
            number = new_number()
            self.clients = {
                axis: Client.of_axis(self.bus, Keys(base, found[axis]), label, number)
                for axis in (found if axes is None else axes)
            }
        except BaseException:
            self.bus.close()
            raise
        together = tuple(self.clients.values())
        for client in together:
            client.together, client.commanding = together, together[0].commanding

    def close(self) -> None:
        """Give up the lease and close the connection. Safe to call twice."""
        for client in self.clients.values():
            client.give_up()
        self.bus.close()

    def __getitem__(self, axis: str) -> Client:
        return self.clients[axis]

    def __iter__(self) -> Iterator[str]:
        return iter(self.clients)

    def __len__(self) -> int:
        return len(self.clients)

    @property
    def first(self) -> Client:
        """Return the client of the first axis."""
        return next(iter(self.clients.values()))

    @python_function
    def wait_until_started(
        self, timeout_s: float = LONGEST_START_S, on_wait: Callable[[str], None] = lambda _: None
    ) -> dict[str, Status]:
        """Same as Client.wait_until_started, for each axis."""
        return {a: one.wait_until_started(timeout_s, on_wait) for a, one in self.clients.items()}

    def status(self) -> dict[str, Status]:
        """Return the present status of each axis."""
        return {axis: client.status() for axis, client in self.clients.items()}

    # -- commands -------------------------------------------------------------------------------

    def acquire(self) -> None:
        """Take the lease of all axes, or of none. Raises Refusal, naming the axis."""
        self.first.acquire()

    def take_over(self) -> None:
        """Take the lease of all axes from whoever holds them."""
        self.first.take_over()

    def stop(self) -> None:
        """Drop all targets of all axes: they hold, then ramp. Needs no lease."""
        self.first.stop(self._names())

    def release(self) -> None:
        """Drop all targets and ramp all axes to their safe voltages now. Needs no lease."""
        self.first.release(self._names())

    @python_function
    def hold(self, stay: bool = False) -> dict[str, Reply]:
        """Hold the present voltage of every axis: see Client.hold."""
        return {axis: client.hold(stay) for axis, client in self.clients.items()}

    @python_function
    def send(
        self,
        targets: Mapping[str, float],
        allow_unreachable: bool = False,
        stay: bool = False,
    ) -> dict[str, Reply]:
        """Go to a target per axis and wait for the daemon's answer for each. Nothing is sent if one
        of the targets is out of reach. stay: as for Client.send. Raises BadInput, Refusal."""
        self._know(targets)
        if not allow_unreachable and len(targets) > 1:
            for axis, value in targets.items():
                check_inside(axis, np.array([value]), self.clients[axis].status())
        return {
            axis: self.clients[axis].send(value, allow_unreachable, stay)
            for axis, value in targets.items()
        }

    @python_function
    def play(
        self,
        t_s: ArrayLike,
        targets: Mapping[str, ArrayLike],
        allow_unreachable: bool = False,
        progress: Callable[[float, float], None] | None = None,
        lead_s: float = LEAD_S,
        repeat: int = 1,
    ) -> dict[str, Played]:
        """Stream a trajectory of several axes, (n,) times [s] and (n,) targets of each, wait for
        its end and return the result per axis. Other arguments: as for Client.play. If one axis
        cannot play it, none starts; if one ends early, the others are stopped."""
        points = {axis: Repeated(t_s, values, repeat) for axis, values in targets.items()}
        return self._play(points, allow_unreachable, progress, lead_s, {})

    def play_learning(
        self,
        points: Mapping[str, Repeated],
        lessons: "Mapping[str, LessonTaker]",
        allow_unreachable: bool = False,
        progress: Callable[[float, float], None] | None = None,
    ) -> dict[str, Played]:
        """Same as Client.play_learning, for several axes."""
        return self._play(points, allow_unreachable, progress, LEARNING_LEAD_S, lessons)

    def _play(
        self,
        points: Mapping[str, Repeated],
        allow_unreachable: bool,
        progress: Callable[[float, float], None] | None,
        lead_s: float,
        lessons: "Mapping[str, LessonTaker]",
    ) -> dict[str, Played]:
        self._know(points)
        if not allow_unreachable:
            for axis, of_axis in points.items():
                check_inside(axis, of_axis.targets, self.clients[axis].status())
        self.acquire()
        number = new_number()
        names = [self.clients[axis].name for axis in points]
        together = names if len(names) > 1 else ()
        players = [
            Player(
                self.clients[axis],
                of_axis,
                allow_unreachable,
                lead_s,
                lessons.get(axis),
                together,
                number,
            )
            for axis, of_axis in points.items()
        ]
        return dict(zip(points, play_together(players, progress), strict=True))

    def _names(self) -> list[str]:
        return [c.name for c in self.clients.values()] if len(self.clients) > 1 else []

    def _know(self, axes: Mapping[str, object]) -> None:
        strange = [axis for axis in axes if axis not in self.clients]
        if strange or not axes:
            raise BadInput(
                f"targets for the axes {', '.join(axes) or '(none)'}; the axes are: "
                f"{', '.join(self.clients)}"
            )


def check_inside(axis: str, targets: ArrayLike, status: Status) -> None:
    """Raise BadInput if any of an axis's targets (n,) is out of reach."""
    values = np.asarray(targets, np.float64)
    outside = (values < status.reach_min) | (values > status.reach_max)
    if outside.any():
        raise BadInput(
            f"axis {axis}: {values[outside][0]:g} {status.unit} cannot be reached: the range is "
            f"{status.reach_min:g} to {status.reach_max:g}; nothing was sent"
        )
