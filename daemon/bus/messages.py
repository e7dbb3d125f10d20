"""The messages on the bus, as classes. dehyst.daemon.bus.encoding turns them into bytes and back.

Every message is one map whose `schema` names its class and whose `version` counts the fields that
were added to it since 1: a reader takes any version, and passes over what it does not know. What
would break a reader gets another version in the key (dehyst.daemon.bus.keys). Displacements
are in the model's unit (named in the message) and count from the set-point origin; voltages are
the actuator's; times `_ns` are the controller's CLOCK_MONOTONIC unless said otherwise.
"""

import math
import secrets
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from dehyst.daemon.rings.status import Id, LoopStatus, Name, Unit, Version

MAX_POINTS = 16_384
"""Most points in one trajectory chunk."""
MAX_SAMPLES = 65_536
"""Most samples in one telemetry batch."""
MAX_AXES = 8
"""Most axes of one controller."""

Seq = Annotated[int, Meta(ge=0, le=2**62)]
Text = Annotated[str, Meta(max_length=500)]
LongText = Annotated[str, Meta(max_length=2000)]
Column = Annotated[bytes, Meta(max_length=8 * MAX_SAMPLES)]
Points = Annotated[bytes, Meta(max_length=8 * MAX_POINTS)]


def new_number() -> int:
    """A random number of 62 bits, never 0: of a client, a lease, a trajectory."""
    return secrets.randbits(62) | 1


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base of all messages. A reader passes over fields that it does not know."""


class Setpoint(Message, tag_field="schema", tag="dehyst.setpoint", frozen=True, kw_only=True):
    """One set-point: go to `value` and stay for setpoint.stale_s (with `stay`, until another
    command)."""

    version: Version = 2
    client: Id
    lease: Id
    """The number that the daemon issued with the lease; it proves that this is not a replay."""
    sequence: Id
    """Ascending within a lease; the daemon refuses an older or repeated number."""
    sent_ns: int
    value: float
    unit: Unit
    allow_unreachable: bool = False
    """True: go to the nearest reachable point and flag it instead of refusing."""
    stay: bool = False
    """True: stay until another command, with this client gone; refused unless setpoint.stay of the
    daemon's configuration allows it."""


class Chunk(Message, tag_field="schema", tag="dehyst.trajectory", frozen=True, kw_only=True):
    """The next points of a timed trajectory."""

    version: Version = 1
    client: Id
    lease: Id
    trajectory: Id
    index: Id
    """0, 1, 2 ... without gaps; 0 begins the trajectory."""
    sent_ns: int
    unit: Unit
    offset_ns: Points
    """int64 little-endian: time since the trajectory's start, not negative, strictly increasing
    within a chunk and from chunk to chunk."""
    value: Points
    """float64 little-endian: target of each point."""
    correction: Points = b""
    """float64 little-endian: what was learned for each point and is added to its target, which
    stays the target that errors count from; empty (the default): 0 for every point."""
    last: bool = False
    allow_unreachable: bool = False
    axes: Annotated[tuple[Name, ...], Meta(max_length=MAX_AXES)] = ()
    """Names of the axes that play a trajectory of this number together, this one among them: they
    are followed on the same samples. Empty: it is played alone."""


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
    voltage), hold (keep the present voltage for setpoint.hold_s, with `stay` until another
    command), release (ramp now), clear (forget what is queued of `trajectory`). Gauge: zero (add
    `value` to every reading from now on). Model: accept (put the doctor's offer to work, on
    trial), reject (decline this offer; if it is in use, return to the model before it)."""

    version: Version = 2
    client: Id
    lease: Id = 0
    sent_ns: int
    action: Action
    trajectory: Id = 0
    value: float = 0.0
    stay: bool = False
    """hold: until another command, with this client gone."""
    offer: Id = 0
    """Number of the offer that is accepted or rejected."""
    label: Name = ""
    """Name of this client, for other clients that are refused."""
    axes: Annotated[tuple[Name, ...], Meta(max_length=MAX_AXES)] = ()
    """Names of axes of this controller that are meant together, the asked one among them: a lease
    is for all of them, under one number, or for none; stop and release are for all. Empty: the
    asked one."""


class HistoryRequest(Message, tag_field="schema", tag="dehyst.history", frozen=True, kw_only=True):
    """Samples first_seq <= seq < end_seq; or, with seconds > 0, the last seconds."""

    version: Version = 1
    first_seq: Seq = 0
    end_seq: Seq = 2**62
    seconds: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    run: Id = 0
    """Run of the loop that the sequence numbers belong to; 0 (no run has this number): the
    current one. For a run that is over the answer is one batch with count 0."""


class Reply(Message, tag_field="schema", tag="dehyst.reply", frozen=True, kw_only=True):
    """Answer to a command."""

    version: Version = 1
    ok: bool
    code: Name = "ok"
    """Short reason: see the table of codes."""
    text: Text = ""
    """The same in words."""
    lease: Id = 0
    """In the answer to a request by the holder of the lease: the number to put into every command;
    0 in every other answer."""
    lease_s: float = 0.0
    """The lease ends this long after the last command or renewal."""
    queue_s: float = 0.0
    """Upper bound of the trajectory time that is still queued."""
    telemetry_seq: int = -1
    """Sequence number of the newest sample when the command was passed to the loop."""


class Rejection(Message, tag_field="schema", tag="dehyst.rejection", frozen=True, kw_only=True):
    """Commands that were refused, reported to all clients; `count` since the last such message."""

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
    """The newest events that the daemon still keeps, oldest first."""

    version: Version = 1
    events: Annotated[tuple[Event, ...], Meta(max_length=256)]


class FoundEffect(Message, frozen=True, kw_only=True):
    """One finding of the doctor: names and sentences as in diagnosis.json."""

    name: Name
    acts_on: Name
    share: float
    """Part of the explainable misfit."""
    ambiguous_with: tuple[Name, ...] = ()
    says: LongText


class ModelOffer(Message, frozen=True, kw_only=True):
    """The augmented model, tested on telemetry to which it was not fitted."""

    number: Id
    """Number of the offer, for accept and reject."""
    seconds: float
    """Length of that telemetry."""
    rms_in_use: float
    rms_offered: float
    noise: float
    trial_s: float
    """Once accepted, it is withdrawn if the error has not fallen after this time of motion."""
    trial_limit_s: float = 0.0
    """The trial ends after this time, whether the stage moves or not; 0: not known."""
    blocks: tuple[Name, ...] = ()
    """Kinds of the blocks that it has in addition to the hysteresis."""
    reach_in_use: tuple[float, float] | None = None
    """Displacements of the model in use within the axis' limits, not shifted by origin and trim."""
    reach_offered: tuple[float, float] | None = None
    """Displacements of the offered model, likewise."""
    rate_in_use: float | None = None
    """Largest rate that the model in use knows [drive unit / s]; None: not known, no bound."""
    rate_offered: float | None = None
    """Largest rate of the offered model, likewise."""


