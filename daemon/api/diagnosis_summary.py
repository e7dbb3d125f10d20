"""Text summary of a `dehyst diagnose` result."""

from dehyst.models.diagnosis import Diagnosis
from dehyst.models.units import pick_unit

SAID = {"partly": "partly explained", "unknown": "not explained"}


def describe_diagnosis(diagnosis: Diagnosis) -> str:
    """Return the text shown on the terminal: the data first, then the verdict with one pair of
    figures, the findings, and what to do next."""
    before, after = diagnosis.before_after
    k, unit = pick_unit(diagnosis.unit, max(before, diagnosis.noise))
    lines = [f"data: {said}" for said in diagnosis.data.says]
    verdict = SAID.get(diagnosis.verdict, diagnosis.verdict)
    lines.append(
        f"{verdict}: the model in use leaves {k * before:.3g} {unit} rms, the augmented "
        f"model {k * after:.3g} (noise {k * diagnosis.noise:.3g})"
    )
    for f in diagnosis.findings:
        ties = f" (or {', '.join(f.ambiguous_with)})" if f.ambiguous_with else ""
        lines.append(f"  {f.name}{ties}, {100 * f.share:.0f} % of the explainable misfit: {f.says}")
    if diagnosis.next_experiment:
        lines.append(f"  next: {diagnosis.next_experiment}")
    return "\n".join(lines)
