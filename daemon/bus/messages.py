"""The messages on the bus, as classes. dehyst.daemon.bus.encoding converts them to bytes and back.

Every message is one map whose `schema` names its class and whose `version` is incremented when
fields are added: a reader accepts any version and ignores unknown fields. A change that would break
readers gets a new version in the key (dehyst.daemon.bus.keys). Displacements are in the model's
unit (named in the message), relative to the set-point origin; voltages are the actuator's; times
`_ns` are the controller's CLOCK_MONOTONIC unless stated otherwise.
"""

import math
import secrets
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from dehyst.daemon.rings.status import Id, LoopStatus, Name, Unit, Version

MAX_POINTS = 16_384
"""Most points in one trajectory chunk: 0.25 s, what the player sends at a time, at 65 kHz."""
MAX_SAMPLES = 65_536
"""Most samples in one telemetry batch."""
MAX_AXES = 8
"""Most axes of one controller, which one process moves in turn: a hexapod has six."""

Chosen = Annotated[int, Meta(ge=1, le=2**63 - 1)]
"""The number of a client or of a trajectory, chosen at random by its sender; 0 is none."""
Seq = Annotated[int, Meta(ge=0, le=2**62)]
Text = Annotated[str, Meta(max_length=500)]
LongText = Annotated[str, Meta(max_length=2000)]
Column = Annotated[bytes, Meta(max_length=8 * MAX_SAMPLES)]
Points = Annotated[bytes, Meta(max_length=8 * MAX_POINTS)]


def new_number() -> int:
    """Return a random 62-bit number, never 0, for a client, a lease or a trajectory."""
    return secrets.randbits(62) | 1


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base of all messages. Readers ignore unknown fields."""


class Setpoint(Message, tag_field="schema", tag="dehyst.setpoint", frozen=True, kw_only=True):
    """One set-point: go to `value` and stay for setpoint.stale_s (with `stay`, until the next
    command)."""

    version: Version = 2
    client: Chosen
    lease: Id
    """The number that the daemon issued with the lease; it protects against replayed commands."""
    sequence: Id
    """Increases within a lease; the daemon refuses an older or repeated number."""
    sent_ns: int
    value: float
    unit: Unit
    allow_unreachable: bool = False
    """True: go to the nearest reachable point and flag it instead of refusing."""
    stay: bool = False
    """True: stay until the next command, even after this client has disconnected; refused unless
    setpoint.stay of the daemon's configuration allows it."""


class Chunk(Message, tag_field="schema", tag="dehyst.trajectory", frozen=True, kw_only=True):
    """The next points of a timed trajectory."""

    version: Version = 1
    client: Chosen
    lease: Id
    trajectory: Chosen
    index: Id
    """0, 1, 2 ... without gaps; 0 starts the trajectory."""
    sent_ns: int
    unit: Unit
    offset_ns: Points
    """int64 little-endian: time since the trajectory's start, non-negative, strictly increasing
    within a chunk and from chunk to chunk."""
    value: Points
    """float64 little-endian: target of each point."""
    correction: Points = b""
    """float64 little-endian: learned correction of each point, added to its target; errors are
    still relative to the uncorrected target; empty (the default): 0 for every point."""
    last: bool = False
    allow_unreachable: bool = False
    axes: Annotated[tuple[Name, ...], Meta(max_length=MAX_AXES)] = ()
    """Names of the axes that play the trajectory with this number together on the same samples,
    including this axis. Empty: this axis plays alone."""


Action = Literal[
    "acquire",
    "take-over",
    "renew",
    "give-up",
    "stop",
    "hold",
    "release",
    "clear",
    "zero",
    "accept",
    "reject",
]


class Request(Message, tag_field="schema", tag="dehyst.request", frozen=True, kw_only=True):
    """Lease: acquire, take-over, renew, give-up. Motion: stop (hold, then ramp to the safe
    voltage), hold (keep the present voltage for setpoint.hold_s, with `stay` until the next
    command), release (ramp now), clear (discard the queued points of `trajectory`). Gauge: zero
    (add `value` to every reading from now on). Model: accept (use the doctor's offer, on trial),
    reject (decline this offer; if it is in use, restore the previous model)."""

    version: Version = 2
    client: Chosen
    lease: Id = 0
    sent_ns: int
    action: Action
    trajectory: Id = 0
    value: float = 0.0
    stay: bool = False
    """hold: until the next command, even after this client has disconnected."""
    offer: Id = 0
    """Number of the offer to accept or reject."""
    label: Name = ""
    """Name of this client, shown to other clients that are refused."""
    axes: Annotated[tuple[Name, ...], Meta(max_length=MAX_AXES)] = ()
    """Names of the controller's axes that the request is for, including the axis that it is sent
    to: a lease is given for all of them, under one number, or for none; stop and release apply to
    all. Empty: only the axis that it is sent to."""


