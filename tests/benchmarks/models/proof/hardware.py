"""Stages under servos and recorders like those of real hardware, judged as the proof's other cases.

The effects there are known by name only: their size was not measured against a rich base, so each
counts as separable, and no limit is tested. Held-out errors are those of the written model as
simulated by `dehyst simulate`, about their mean.
"""

from typing import Any

import numpy as np
from tests.benchmarks.models.proof.recorder import Rig
from tests.benchmarks.models.proof.score import Truth, score
from tests.benchmarks.models.proof.stages import Hidden
from tests.rigs.hardware_stages import RigCase

from dehyst.daemon.api.prediction import predict
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps, loads
from dehyst.models.recording import Recording

Row = dict[str, Any]
ACTS_ON = {"hum": "sensor", "lag": "stage", "delay": "stage", "creep": "stage",
           "resonance": "stage", "unknown": "stage"}  # fmt: skip


def judge_hardware(rig: RigCase, diagnosis: Diagnosis) -> Row:
    """Return truth, answer and figures of one case, as `run.judge` does."""
    hidden = tuple(
        Hidden(name, rig.kind, ACTS_ON[name], np.inf, 0.0, (), {}) for name in rig.hidden
    )
    truth = Truth(hidden, rig.foreign)
    said = diagnosis.to_dict()
    return {
        "hysteresis": "servo" if rig.kind.startswith("servo") else "open loop",
        "fault": "",
        "truth": truth.to_dict(),
        "rows": sum(r.size for r in rig.given),
        "answer": said,
        "score": score(truth, said, Rig()),
        "figures": figures(rig.given, rig.held, rig.noise, 0.0, diagnosis),
        "limits": [],
    }


def figures(
    given: list[Recording], held: Recording, noise: float, in_it: float, found: Diagnosis
) -> dict[str, float]:
    """Return the residuals of both models on a held-out recording, in rms of the noise. in_it: rms
    of the noise in that recording itself. disagrees: largest factor between a reported rms and that
    of the written model, simulated."""

    def left(model: Model, one: Recording) -> Any:
        return one.displacement - predict(model, one).displacement  # type: ignore[operator]

    out = {"noise": noise, "noise_said": found.to_dict()["noise"]["rms"] / noise}
    for key, model in (("held_model", found.base_model), ("held_augmented", found.model)):
        power = float(np.nanvar(left(model, held))) - in_it**2
        out[key] = float(np.sqrt(max(power, 0.0)) / noise)
    worst, leaves = 1.0, []
    for kind, model in (("model", found.base_model), ("augmented", found.model)):
        written = loads(dumps(model))
        for view, one in zip(found.views, given, strict=True):
            rms = float(np.nanstd(left(written, one)[view.counted]))
            ratio = rms / max(found.rms[kind][view.name], 1e-12)
            worst = max(worst, ratio, 1.0 / max(ratio, 1e-12))
            if kind == "model":
                leaves.append(rms**2)
    out["model"] = float(np.sqrt(max(np.mean(leaves) / noise**2 - 1.0, 0.0)))
    return out | {"disagrees": worst}
