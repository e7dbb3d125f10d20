"""A real stack's model and a real trajectory through the daemon's step, without processes."""

from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.config import parse_config
from dehyst.daemon.files.recordings import read_recording, read_trajectory
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, State
from dehyst.models.cascade.reach import displacement_range, set_point_origin
from dehyst.models.identify import Options, identify
from dehyst.models.inverse.compensator import Compensator

CONFIG = """
name = "stack"
[model]
file = "none"
[loop]
rate_hz = 200
[actuator]
driver = "simulated"
gain = 41.667
[sensor]
driver = "simulated"
[limits]
min_v = 0
max_v = 150
slew_v_per_s = 4000
"""


@pytest.mark.recordings
def test_the_target_of_a_real_experiment_is_followed_to_its_end(data_dir: Path) -> None:
    recording = read_recording(data_dir / "recordings" / "stack-1hz.csv")
    model = identify([recording], Options(rate=False)).model
    config = parse_config(CONFIG)
    low, high = displacement_range(model, model.validity.drive_min, model.validity.drive_max)
    zero = set_point_origin("auto", model, 0.0, 150 / 41.667)
    assert zero == pytest.approx(0.5 * (low + high))  # this sensor's zero is far away: -98 um
    compensator = Compensator(model, 0.005, 0.0, 150 / 41.667, 4000 / 41.667, mode="static")
    slope = (high - low) / (model.validity.drive_max - model.validity.drive_min)
    stepper = Stepper(LoopSettings.from_config(config, zero, 0.0, 150.0, slope), compensator, 0.0)
    trajectory = read_trajectory(data_dir / "recordings" / "stack-am.csv")
    points = np.zeros(trajectory.t_s.size, COMMAND)
    points["kind"], points["trajectory"] = LoopCommand.POINT, 1
    points["offset_ns"] = np.round((trajectory.t_s - trajectory.t_s[0]) * 1e9)
    points["value"] = trajectory.target
    points["last"][-1] = 1
    now, rows = 0, []
    while not stepper.trajectory_done and len(rows) < 20_000:
        now += 5_000_000
        sent = points[200 * (len(rows) // 200) : 200 * (len(rows) // 200 + 1)]
        record = stepper.step(now, 0.0, sent if len(rows) % 200 == 0 else points[:0])
        stepper.follow_output(float(record["volts"][0]))
        rows.append(record.copy())
    done = np.concatenate(rows)
    assert stepper.trajectory_done
    assert stepper.state is State.RUNNING
    assert done.size == pytest.approx(trajectory.t_s[-1] * 200, rel=0.05)
    assert done["volts"].min() >= 0.0
    assert done["volts"].max() <= 150.0
    assert np.abs(np.diff(done["volts"])).max() <= 4000 * 0.005 * (1 + 1e-9)
    clean = (done["flags"] & (Flag.APPROACH | Flag.UNREACHABLE | Flag.SLEW)) == 0
    assert clean.mean() > 0.9
    # the recording's lag is compensated by derivatives at the loop's own spacing
    error = (done["predicted"] - done["target"])[clean][2:]
    assert model.fit.noise_rms is not None
    assert np.sqrt(np.mean(error**2)) < 0.25 * model.fit.noise_rms
    assert np.abs(error).max() < 3.0 * model.fit.noise_rms
