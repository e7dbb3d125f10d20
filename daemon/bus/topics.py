"""Table of everything published on the bus: subject, message, rate, quality of service.

Telemetry is reliable on the wire but never waits for a slow subscriber: a subscriber that does
not read loses batches on its own link, detects this from the sequence numbers, and can request the
missing samples (`history`). Status and events are rare: a subscriber that does not read them for
two seconds loses its link, and no other client waits for it. Commands are small and have the
highest priority.
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Topic:
    """One topic. subject: the chunk in the key, where `{unit}` is replaced by the model's
    displacement unit; full: what happens at a full link ("drop": the message is lost there, "wait":
    the sender waits, "close": the sender does not wait, and a link that stays full is closed);
    priority: zenoh's name; express: sent at once instead of being batched."""

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
# DoctorReport, when the doctor starts, when it has findings, and when its offer is decided
DOCTOR = Topic("doctor", full="close", priority="DATA_HIGH", express=True)
# Rejection, at most 10 Hz
REJECTION = Topic("rejection", full="drop", priority="DATA_LOW", express=False)


def subject(topic: Topic, unit: str = "um") -> str:
    """Return the topic's chunk in the key."""
    return topic.subject.format(unit=unit)
