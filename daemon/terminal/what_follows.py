"""Describes, from the configuration, what the stage does after a command."""

from dehyst.daemon.config import Config

KEEP = "--for S or --stay keeps the stage there"


def what_follows(config: Config) -> str:
    """Describe what happens after the last set-point of a client that sends no further one."""
    return f"{after_the_last(config)}; {KEEP}"


def after_the_last(config: Config) -> str:
    """Describe what happens after the last target of a client."""
    setpoint, safe = config.setpoint, config.safe
    held_s = setpoint.stale_s + setpoint.hold_s
    return (
        f"holds for {held_s:g} s, then ramps to {safe.voltage_v:g} V at {safe.ramp_v_per_s:g} V/s"
    )


def after_a_stop(config: Config) -> str:
    """Describe what happens after a stop or a hold."""
    return (
        f"holds the output for {config.setpoint.hold_s:g} s, then ramps to "
        f"{config.safe.voltage_v:g} V at {config.safe.ramp_v_per_s:g} V/s"
    )


STAYS = "stays there until another command, also after this one has ended"
HELD = "holds the output until another command, also after this one has ended"