DoctorState = Literal[
    "working", "found", "failed", "waiting", "trial", "accepted", "returned", "rejected"
]


class DoctorReport(Message, tag_field="schema", tag="dehyst.doctor", frozen=True, kw_only=True):
    """What the doctor found about one mismatch. Published when it changes, kept, and returned by
    `rpc/doctor`; `rpc/report` returns the report itself (HTML).

    state: working; found; failed (`says` why); then of its offer: waiting (until another one's
    trial is over), trial (at work, not confirmed), accepted (confirmed), returned (went back by
    itself), rejected."""

    version: Version = 1
    case: Name
    time_ns: int
    wall_ns: int
    """The same moment, ns since 1970."""
    changed_wall_ns: int
    """When the state changed, ns since 1970."""
    state: Name
    verdict: Name = ""
    """clean, explained, partly, unknown; or gauge: the gauge fails, and nothing is offered."""
    says: LongText = ""
    effects: Annotated[tuple[FoundEffect, ...], Meta(max_length=32)] = ()
    unit: Unit = ""
    noise: float = 0.0
    rms_in_use: float = 0.0
    """Residual of the model in use on the recording, rms."""
    rms_augmented: float = 0.0
    rms_when_good: float = -1.0
    """Residual of the model in use on the last good recording, rms; below 0: there was none."""
    has_report: bool = False
    offer: ModelOffer | None = None
    experiment: Annotated[tuple[Text, ...], Meta(max_length=64)] = ()
    """The next experiment if the recording cannot decide: arguments of `dehyst`, ready to run."""


class DoctorReports(
    Message, tag_field="schema", tag="dehyst.doctor-reports", frozen=True, kw_only=True
):
    """The newest reports, the newest last."""

    version: Version = 1
    reports: Annotated[tuple[DoctorReport, ...], Meta(max_length=64)]


class TelemetryBatch(
    Message, tag_field="schema", tag="dehyst.telemetry", frozen=True, kw_only=True
):
    """`count` samples with the sequence numbers first_seq, first_seq + 1 ... Columns as in
    docs/topics.md; displacements in `unit`, voltages in V."""

    version: Version = 1
    run: Id
    """Number of the loop's run. Another number: the loop was restarted, and the sequence numbers
    begin at 0 again."""
    unit: Unit
    wall_offset_ns: int
    """Wall clock minus the monotonic clock that this message uses."""
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
    """Overwritten in the ring before the gateway read them."""
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
    """Names (as in keys) of all axes of this controller; empty if it has only one."""
    links: int = 0
    """Clients and routers that are connected now."""
    links_ended: int = 0
    """Connections that have ended: by the other side, its silence, or because it did not read."""
    log_dropped: int = 0
    """Lines that processes of this daemon could not write to their log since it was started."""
    starts_refused: int = 0
    """Number of earlier starts that failed, because its address was in use for example."""
    unreachable_s: float = 0.0
    """Time from the first of these until the gateway started; no client could reach the daemon."""
    refused_because: Text = ""
    """Error message of the last of these attempts."""
    health: float = 0.0
    """Misfit over the largest expected misfit: below 1 the stage behaves like its model; below 0
    the watch is still learning (-0.4: 40 % of the required motion is still missing)."""
    mismatch: Name = ""
    """Figure by which the stage differs from its model (gain, offset, whole, all, ringing, short
    or fit), or stuck: the gauge repeats one value; "": it does not differ."""
    trial: Text = ""
    """Progress of the trial of an accepted model, in words; "": none is on trial."""
    target: float = math.nan
    """Of the newest sample, from the set-point origin; NaN: none."""
    measured: float = math.nan
    """Mean reading of the last 0.1 s, from the set-point origin; NaN: no valid reading."""


class Status(LoopStatus, tag_field="schema", tag="dehyst.status", frozen=True, kw_only=True):
    """State of the loop, as it was written last: once a second, and when the state changes."""

    version: Version = 2
    gateway: GatewayStatus


Command = Setpoint | Chunk | Request
