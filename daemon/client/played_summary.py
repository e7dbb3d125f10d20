"""Summarises how a trajectory was played by one axis, as JSON values and in words."""

from typing import Any

from dehyst.daemon.client.player import Played


def list_figures(played: Played) -> dict[str, Any]:
    """Return the results of one axis as JSON values."""
    tracking = played.tracking
    return {
        "completed": played.completed,
        "reason": played.reason,
        "unit": played.unit,
        "duration_s": played.duration_s,
        "samples": tracking.samples,
        "expected_samples": tracking.expected,
        "lost_telemetry_samples": played.lost,
        "rms_error": tracking.rms_error,
        "max_error": tracking.max_error if tracking.valid else float("nan"),
        "unreachable_samples": tracking.unreachable,
        "slew_limited_samples": tracking.slew_limited,
        "outside_validity_samples": tracking.outside_validity,
        "invalid_sensor_samples": tracking.invalid,
        "fallback_samples": tracking.dry,
        "missed_deadlines": tracking.missed,
        "too_busy_to_judge": bool(about_the_machine(played)),
        "state": played.state,
        "notes": list(played.notes),
    }


MOST_MISSED = 0.01
"""Share of missed deadlines above which the figures describe the machine, not the stage."""


def about_the_machine(played: Played) -> str:
    """Return why the errors may be due to a busy machine; "": they are the stage's."""
    tracking = played.tracking
    if tracking.missed <= MOST_MISSED * max(tracking.samples, 1):
        return ""
    share = 100.0 * tracking.missed / max(tracking.samples, 1)
    return (
        f"{share:.3g} % of the deadlines were missed, so the error does not count: this machine "
        "was too busy; with the daemon stopped, `dehyst latency --config FILE` shows what is too "
        "slow"
    )


def describe_played(played: Played, axis: str) -> list[str]:
    """Describe the results in words, as lines."""
    tracking, unit, head = played.tracking, played.unit, f"{axis}: " if axis else ""
    most = tracking.max_error if tracking.valid else float("nan")
    busy = about_the_machine(played)
    seen = f"{tracking.samples} of {tracking.expected} samples, {played.lost} lost"
    lines = [
        f"{head}{f'played to the end; {seen}' if played.completed else seen}",
        f"{head}tracking error: rms {tracking.rms_error:.4g} {unit}, largest {most:.4g} {unit}",
        f"{head}unreachable {tracking.unreachable}, slew-limited {tracking.slew_limited}, outside "
        f"the model's validity {tracking.outside_validity}, without a reading "
        f"{tracking.invalid}, inverse fell back {tracking.dry}, missed deadlines "
        f"{tracking.missed}",
    ]
    end = "" if played.completed else f"ended early: {played.reason}"
    return lines + [f"{head}{one}" for one in (busy, end) if one]
