"""Format the screen that `dehyst status` prints about a controller. Pure: takes status, model and
events; returns lines."""

import math
from collections.abc import Sequence
from datetime import datetime

from dehyst.daemon.bus.messages import Event, Status
from dehyst.daemon.printable import printable
from dehyst.daemon.rings.status import FROZEN, counts, is_starting, place, positioning, rate
from dehyst.models.model import Model
from dehyst.models.units import how_many

LEVELS = {1: "", 2: "warning: ", 3: "error: "}
EVENTS = 8  # newest ones shown
MOST_MISSED = 1e-3
"""Share of missed deadlines above which the status reports a problem."""
LONGEST_START_S = 300.0
"""A longer start is reported as a problem; compiling all kernels takes one to three minutes."""
REASONS = {
    "start": "kernels are compiled and devices opened; the output is left unchanged",
    "ready": "no client commands the stage; the output stays where it is",
    "running": "the stage follows set-points or a trajectory",
    "holding": "no more set-points arrive; the output stays, then ramps to its safe voltage",
    "fault": "a device does not answer, or contradicts what was written; nothing is written",
    "stopping": "the daemon is shutting down",
}
STAYS = "the requested position or voltage stays until another command"


def find_troubles(status: Status) -> list[str]:
    """Return the conditions that need attention, as texts; empty if there are none."""
    s, gateway, found = status, status.gateway, []
    if is_starting(s):
        if gateway.uptime_s > LONGEST_START_S:
            found.append(f"the start has taken {_duration(gateway.uptime_s)}; see its log")
        return found
    if not s.core_alive:
        found.append("the loop's process does not respond: it has ended, was killed, or hangs")
    for name, ok, errors in (
        ("actuator", s.actuator_ok, s.actuator_errors),
        ("sensor", s.sensor_ok, s.sensor_errors),
    ):
        if not ok:
            found.append(f"the {name} does not answer ({errors} errors); it reconnects by itself")
    if s.state == "fault" and s.actuator_ok and s.sensor_ok:
        found.append("the loop is in the state fault; the events give the reason")
    if gateway.mismatch:
        found.append(
            f"the stage does not behave like its model ({gateway.mismatch}, {gateway.health:.2g} "
            "times the expected misfit): `dehyst doctor` shows what has changed"
        )
    if s.trimmed and s.trim_frozen in FROZEN:
        found.append(f"the trim is frozen: {FROZEN[s.trim_frozen]}")
    if s.missed > MOST_MISSED * max(1, s.samples):
        found.append(
            f"{describe_share(s.missed, s.samples)} of the deadlines were missed "
            f"({counts(s.missed_by)}): with the daemon stopped, `dehyst latency --config FILE` "
            "shows what is too slow"
        )
    if gateway.log_dropped:
        found.append(f"{how_many(gateway.log_dropped, 'line')} of the log could not be written")
    if gateway.samples_lost:
        found.append(
            f"{how_many(gateway.samples_lost, 'sample was', 'samples were')} lost before "
            "publication"
        )
    return found


def describe_share(part: int, whole: int) -> str:
    """Return a share in percent, with two digits below 10 %. It is limited to 100 %, because a loop
    that is starting may have missed more deadlines than it has samples."""
    share = 100.0 * min(1.0, part / max(1, whole))
    return f"{share:.2g} %" if share < 9.95 else f"{share:.0f} %"


def describe_health(status: Status) -> str:
    """Describe the state of the mismatch monitor."""
    health = status.gateway.health
    if status.gateway.mismatch:
        return (
            f"mismatch ({status.gateway.mismatch}): {health:.2f} times the largest expected misfit"
        )
    if health == 0:
        return "not judged yet"
    if health < 0:
        return f"learning: {100 + 100 * health:.0f} % of the required motion seen"
    return f"{health:.2f} of the largest expected misfit: the stage behaves like its model"


def describe_kind(model: Model) -> str:
    """Describe the kind of model, its date, its recordings and its held-out error."""
    h, p, fit = model.hysteresis, model.provenance, model.fit
    words = [f"{'static' if h.static else 'rate-dependent'}, {h.n} play operators"]
    more = len(model.blocks)
    words += [f"{more} further block{'s' * (more > 1)}"] * bool(more)
    words += [f"made {p.created}"] * bool(p.created)
    words += [f"from {', '.join(name for name, _ in p.recordings)}"] * bool(p.recordings)
    if fit.holdout_rms is not None:
        words.append(f"{fit.holdout_rms:.3g} {model.displacement_unit} rms on held-out data")
    return ", ".join(words)


def overview(
    status: Status, model: Model | None, events: Sequence[Event], troubles: Sequence[str]
) -> list[str]:
    """Return the screen's lines. model: None if it is not known."""
    s, g = status, status.gateway
    if is_starting(s):
        lines = [f"{s.name}: starting for {_duration(g.uptime_s)}: {REASONS['start']}"]
    elif s.core_alive:
        reason = STAYS if s.stays else REASONS.get(s.state, "")
        lines = [f"{s.name}: {s.state}: {reason}"]
    else:
        lines = [f"{s.name}: no loop"]
    lines += [f"  ! {text}" for text in troubles]
    rows = {
        "position": place(g.measured, g.target, s.volts, s.unit),
        "reach": f"{s.reach_min:.4f} to {s.reach_max:.4f} {s.unit}",
        "control": positioning(s),
        "devices": f"actuator {_device(s.actuator_ok, s.actuator_errors)}, sensor "
        f"{_device(s.sensor_ok, s.sensor_errors)}",
        "model": "not known" if model is None else describe_kind(model),
        **({"trial": g.trial} if g.trial else {}),
        "inverse": s.mode + (f", latency {s.latency_s:.3g} s" if s.latency_s else ""),
        "deadline": f"{rate(s)}, {s.missed} of {s.samples} missed; wake-up p99 "
        f"{s.wake_us.p99:.0f} us, I/O p99 {s.io_us.p99:.0f} us; {s.policy} {s.priority}",
        "health": describe_health(s),
        "command": f"{g.lease_label or 'nobody'}; {how_many(g.commands, 'command')}, refused: "
        f"{counts(g.rejected)}",
        "bus": f"{g.links} connected, {how_many(g.samples_published, 'sample')} published, "
        f"{g.samples_lost} lost; up {_duration(g.uptime_s)}, "
        f"{how_many(g.restarts_of_core, 'restart')} of the loop",
        "software": f"dehyst {s.software}",
    }
    if is_starting(s):
        rows = {name: text for name, text in rows.items() if name in ("command", "bus", "software")}
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
