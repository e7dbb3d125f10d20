"""A picture of one case: what was recorded, the loop, and the residuals before and after."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from tests.benchmarks.models.proof.stages import Case

from dehyst.models.diagnosis import Diagnosis

BLUE, GREY, RED = "#1f5fbf", "#9a9a9a", "#c0392b"


def draw(case: Case, diagnosis: Diagnosis, path: Path) -> None:
    """Draw the picture of a case."""
    bare = case.stage
    figure, axes = plt.subplots(
        4, len(diagnosis.views), figsize=(5.5 * len(diagnosis.views), 11), layout="constrained",
        squeeze=False,
    )  # fmt: skip
    for column, view in zip(axes.T, diagnosis.views, strict=True):
        own = view.name.removesuffix(".csv")
        table, rig = case.tables[own], case.plan.rig
        column[0].plot(view.t_s, view.drive, color=GREY, lw=0.8)
        column[0].set_title(f"{view.name}: drive / {diagnosis.drive_unit}")
        column[1].plot(view.drive, view.displacement, color=BLUE, lw=0.4)
        column[1].set_title(f"loop / {diagnosis.unit}")
        for values, color, label in (
            (view.base, GREY, "model in use"), (view.augmented, BLUE, "augmented"),
        ):  # fmt: skip
            column[2].plot(view.t_s, view.displacement - values, color=color, lw=0.5, label=label)
        column[2].set_title(f"what is left / {diagnosis.unit}")
        column[2].legend(frameon=False)
        effect = (table.exact - bare.read([], own)) * rig.per_um
        column[3].plot(table.t_s, effect - effect.mean(), color=RED, lw=0.6)
        column[3].set_title(f"what is hidden does / {diagnosis.unit}")
    hidden = ", ".join(f"{h.name} ({h.form}) {h.left:.1f}" for h in case.hidden) or "nothing"
    named = ", ".join(f.name for f in diagnosis.findings) or "-"
    figure.suptitle(f"{path.stem}, {case.plan.hysteresis}. Hidden: {hidden}. Said: {named}")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)
