"""What the stage does once a command is over, in words: from the configuration that decides it."""

from dehyst.daemon.config import Config

KEEP = "--for S or --stay keeps the stage there"


def what_follows(config: Config) -> str:
    """What comes after the last set-point of a client that sends no other one."""
    return f"{after_the_last(config)}; {KEEP}"


def after_the_last(config: Config) -> str:
    """What comes after the last target of a client."""
    setpoint, safe = config.setpoint, config.safe
    held_s = setpoint.stale_s + setpoint.hold_s
    return (
        f"holds for {held_s:g} s, then ramps to {safe.voltage_v:g} V at {safe.ramp_v_per_s:g} V/s"
    )


def after_a_stop(config: Config) -> str:
    """What comes after a stop or a hold."""
    return (
        f"holds the output for {config.setpoint.hold_s:g} s, then ramps to "
        f"{config.safe.voltage_v:g} V at {config.safe.ramp_v_per_s:g} V/s"
    )


STAYS = "stays there until another command, also after this one has ended"
HELD = "holds the output until another command, also after this one has ended"
