"""One table of everything that is published on the bus: subject, message, rate, quality of service.

Telemetry is reliable on the wire but never waits for a slow subscriber: a subscriber that does
not read loses batches on its own link, sees that from the sequence numbers, and can ask for the
missing samples (`history`). Status and events are few: a subscriber that does not take them for two
seconds loses its link, and nobody else waits for it. Commands go first: they are small and have
the highest priority.
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Topic:
    """subject: the chunk in the key, `{unit}` stands for the model's displacement unit; full: what
    happens at a link that is full ("drop": the message is lost there, "wait": the sender waits,
    "close": nobody waits, but a link that stays full is closed); priority: zenoh's name; express:
    not held back to be batched with others."""

    subject: str
    full: Literal["drop", "wait", "close"]
    priority: Literal["REAL_TIME", "INTERACTIVE_HIGH", "DATA_HIGH", "DATA", "DATA_LOW"]
    express: bool


# Setpoint, as sent by a client
SETPOINT = Topic("setpoint_{unit}", full="wait", priority="REAL_TIME", express=True)
# TelemetryBatch, every telemetry.batch_s
TELEMETRY = Topic("telemetry", full="drop", priority="DATA", express=False)
# Status, 1 Hz and at changes
STATUS = Topic("status", full="close", priority="DATA_HIGH", express=False)
# Event, when it happens
EVENT = Topic("event", full="close", priority="DATA_HIGH", express=True)
# DoctorReport, when the doctor has begun, has found, or its offer was decided
DOCTOR = Topic("doctor", full="close", priority="DATA_HIGH", express=True)
# Rejection, at most 10 Hz
REJECTION = Topic("rejection", full="drop", priority="DATA_LOW", express=False)


def subject(topic: Topic, unit: str = "um") -> str:
    """The topic's chunk in the key."""
    return topic.subject.format(unit=unit)
