"""Blocks of the cascade around the hysteresis: one file per kind, REGISTRY by name.

    drive blocks -> hysteresis (+ shape) -> stage blocks -> displacement -> sensor blocks -> reading

Blocks of one place act in the order in which the model lists them. The drive compensates what
moves the stage (drive and stage blocks); what only the sensor does is never compensated.

    clip, slew                          narrow the limits of the drive
    delay                               takes the targets that much later (preview)
    lag                                 drive: the command leads; stage: the targets lead
    resonance                           the targets lead by their first two derivatives
    polynomial, drift, coupling         the inverse function
    creep, friction, slow_drift,
    coupled_memory, coupled_mode        solved sample by sample along the window
    shape, memory, one_sided, rate      what they add along the planned drive is subtracted, at
                                        the present sample by secants
    hum, trend                          belong to one recording: never
    ripple                              belongs to the sensor: never

Ahead of the present sample a channel is taken to stand still.
"""

from dehyst.models.blocks import (
    clip,
    coupled_memory,
    coupled_mode,
    coupling,
    creep,
    delay,
    drift,
    friction,
    hum,
    lag,
    memory,
    one_sided,
    polynomial,
    rate,
    resonance,
    ripple,
    shape,
    slew,
    slow_drift,
    trend,
)
from dehyst.models.blocks.kind import Kind, Param
from dehyst.models.errors import BadModel
from dehyst.models.model import Block

PLACES = ("drive", "stage", "sensor")

REGISTRY: dict[str, Kind] = {
    module.KIND.name: module.KIND
    for module in (
        delay,
        lag,
        slew,
        clip,
        resonance,
        creep,
        drift,
        trend,
        coupling,
        hum,
        polynomial,
        shape,
        memory,
        ripple,
        friction,
        rate,
        coupled_memory,
        coupled_mode,
        slow_drift,
        one_sided,
    )
}


def check_block(block: Block, drive_unit: str = "", displacement_unit: str = "") -> None:
    """Raise BadModel, naming the key, where a block's kind, place, channel or parameters are
    wrong. Units: those of the model, "" where they are not known."""
    kind = REGISTRY.get(block.kind)
    if kind is None:
        raise BadModel(f"kind: {block.kind!r} is not known; known are {', '.join(REGISTRY)}")
    if block.place not in kind.places:
        raise BadModel(
            f"place: a block of kind {kind.name!r} stands at {' or '.join(kind.places)}, "
            f"not at {block.place!r}"
        )
    if kind.channel and not block.channel:
        raise BadModel(f"channel: kind {kind.name!r} needs the name of a channel")
    if block.channel and not kind.channel:
        raise BadModel(f"channel: kind {kind.name!r} reads no channel")
    kind.values(block, drive_unit, displacement_unit)


__all__ = ["PLACES", "REGISTRY", "Kind", "Param", "check_block"]
