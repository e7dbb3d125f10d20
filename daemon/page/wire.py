"""The messages between server and browser over the WebSocket.

The browser sends strictly checked JSON. The server sends JSON with a `kind`, and plots as binary
frames, little-endian: magic u32, n u32, anew u32, level u32, time of bucket 0 of the frame [s,
monotonic] f64, length of a bucket [s] f64, wall clock minus monotonic clock [s] f64, then n offsets
in buckets i32, then for each signal of dehyst.daemon.page.buckets n least and n largest values f32.
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from dehyst.daemon.client.offer_change import describe_change
from dehyst.daemon.page.buckets import FINEST_NS, BucketPiece
from dehyst.daemon.page.commanding import LONGEST_S
from dehyst.daemon.page.trail import POINT_NS, join_trails
from dehyst.daemon.page.wakeups import edges_us
from dehyst.daemon.page.watching import Controllers, Watch
from dehyst.daemon.rings.status import is_starting
from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Model
from dehyst.models.units import spell_unit

PROTOCOL = 1
"""Version of the WebSocket protocol (docs/websocket.md), raised by changes that break clients."""
MAGIC_LIVE, MAGIC_PAST = 0x31504844, 0x32504844
MOST_REPORTS, LOOP_POINTS = 10, 61  # newest ones sent; points of a branch of the loop
Name = Annotated[str, Meta(max_length=64)]
Seconds = Annotated[float, Meta(gt=0, le=LONGEST_S)]


class _Ask(msgspec.Struct, tag_field="ask", forbid_unknown_fields=True, frozen=True):
    pass


class Look(_Ask, tag="look", frozen=True):
    """Show this controller: the last window_s [s] on width_px pixels."""

    name: Name
    window_s: Annotated[float, Meta(ge=0.1, le=3600)]
    width_px: Annotated[int, Meta(ge=50, le=8192)]


class Past(_Ask, tag="past", frozen=True):
    """Show a past interval once, in monotonic seconds, at the finest resolution still kept."""

    first_s: Annotated[float, Meta(ge=0, le=1e12)]
    end_s: Annotated[float, Meta(ge=0, le=1e12)]
    width_px: Annotated[int, Meta(ge=50, le=8192)]


class Go(_Ask, tag="go", frozen=True):
    """Go to a set-point and stay there for `seconds`."""

    value: float
    seconds: Seconds
    take_over: bool = False
    name: str = ""
    """Axis of the shown controller, by its name on the bus; empty: the shown axis."""


class HoldAsked(_Ask, tag="hold", frozen=True):
    """Stay at the present target for `seconds`; everywhere: all axes of the controller."""

    seconds: Seconds
    take_over: bool = False
    everywhere: bool = False


class Play(_Ask, tag="play", frozen=True):
    """Play a trajectory that was uploaded and checked."""

    job: Name
    take_over: bool = False


class Stop(_Ask, tag="stop", frozen=True):
    """Drop all targets: hold, then ramp; at_once: ramp now."""

    at_once: bool = False


class DecideOffer(_Ask, tag="decide", frozen=True):
    """Accept or reject the doctor's offer with this number (text, since a browser's numbers have
    too few bits). confirmed: also if the playing trajectory may leave the new reach."""

    action: Literal["accept", "reject"]
    offer: Annotated[str, Meta(pattern=r"^[0-9]{1,19}$")]
    confirmed: bool = False


Ask = Look | Past | Go | HoldAsked | Play | Stop | DecideOffer
ASK: msgspec.json.Decoder[Ask] = msgspec.json.Decoder(Ask)


def read_ask(message: Mapping[str, Any]) -> Ask:
    """Decode a message of a browser. Raises BadInput if it is not a known request."""
    text = message.get("text")
    if text is None:
        raise BadInput("not understood: a message must be text")
    try:
        return ASK.decode(text)
    except msgspec.MsgspecError as error:
        raise BadInput(f"not understood: {error}") from None
    except RecursionError:
        raise BadInput("not understood: it is nested too deeply") from None


def plot_frame(
    piece: BucketPiece, level: int, wall_offset_ns: int, magic: int = MAGIC_LIVE
) -> bytes:
    """Return a binary frame."""
    bucket_s = (FINEST_NS << level) * 1e-9
    first = int(piece.number[0]) if piece.number.size else 0
    times = first * bucket_s, bucket_s, wall_offset_ns * 1e-9
    head = struct.pack("<IIIIddd", magic, piece.number.size, int(piece.anew), level, *times)
    both = np.stack([piece.least.T, piece.largest.T], axis=1)  # (signals, 2, n)
    offsets = (piece.number - first).astype("<i4")
    return head + offsets.tobytes() + np.ascontiguousarray(both, "<f4").tobytes()


def encode_view(kind: str, **fields: Any) -> str:
    """Return a JSON message; NaN becomes null."""
    return msgspec.json.encode({"kind": kind, **fields}).decode()


def describe_controllers(controllers: Controllers) -> str:
    """Return the message with the known controllers, and why others cannot be reached."""
    return encode_view(
        "controllers",
        protocol=PROTOCOL,
        names=sorted(controllers.watches),
        problems=[text for text in controllers.problems.values() if text],
        silent=sorted(n for n, w in controllers.watches.items() if w.silent),
    )


def describe_status(watch: Watch) -> str:
    """Return the message with all present values of one controller."""
    with watch.lock:
        wakeups, newest_ns = watch.wakeups.counts(), watch.buckets.newest_ns
    newest = watch.newest
    rms, most = watch.error()
    return encode_view(
        "status",
        name=watch.name,
        status=watch.status,
        problem=watch.problem,
        silent_s=round(min(watch.silent_s, 1e6), 1),
        wall_offset_s=watch.wall_offset_ns * 1e-9,
        newest_s=newest_ns * 1e-9,
        state="" if watch.status is None else _state(watch),
        target=None if newest is None else float(newest["target"]),
        measured=None if newest is None else float(newest["measured"]),
        error_rms=rms,
        error_max=most,
        trim=None if newest is None else float(newest["trim"]),
        learned=None if newest is None else float(newest["learned"]),
        flags=0 if newest is None else int(newest["flags"]),
        lost=watch.lost,
        wakeups=wakeups,
        healths=list(watch.healths),
        changes=watch.changes,
    )


def describe_axes(axes: Sequence[Watch], path: int) -> tuple[str, int]:
    """Return the message with all axes of a controller and their paths since point number `path`,
    and the number of the newest point."""
    pieces = []
    for watch in axes:
        with watch.lock:
            pieces.append(watch.trail.since(path))
    pieces = join_trails(pieces)
    newest = int(pieces[0].number[-1]) if pieces and pieces[0].number.size else path
    said = encode_view(
        "axes",
        controller=axes[0].status.gateway.controller if axes and axes[0].status else "",
        anew=path < 0,
        point_s=POINT_NS * 1e-9,
        number=[] if not pieces else pieces[0].number.tolist(),
        axes=[
            _axis(watch) | {"way": [piece.target.tolist(), piece.measured.tolist()]}
            for watch, piece in zip(axes, pieces, strict=True)
        ],
    )
    return said, newest


def _state(watch: Watch) -> str:
    """Return the state of the loop in a word or two; "silent" without a recent status."""
    status = watch.status
    if status is None or watch.silent:
        return "silent"
    if is_starting(status):
        return "starting"
    return status.state if status.core_alive else "no loop"


def _axis(watch: Watch) -> dict[str, Any]:
    status, newest = watch.status, watch.newest
    if status is None:
        return {"name": watch.name, "state": watch.problem}
    return {
        "name": watch.name,
        "axis": watch.name.removeprefix(f"{status.gateway.controller}-"),
        "unit": status.unit,
        "state": _state(watch),
        "reach": [status.reach_min, status.reach_max],
        "target": None if newest is None else float(newest["target"]),
        "measured": None if newest is None else float(newest["measured"]),
        "error": watch.error()[0],
        "volts": None if newest is None else float(newest["volts"]),
        "commander": status.gateway.lease_label,
        "mismatch": status.gateway.mismatch,
    }


def encode_doctor_reports(watch: Watch) -> str:
    """Return the message with the doctor's reports, newest last. Numbers of offers are text, and
    `change` describes what accepting an offer changes."""
    reports = []
    for one in watch.doctor.values():
        plain = msgspec.to_builtins(one)
        if one.offer is not None:
            plain["offer"]["number"] = str(one.offer.number)
            if watch.status is not None:
                plain["offer"]["change"] = describe_change(one.offer, watch.status)
        reports.append(plain)
    return encode_view("doctor", name=watch.name, reports=reports[-MOST_REPORTS:])


def describe_model(watch: Watch) -> str:
    """Return the message with the model in use, and the limits that the page needs."""
    model, config = watch.model, watch.config
    return encode_view(
        "model",
        name=watch.name,
        model=None if model is None else _model(model),
        limits=None if config is None else config.limits,
        setpoint=None if config is None else config.setpoint,
        wakeup_edges_us=edges_us(),
    )


def loops_for_picture(model: Model) -> dict[str, list[float]]:
    """Return the model's slow loops for a picture: over the full range, and over half the range
    about its middle."""
    v = model.validity
    middle, half = 0.5 * (v.drive_min + v.drive_max), 0.5 * (v.drive_max - v.drive_min)
    phase = np.linspace(0.0, 2.0 * np.pi, LOOP_POINTS)
    drive = np.concatenate(
        [middle - share * half * np.cos(phase) for share in (1.0, 1.0, 0.5, 0.5)]
    )
    y = simulate_hysteresis(model.hysteresis, drive, 1e9)
    shown = np.r_[LOOP_POINTS : 2 * LOOP_POINTS, 3 * LOOP_POINTS : 4 * LOOP_POINTS]
    return {"drive": np.round(drive[shown], 6).tolist(), "displacement": y[shown].tolist()}


def _model(model: Model) -> dict[str, Any]:
    h = model.hysteresis
    return {
        "operators": h.n,
        "rate_dependent": not h.static,
        "saturation": h.c.size - 1,
        "drive_unit": spell_unit(model.drive_unit),
        "displacement_unit": model.displacement_unit,
        "validity": vars(model.validity),
        "fit": vars(model.fit),
        "blocks": [
            {"kind": b.kind, "place": b.place, "params": dict(b.params)} for b in model.blocks
        ],
        "loop": loops_for_picture(model),
        "source": model.provenance.source,
        "created": model.provenance.created,
        "recordings": [name for name, _ in model.provenance.recordings],
    }
