"""Describes, from the configuration, what the stage does after a command."""

from dehyst.daemon.config import Config

KEEP = "--for S or --stay keeps the stage there"


def what_follows(config: Config) -> str:
    """Describe what happens after the last set-point of a client that sends no further one."""
    return f"{after_the_last(config)}; {KEEP}"


def after_the_last(config: Config) -> str:
    """Describe what happens after the last target of a client."""
    setpoint = config.setpoint
    held_s = setpoint.stale_s + setpoint.hold_s
    return f"holds for {held_s:g} s, then {ramp_of(config)}"


def after_a_stop(config: Config) -> str:
    """Describe what happens after a stop or a hold."""
    return f"holds the output for {config.setpoint.hold_s:g} s, then {ramp_of(config)}"


def after_a_stop_in_fault(config: Config) -> str:
    """Describe what happens after a stop while a device has failed."""
    what = ramp_of(config) if config.safe.on_fault == "ramp" else after_a_stop(config)
    return f"a device has failed, so nothing is written now; once it is back, {what}"


def at_the_end(config: Config) -> str:
    """Describe what happens to the output when the daemon ends."""
    if config.safe.on_stop == "hold":
        return 'the output stays where it is (safe.on_stop = "hold")'
    return f"the output {ramp_of(config)}"


def after_a_death(config: Config) -> str:
    """Describe what happens to the output after the loop's process has died."""
    if config.safe.on_fault == "hold":
        return 'the output stays where it is (safe.on_fault = "hold")'
    return f"the output {ramp_of(config)}"


def ramp_of(config: Config) -> str:
    """Describe a ramp that begins at once."""
    return f"ramps to {config.safe.voltage_v:g} V at {config.safe.ramp_v_per_s:g} V/s"


STAYS = "stays there until another command, also after this one has ended"
HELD = "holds the output until another command, also after this one has ended"
