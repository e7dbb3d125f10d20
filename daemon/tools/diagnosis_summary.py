"""The result of `dehyst diagnose` for people."""

from dehyst.models.diagnosis import Diagnosis


def describe_diagnosis(diagnosis: Diagnosis) -> str:
    """What a person reads on the terminal."""
    k, unit = (1e3, "nm") if diagnosis.unit == "um" else (1.0, diagnosis.unit)
    lines = [f"{diagnosis.verdict}   (noise {k * diagnosis.noise:.3g} {unit} rms)"]
    for f in diagnosis.findings:
        ties = f" (or {', '.join(f.ambiguous_with)})" if f.ambiguous_with else ""
        lines.append(f"  {f.name}{ties}, {100 * f.share:.0f} % of the explainable misfit: {f.says}")
    before, after = diagnosis.rms.get("heldout_base"), diagnosis.rms.get("heldout_augmented")
    if isinstance(before, float) and isinstance(after, float):
        lines.append(f"  held-out error {k * before:.3g} {unit} before, {k * after:.3g} after")
    if diagnosis.next_experiment:
        lines.append(f"  next: {diagnosis.next_experiment}")
    return "\n".join(lines)
