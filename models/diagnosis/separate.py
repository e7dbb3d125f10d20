"""What to record next: the experiment that tells two candidates apart."""

from collections.abc import Sequence

from dehyst.models.diagnosis.result import Finding

EXPERIMENTS: dict[frozenset[str], str] = {
    frozenset({"delay", "lag"}): "a chirp from 1 Hz to a few hundred hertz at a small stroke",
    frozenset({"delay", "resonance"}): "steps, with the ringing sampled well above its frequency",
    frozenset({"lag", "resonance"}): "steps, with the ringing sampled well above its frequency",
    frozenset({"lag"}): "a large chirp, or better a channel with the amplifier's monitor output",
    frozenset({"slew", "lag"}): "the same fast chirp at a large and at a small stroke",
    frozenset({"slew", "delay"}): "the same fast chirp at a large and at a small stroke",
    frozenset({"creep", "drift"}): "holds of ten seconds, approached from above and from below",
    frozenset({"drift"}): "a long rest with a temperature channel",
    frozenset(
        {"rate", "lag"}
    ): "sines of one frequency at several strokes, then several frequencies",
    frozenset({"rate", "delay"}): "sines of one frequency at several strokes, then several "
    "frequencies",
    frozenset({"rate", "friction"}): "small reversals at several speeds",
    frozenset({"asymmetry", "sensor"}): "repeated triangles over the full range, and a calibration "
    "of the sensor",
    frozenset({"hum", "resonance"}): "a rest of ten seconds with the drive on",
    frozenset({"coupling", "drift"}): "a rest of the own axis while only the other one moves",
}


def next_experiment(verdict: str, findings: Sequence[Finding], blind: Sequence[str]) -> str:
    """One sentence. blind: names that the recordings could not show."""
    for f in findings:
        for rival in f.ambiguous_with:
            text = EXPERIMENTS.get(frozenset({f.name, rival}))
            if text:
                return (
                    f"To tell {f.name} from {rival}, record {text} "
                    f"(dehyst excite --separate {f.name} {rival})."
                )
    if verdict in ("unknown", "partly"):
        return (
            "Record the same drive twice: what repeats is the stage, what does not is its "
            "surroundings; then log further channels (temperature, the neighbouring axes, force)."
        )
    if blind:
        return (
            f"These recordings cannot show {', '.join(blind)}; steps, holds of some seconds and a "
            "fast chirp over the full range would."
        )
    if findings:
        return "Track with the augmented model, record again and diagnose that recording."
    return "None is needed; diagnose again after a change of amplifier, sensor, load or mounting."
