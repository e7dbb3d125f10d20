"""Cases on which the models are compared: simulated stages, and recordings from a folder.

A simulated stage is recorded twice from rest: with superimposed sines, which are fitted, and with a
sine whose amplitude shrinks and grows, which is held out. Of a recording from a folder, the first
part is fitted and the rest is held out; the model runs through the whole recording, so that it has
the history.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dehyst.daemon.bench.simulated import FULL_SCALE_V, exploring_drive
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.paper.stages import STAGES
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.drive_design.excitation import design
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.recording import Bools, Floats, Recording

RATE_HZ, FITTED_S, HELD_S = 200.0, 30.0, 12.0  # as sustained over serial; fitted; held out
BAND_HZ = 4.0  # of the fitted sines
PAPER_V, NOISE_UM, SEED = 10.0, 0.02, 46  # range of the paper's drives; rms of the gauge
FITTED_SHARE = 0.6  # fitted share of a recording from a folder
LEAST_ROWS, MOST_ROWS = 500, 16_000
"""Limits on the rows of a recording: a shorter one proves nothing; of a longer one only the first
rows are used, to keep the run short."""
SIMULATED = {
    "stack": StageSettings(),
    "stack, rate-dependent": StageSettings(rate_per_decade=0.15),
    "stack, mode at 30 Hz": StageSettings(mode_hz=30.0, mode_share=1.0, mode_damping=0.1),
    "stack, friction of its guide": StageSettings(friction_um=0.3),
    "stack, strong creep and lag": StageSettings(creep_gain_per_decade=0.05, sensor_tau_s=0.016),
    "stack, delay and hum": StageSettings(sensor_delay_s=0.01, hum_um=0.05),
    "stack, mode, friction and drift": StageSettings(
        mode_hz=30.0, mode_share=1.0, mode_damping=0.1, friction_um=0.3, drift_um_per_s=0.005
    ),
}
"""Stages of dehyst.drivers.simulated: slip elements, creep, noise, and up to three hidden effects,
alone and combined as in the stages on which the diagnosis is judged."""


@dataclass(frozen=True)
class Comparison:
    """One case. fitted: recording to fit; held: recording to predict, scored where `scored` (N,) is
    True; made: simulated by this program, so the number of rows needed is determined."""

    name: str
    fitted: Recording
    held: Recording
    scored: Bools
    made: bool


def made_cases() -> list[Comparison]:
    """Return the simulated cases: simulated stacks, the paper's Eq. 11 and Eq. 12, and a Bouc-Wen
    stage."""
    out = []
    for name, settings in SIMULATED.items():
        out.append(_made(name, FULL_SCALE_V, lambda t, u, s=settings: _read_stage(s, t, u)))  # type: ignore[misc]
    rng = np.random.default_rng(SEED)
    for name, stage in STAGES.items():

        def read(t_s: Floats, u: Floats, stage: Callable[..., Floats] = stage) -> Floats:
            true = stage(u, 1.0 / RATE_HZ)
            return np.asarray(true + NOISE_UM * rng.standard_normal(true.size))

        out.append(_made(f"{name} stage" if "Eq" not in name else name, PAPER_V, read))
    return out


def _read_stage(settings: StageSettings, t_s: Floats, u: Floats) -> Floats:
    """Return the readings at t_s of a stage at rest whose voltage is u from one row to the next."""
    return SimulatedStage(settings).run(t_s, np.append(u[1:], u[-1]))[1]


def _made(name: str, top_v: float, read: Callable[[Floats, Floats], Floats]) -> Comparison:
    sines = design(0.0, top_v, BAND_HZ, FITTED_S, RATE_HZ)
    t_s, volts = exploring_drive(RATE_HZ, HELD_S)
    drives = (sines.t_s, sines.u), (t_s, volts * top_v / FULL_SCALE_V)
    fitted, held = (Recording(t, u, read(t, u), name=name) for t, u in drives)
    return Comparison(name, fitted, held, np.ones(held.size, np.bool_), True)


def read_cases(folder: Path) -> tuple[list[Comparison], list[str]]:
    """Return a case for each recording in the folder (.csv, .csv.gz, .npz, .mat, .mcap), sorted by
    name, and the reasons why others are left out. Raises BadInput if there is no recording."""
    suffixes = (".csv", ".csv.gz", ".npz", ".mat", ".mcap")
    paths = sorted(p for p in folder.glob("*") if p.name.endswith(suffixes))
    if not paths:
        raise BadInput(f"{folder}: it contains no recording ({', '.join(suffixes)})")
    cases, left_out = [], []
    for path in paths:
        try:
            cases.append(_recorded(path))
        except BadRecording as error:
            left_out.append(str(error))
    return cases, left_out


def _recorded(path: Path) -> Comparison:
    whole = read_recording(path, need_displacement=True)
    assert whole.displacement is not None
    good = np.isfinite(whole.drive) & np.isfinite(whole.displacement)
    n = min(whole.size, MOST_ROWS)
    if not good[:n].all() or n < LEAST_ROWS:
        raise BadRecording(f"{path}: {LEAST_ROWS} or more complete rows are needed")
    first = round(FITTED_SHARE * n)
    scored = np.arange(n) >= first
    return Comparison(path.name, head(whole, first), head(whole, n), scored, False)


def head(one: Recording, rows: int) -> Recording:
    """Return the first rows, without further channels."""
    assert one.displacement is not None
    return Recording(
        one.t_s[:rows],
        one.drive[:rows],
        one.displacement[:rows],
        one.drive_unit,
        one.displacement_unit,
        name=one.name,
    )
