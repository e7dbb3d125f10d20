"""Work for a doctor: endless cases of a stage that creeps more than its model predicts."""

from pathlib import Path

import numpy as np

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.config import Config
from dehyst.daemon.demo.second_act import pattern
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case
from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import write_recording
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage

RATE_HZ = 200.0


def lay_cases(config: Config, count: int) -> None:
    """Write `count` cases of 20 s each, 200 Hz, to the watch's folder."""
    stage = SimulatedStage(StageSettings(creep_gain_per_decade=0.05, amplifier_tau_s=0.01))
    t_s, volts = pattern(75.0, 66.0, RATE_HZ)
    _, measured = stage.run(t_s, volts)
    columns = {"u_v": np.r_[volts[0], volts[:-1]], "y_um": measured}
    for number in range(count):
        folder = config.watch_directory / f"mismatch-load-{number:03d}{cases.SUFFIX}"
        folder.mkdir(parents=True)
        save_model(simulated_model(), folder / cases.IN_USE)
        for name in (cases.FLAGGED, cases.LATER, cases.GOOD):
            write_recording(folder / name, t_s, columns, {})
        case = Case(
            number=number + 1, name=folder.stem, time_ns=1, wall_ns=1, figure="whole", low=0.0,
            high=150.0, slew=4000.0, rate_hz=RATE_HZ, later_s=1.0,
        )  # fmt: skip
        cases.put_record(folder, cases.CASE, case)


def main() -> None:
    """python -m tests.benchmarks.daemon.doctor_load CONFIG COUNT"""
    import sys

    from dehyst.daemon.config import load_config

    lay_cases(load_config(Path(sys.argv[1])), int(sys.argv[2]))


if __name__ == "__main__":
    main()