class HistoryRequest(Message, tag_field="schema", tag="dehyst.history", frozen=True, kw_only=True):
    """Requests samples first_seq <= seq < end_seq; or, if seconds > 0, the last `seconds`."""

    version: Version = 1
    first_seq: Seq = 0
    end_seq: Seq = 2**62
    seconds: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    run: Id = 0
    """Run of the loop that the sequence numbers belong to; 0 (no run has this number): the current
    one. For a run that has ended, the answer is one batch with count 0."""


class Reply(Message, tag_field="schema", tag="dehyst.reply", frozen=True, kw_only=True):
    """Answer to a command."""

    version: Version = 1
    ok: bool
    code: Name = "ok"
    """Short reason: see the table of codes."""
    text: Text = ""
    """The same in words."""
    lease: Id = 0
    """In answers to requests of the lease's holder: the number to put into every command; 0 in all
    other answers."""
    lease_s: float = 0.0
    """The lease ends this long after the last command or renewal."""
    queue_s: float = 0.0
    """Upper limit of the trajectory time still queued."""
    telemetry_seq: int = -1
    """Sequence number of the newest sample when the command was passed to the loop."""


class Rejection(Message, tag_field="schema", tag="dehyst.rejection", frozen=True, kw_only=True):
    """Refused commands, reported to all clients; `count`: since the last such message."""

    version: Version = 1
    time_ns: int
    client: Id
    code: Name
    text: Text
    count: int


class Event(Message, tag_field="schema", tag="dehyst.event", frozen=True, kw_only=True):
    """An event, in words. level: 1 information, 2 warning, 3 error."""

    version: Version = 1
    time_ns: int
    wall_ns: int
    level: int
    code: Name
    text: Text


class RecentEvents(
    Message, tag_field="schema", tag="dehyst.recent-events", frozen=True, kw_only=True
):
    """The latest events that the daemon has kept, oldest first."""

    version: Version = 1
    events: Annotated[tuple[Event, ...], Meta(max_length=256)]


class FoundEffect(Message, frozen=True, kw_only=True):
    """One finding of the doctor: names and sentences as in diagnosis.json."""

    name: Name
    acts_on: Name
    share: float
    """Fraction of the explainable misfit."""
    ambiguous_with: tuple[Name, ...] = ()
    says: LongText


class ModelOffer(Message, frozen=True, kw_only=True):
    """The augmented model, tested on held-out telemetry."""

    number: Id
    """Number of the offer, for accept and reject."""
    seconds: float
    """Length of the held-out telemetry."""
    rms_in_use: float
    rms_offered: float
    noise: float
    trial_s: float
    """Once accepted, it is withdrawn if the error has not fallen after this much time in motion."""
    trial_limit_s: float = 0.0
    """The trial ends after this time, whether the stage moves or not; 0: unknown."""
    blocks: tuple[Name, ...] = ()
    """Kinds of its blocks in addition to the hysteresis."""
    reach_in_use: tuple[float, float] | None = None
    """Displacement range of the model in use within the axis's limits, without origin and trim."""
    reach_offered: tuple[float, float] | None = None
    """Displacement range of the offered model, likewise."""
    rate_in_use: float | None = None
    """Largest rate covered by the model in use [drive unit / s]; None: unknown, no limit."""
    rate_offered: float | None = None
    """Largest rate covered by the offered model, likewise."""


DoctorState = Literal[
    "working", "found", "failed", "waiting", "trial", "accepted", "returned", "rejected"
]


