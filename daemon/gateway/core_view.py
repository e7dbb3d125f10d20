"""What the gateway knows of the loop, and whether the loop can be commanded now."""

from dataclasses import dataclass

from dehyst.daemon.bus.refusal_codes import NotAdmitted
from dehyst.daemon.rings.records import State

STARTING = "the loop is starting and follows no commands yet"
RESERVED = 64
"""Records of the command ring that trajectories leave free for a stop."""


@dataclass
class CoreView:
    """What the gateway knows of the loop."""

    alive: bool = False
    state: State = State.START
    reachable: tuple[float, float] = (float("nan"), float("nan"))
    queue_s: float = 0.0
    status_ns: int = 0
    trajectory: int = 0
    trajectory_done: bool = True
    period_ns: int = 1_000_000
    telemetry_seq: int = -1
    samples: int = 0

    @property
    def starting(self) -> bool:
        """Return whether the loop has not reached its first sample; it is silent while kernels are
        compiled."""
        return self.status_ns == 0 or (self.state is State.START and not self.samples)

    def check(self, room: int, records: int = 1) -> None:
        """Raise NotAdmitted if the loop cannot take this many records. room: free records in its
        command ring."""
        if not self.alive and self.starting:
            raise NotAdmitted("starting", STARTING)
        if not self.alive:
            raise NotAdmitted("no-core", "the loop's process does not run")
        if records > room - RESERVED * (records > 1):
            raise NotAdmitted("queue-full", "the loop does not take commands at present")

    def check_state(self, room: int, records: int = 1) -> None:
        """Same as check; also raise NotAdmitted if the loop's state follows no commands."""
        self.check(room, records)
        if self.state is State.START:
            raise NotAdmitted("starting", STARTING)
        if self.state in (State.FAULT, State.STOPPING):
            raise NotAdmitted(
                "state", f"in the state {self.state.name.lower()} the daemon follows no commands"
            )
