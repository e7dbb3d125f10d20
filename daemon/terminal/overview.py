"""One screen about a controller: what `dehyst status` says. Pure: status, model and events in,
lines out."""

import math
from collections.abc import Sequence
from datetime import datetime

from dehyst.daemon.bus.messages import Event, Status
from dehyst.daemon.bus.printable import printable
from dehyst.daemon.rings.status import FROZEN, counts, positioning
from dehyst.models.model import Model

LEVELS = {1: "", 2: "warning: ", 3: "error: "}
EVENTS = 8
MOST_MISSED = 1e-3
"""Share of missed deadlines above which somebody should look."""
REASONS = {
    "start": "the devices are opened; the output stays as found",
    "ready": "nobody commands; the output stays",
    "running": "set-points or a trajectory arrive",
    "holding": "no set-point comes any more; the output stays, then ramps to its safe voltage",
    "fault": "a device does not answer, or contradicts what was written; nothing is written",
    "stopping": "it was asked to end",
}


def find_troubles(status: Status) -> list[str]:
    """What somebody should look at, in words; empty: all is well."""
    s, gateway, found = status, status.gateway, []
    if not s.core_alive:
        found.append("the loop's process says nothing: ended, killed or hanging")
    for name, ok, errors in (
        ("actuator", s.actuator_ok, s.actuator_errors),
        ("sensor", s.sensor_ok, s.sensor_errors),
    ):
        if not ok:
            found.append(f"the {name} does not answer ({errors} errors); it reconnects by itself")
    if s.state == "fault" and s.actuator_ok and s.sensor_ok:
        found.append("the loop is in the state fault; the events say why")
    if gateway.mismatch:
        found.append(
            f"the stage does not behave as its model ({gateway.mismatch}, {gateway.health:.2g} "
            "times the expected misfit): `dehyst doctor` says what has changed"
        )
    if s.trimmed and s.trim_frozen in FROZEN:
        found.append(f"the trim stands still: {FROZEN[s.trim_frozen]}")
    if s.missed > MOST_MISSED * max(1, s.samples):
        found.append(
            f"{100 * s.missed / max(1, s.samples):.2g} % of the deadlines were missed "
            f"({counts(s.missed_by)}): `dehyst latency` says what is too slow"
        )
    if gateway.samples_lost:
        found.append(f"{gateway.samples_lost} samples were lost before they were published")
    return found


def describe_health(status: Status) -> str:
    """The mismatch watch in words."""
    health = status.gateway.health
    if status.gateway.mismatch:
        return f"{health:.2f}, mismatch: {status.gateway.mismatch}"
    if health == 0:
        return "not judged yet"
    if health < 0:
        return f"not known yet: {-100 * health:.0f} % of the first motion is still to be seen"
    return f"{health:.2f} of the misfit that is expected at most: as its model"


def describe_kind(model: Model) -> str:
    """What kind of model, from when, and how good it says it is."""
    h, p, fit = model.hysteresis, model.provenance, model.fit
    words = [f"{'static' if h.static else 'rate-dependent'}, {h.n} play operators"]
    words += [f"{len(model.blocks)} further blocks"] * bool(model.blocks)
    words += [f"of {p.created}"] * bool(p.created)
    words += [f"from {', '.join(name for name, _ in p.recordings)}"] * bool(p.recordings)
    if fit.holdout_rms is not None:
        words.append(f"{fit.holdout_rms:.3g} {model.displacement_unit} rms held out")
    return ", ".join(words)


def overview(
    status: Status, model: Model | None, events: Sequence[Event], troubles: Sequence[str]
) -> list[str]:
    """The screen. model: None: not known."""
    s, g = status, status.gateway
    state = s.state if s.core_alive else "no loop"
    lines = [f"{s.name}: {state}: {REASONS.get(s.state, '') if s.core_alive else 'see below'}"]
    lines += [f"  ! {text}" for text in troubles]
    rows = {
        "position": f"{positioning(s)}; reach {s.reach_min:.4g} to {s.reach_max:.4g} {s.unit}",
        "output": f"{s.volts:.3f} V; actuator {_device(s.actuator_ok, s.actuator_errors)}, sensor "
        f"{_device(s.sensor_ok, s.sensor_errors)}",
        "model": "not known" if model is None else describe_kind(model),
        "inverse": s.mode + (f", {s.latency_s:.3g} s behind" if s.latency_s else ""),
        "deadline": f"{1e9 / s.period_ns:g} Hz, {s.missed} of {s.samples} missed; wake-up p99 "
        f"{s.wake_us.p99:.0f} us, I/O p99 {s.io_us.p99:.0f} us; {s.policy} {s.priority}",
        "health": describe_health(s),
        "command": f"{g.lease_label or 'nobody'}; {g.commands} commands, refused: "
        f"{counts(g.rejected)}",
        "bus": f"{g.links} connected, {g.samples_published} samples published, {g.samples_lost} "
        f"lost; up {_duration(g.uptime_s)}, the loop {g.restarts_of_core} times restarted",
        "software": f"dehyst {s.software}",
    }
    lines += [f"{name:9s} {text}" for name, text in rows.items()]
    for event in events[-EVENTS:]:
        when = datetime.fromtimestamp(event.wall_ns * 1e-9)
        level = LEVELS.get(event.level, "")
        lines.append(f"{when:%m-%d %H:%M:%S} {level}{event.code}: {event.text}")
    return [printable(line) for line in lines]


def _device(ok: bool, errors: int) -> str:
    return ("ok" if ok else "FAILED") + (f" ({errors} errors)" if errors else "")


def _duration(seconds: float) -> str:
    if not math.isfinite(seconds) or seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