class DoctorReport(Message, tag_field="schema", tag="dehyst.doctor", frozen=True, kw_only=True):
    """The doctor's findings about one mismatch. Published when they change, kept, and returned by
    `rpc/doctor`; `rpc/report` returns the full report (HTML).

    state: working; found; failed (`says` gives the reason); then the state of its offer: waiting
    (until another trial is over), trial (in use, not confirmed), accepted (confirmed), returned
    (the trial ended with the previous model restored), rejected."""

    version: Version = 1
    case: Name
    time_ns: int
    wall_ns: int
    """The same moment, ns since 1970."""
    changed_wall_ns: int
    """Time of the last change of state, ns since 1970."""
    state: Name
    verdict: Name = ""
    """clean, explained, partly, unknown; or gauge: the gauge is faulty, and no model is offered."""
    says: LongText = ""
    effects: Annotated[tuple[FoundEffect, ...], Meta(max_length=32)] = ()
    unit: Unit = ""
    noise: float = 0.0
    rms_in_use: float = 0.0
    """Residual of the model in use on the recording, rms."""
    rms_augmented: float = 0.0
    rms_when_good: float = -1.0
    """Residual of the model in use on the last good recording, rms; below 0: no such recording."""
    has_report: bool = False
    offer: ModelOffer | None = None
    experiment: Annotated[tuple[Text, ...], Meta(max_length=64)] = ()
    """The next experiment if the recording is inconclusive: arguments of `dehyst`, ready to run."""


class DoctorReports(
    Message, tag_field="schema", tag="dehyst.doctor-reports", frozen=True, kw_only=True
):
    """The latest reports, newest last."""

    version: Version = 1
    reports: Annotated[tuple[DoctorReport, ...], Meta(max_length=64)]


class TelemetryBatch(
    Message, tag_field="schema", tag="dehyst.telemetry", frozen=True, kw_only=True
):
    """`count` samples with the sequence numbers first_seq, first_seq + 1 ... The columns are
    described in docs/topics.md; displacements are in `unit`, voltages in V."""

    version: Version = 1
    run: Id
    """Number of the loop's run. It changes when the loop is restarted; sequence numbers then begin
    at 0 again."""
    unit: Unit
    wall_offset_ns: int
    """Wall clock minus the monotonic clock used in this message."""
    first_seq: Seq
    count: Annotated[int, Meta(ge=0, le=MAX_SAMPLES)]
    scheduled_ns: Column
    actual_ns: Column
    target: Column
    measured: Column
    predicted: Column
    trim: Column
    learned: Column
    volts_raw: Column
    volts: Column
    flags: Column
    state: Column
    mode: Column
    cause: Column
    io_us: Column
    exec_us: Column


class GatewayStatus(Message, frozen=True, kw_only=True):
    """Status of the gateway's process."""

    pid: int
    uptime_s: float
    samples_published: int
    samples_lost: int
    """Samples overwritten in the ring before the gateway read them."""
    commands: int
    rejected: dict[str, int]
    """Refused commands by code."""
    lease_client: Id
    lease_label: Name
    lease_left_s: float
    history_s: float
    """How far back the history reaches now."""
    restarts_of_core: int
    controller: Name = ""
    """Name of the controller; with a single axis, that of the daemon."""
    axes: Annotated[tuple[Name, ...], Meta(max_length=MAX_AXES)] = ()
    """Names (as in keys) of all axes of this controller; empty for a single unnamed axis."""
    links: int = 0
    """Clients and routers connected now."""
    links_ended: int = 0
    """Connections that have ended: closed by the other side, or because it was silent or did not
    read."""
    log_dropped: int = 0
    """Log lines that processes of this daemon could not write since it was started."""
    starts_refused: int = 0
    """Number of earlier starts that failed, for example because the address was in use."""
    unreachable_s: float = 0.0
    """Time from the first failed start until the gateway started, during which no client could
    reach the daemon."""
    refused_because: Text = ""
    """Error message of the last failed start."""
    health: float = 0.0
    """Misfit divided by the largest expected misfit: below 1 the stage behaves like its model;
    below 0 the watch is still learning (-0.4: 40 % of the required motion is still missing)."""
    mismatch: Name = ""
    """Figure by which the stage differs from its model (gain, offset, whole, all, ringing, short
    or fit), or stuck: the gauge repeats one value, or silent: the gauge gives no valid readings;
    "": it does not differ."""
    trial: Text = ""
    """Progress of the trial of an accepted model, in words; "": no model is on trial."""
    target: float = math.nan
    """Target of the newest sample, from the set-point origin; NaN: none."""
    measured: float = math.nan
    """Mean reading of the last 0.1 s, from the set-point origin; NaN: no valid reading."""


class Status(LoopStatus, tag_field="schema", tag="dehyst.status", frozen=True, kw_only=True):
    """Latest state of the loop: published once per second, and when the state changes."""

    version: Version = 2
    gateway: GatewayStatus


Command = Setpoint | Chunk | Request
