"""Table of everything published on the bus: subject, message, rate, quality of service.

Everything is reliable on the wire, but nothing that is published waits for a slow subscriber: what
it has not read stays on its own link, and when that is full, what is new is lost there. A
subscriber detects lost telemetry from the sequence numbers, and can request the missing samples
(`history`). Status and events are rare: they fill a link only if nothing is read, and the system
ends such a link after three seconds. Commands are small and have the highest priority; their
sender waits.
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Topic:
    """One topic. subject: the chunk in the key, where `{unit}` is replaced by the model's
    displacement unit; full: what happens at a full link ("drop": the message is lost there, "wait":
    the sender waits); priority: zenoh's name; express: sent at once, alone. Others share a batch
    with what is waiting, so that a burst does not fill the link."""

    subject: str
    full: Literal["drop", "wait"]
    priority: Literal["REAL_TIME", "INTERACTIVE_HIGH", "DATA_HIGH", "DATA", "DATA_LOW"]
    express: bool


# Setpoint, as sent by a client
SETPOINT = Topic("setpoint_{unit}", full="wait", priority="REAL_TIME", express=True)
# TelemetryBatch, every telemetry.batch_s
TELEMETRY = Topic("telemetry", full="drop", priority="DATA", express=False)
# Status, 1 Hz and at changes
STATUS = Topic("status", full="drop", priority="DATA_HIGH", express=False)
# Event, when it happens
EVENT = Topic("event", full="drop", priority="DATA_HIGH", express=False)
# DoctorReport, when the doctor starts, when it has findings, and when its offer is decided
DOCTOR = Topic("doctor", full="drop", priority="DATA_HIGH", express=False)
# Rejection, at most 10 Hz
REJECTION = Topic("rejection", full="drop", priority="DATA_LOW", express=False)


def subject(topic: Topic, unit: str = "um") -> str:
    """Return the topic's chunk in the key."""
    return topic.subject.format(unit=unit)
