"""Describes what accepting an offered model changes: reach, error, drive rate and whether the
trajectory being played is affected."""

from dehyst.daemon.bus.messages import ModelOffer, Status

SAME = 1e-6
"""Fraction of the reach [1] below which a change is due to rounding of the numbers on the bus."""
CUTS = "a trajectory is in play, and parts of it may leave the new reach"


def new_reach(offer: ModelOffer, status: Status) -> tuple[float, float] | None:
    """Return the smallest and largest set-point that the offered model reaches; None: unknown.
    Origin and trim do not change."""
    before, after = offer.reach_in_use, offer.reach_offered
    if before is None or after is None:
        return None
    return status.reach_min + after[0] - before[0], status.reach_max + after[1] - before[1]


def describe_change(offer: ModelOffer, status: Status) -> str:
    """Describe in words what accepting the offer changes."""
    unit = status.unit
    text = (
        f"error on {offer.seconds:.0f} s of later telemetry: {offer.rms_in_use:.3g} becomes "
        f"{offer.rms_offered:.3g} {unit}"
    )
    if (reach := new_reach(offer, status)) is not None:
        text += f"; reach: {status.reach_min:.5g} to {status.reach_max:.5g} becomes "
        text += f"{reach[0]:.5g} to {reach[1]:.5g} {unit}"
    if offer.rate_in_use != offer.rate_offered:
        rates = (offer.rate_in_use, offer.rate_offered)
        words = ["unlimited" if rate is None else f"{rate:.4g}" for rate in rates]
        text += f"; largest drive rate: {words[0]} becomes {words[1]} {status.drive_unit}/s"
    return text


def cuts_trajectory(offer: ModelOffer, status: Status) -> bool:
    """Return whether a trajectory is being played that the offered model may not reach fully."""
    reach = new_reach(offer, status)
    if reach is None or status.trajectory_done or status.state != "running":
        return False
    slack = SAME * (status.reach_max - status.reach_min)
    return reach[0] > status.reach_min + slack or reach[1] < status.reach_max - slack
