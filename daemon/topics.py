"""One table of everything that goes over the bus: subject, message, rate, quality of service.

Telemetry is reliable on the wire but never waits for a slow subscriber: a subscriber that does
not read loses batches on its own link, sees that from the sequence numbers, and can ask for the
missing samples (`history`). Status and events are few and never dropped: a subscriber that does
not take them for two seconds loses its link. Commands go first: they are small and have the
highest priority.
"""

from dataclasses import dataclass
from typing import Literal

from dehyst.daemon import messages


@dataclass(frozen=True)
class Topic:
    """subject: the chunk in the key, `{unit}` stands for the model's displacement unit;
    message: class in dehyst.daemon.wire; rate: how often, in words for the README;
    decimation: one sample in how many goes out (0: not sampled data);
    block: a full link makes the publisher wait instead of dropping; priority: zenoh's name;
    express: not held back to be batched with others."""

    subject: str
    message: type
    rate: str
    decimation: int
    block: bool
    priority: Literal["REAL_TIME", "INTERACTIVE_HIGH", "DATA_HIGH", "DATA", "DATA_LOW"]
    express: bool


SETPOINT = Topic(
    "setpoint_{unit}", messages.Setpoint, "as sent by a client", 0, True, "REAL_TIME", True
)
TELEMETRY = Topic(
    "telemetry", messages.TelemetryBatch, "every telemetry.batch_s", 1, False, "DATA", False
)
STATUS = Topic("status", messages.Status, "1 Hz and at changes", 0, True, "DATA_HIGH", False)
EVENT = Topic("event", messages.Event, "when it happens", 0, True, "DATA_HIGH", True)
REJECTION = Topic("rejection", messages.Rejection, "at most 10 Hz", 0, False, "DATA_LOW", False)

TOPICS = (SETPOINT, TELEMETRY, STATUS, EVENT, REJECTION)


def subject(topic: Topic, unit: str = "um") -> str:
    """The topic's chunk in the key."""
    return topic.subject.format(unit=unit)
