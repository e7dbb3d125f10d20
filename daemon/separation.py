"""`dehyst excite --separate A B`: the drive that tells two candidates apart, into a file."""

import json
from pathlib import Path

from dehyst.daemon.recordings import write_recording
from dehyst.models.diagnosis.experiment import EFFECTS, Experiment, separate
from dehyst.models.diagnosis.waveforms import Limits
from dehyst.models.model import Model

HELP = (
    "design the experiment that tells effect A from effect B "
    f"(known: {', '.join(EFFECTS)}); prints what each would leave that the other cannot explain"
)


def write_separation(
    a: str,
    b: str,
    limits: Limits,
    output: Path,
    model: Model | None = None,
    as_json: bool = False,
) -> int:
    """Design, write the drive (`t_s`, `u_<unit>`) to `output`, say what it is worth on stdout.

    Raises BadInput on unknown names or limits that leave nothing.
    """
    experiment = separate(a, b, limits, model)
    unit = model.drive_unit if model else "v"
    write_recording(
        output,
        experiment.t_s,
        {f"u_{unit}": experiment.drive},
        {"purpose": f"separate {a} from {b}", "waveform": experiment.chosen.waveform.name},
    )
    if as_json:
        print(json.dumps(_plain(a, b, experiment, model), allow_nan=False))
    else:
        print(experiment.says)
        print(f"{output}: {experiment.t_s.size} samples, {limits.seconds:g} s")
    return 0


def _plain(a: str, b: str, experiment: Experiment, model: Model | None) -> dict[str, object]:
    return {
        "separate": [a, b],
        "waveform": experiment.chosen.waveform.name,
        "says": experiment.says,
        "unit": model.displacement_unit if model else "um",
        "tried": [
            {"waveform": s.waveform.name, f"left_{a}": s.left_a, f"left_{b}": s.left_b}
            for s in experiment.tried
        ],
    }
