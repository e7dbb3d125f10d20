"""Three pictures of one grid: linear volts, the inverse model, and what repeats learned.

Each is the same raster on the same simulated stage from rest. The first frame comes from elsewhere
and is not shown. Everything is computed from seeds: two runs give the same pictures.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from dehyst.daemon.imaging.microscope import Frame
from dehyst.daemon.imaging.platform_run import PlatformRun, TrackingRun, record_platform
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.drive_design.excitation import design
from dehyst.models.drive_design.scans import Scan, scan_raster
from dehyst.models.identify import identify
from dehyst.models.learning.passes import Learner, Pass, fade_share
from dehyst.models.learning.reading import expected_reading
from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.recording import Floats

AXES = ("x", "y")
RATE_HZ = 1000.0  # of an amplifier with an analog input
PERIOD_S = 1.0 / RATE_HZ
RECORD_HZ, RECORD_S = 200.0, 30.0  # of the recordings that the models come from
TOP_V, BAND_HZ = 110.0, (0.3, 3.0)
"""What they explore: the voltages of the raster with room, and frequencies up to that of its lines,
2.5 Hz to and fro."""
CENTRE_UM = (8.0, 7.5)
SIZE_UM, LINES, LINE_S = 8.0, 96, 0.2
BOUND_UM = 1.7  # largest correction that is learned: a tenth of the reach, as in the loop
NOISE_UM = StageSettings().sensor_noise_um  # of a gauge whose model states none
APPROACH_S = 1.0
SHOWN = 2  # the first frame that is shown: the one before it comes from elsewhere
LESSONS = 10  # frames that are learned from
COMPENSATED_LEAST, LEARNED_LEAST = 10.0, 30.0
"""How many times less than raw the distortion has to be."""


@dataclass(frozen=True)
class Picture:
    """One of the pictures. name, says: what made it; frame; followed: all rows of its frame."""

    name: str
    says: str
    frame: Frame
    followed: TrackingRun


@dataclass(frozen=True)
class Imaged:
    """The pictures raw, compensated, learned, in this order; models: by axis."""

    pictures: tuple[Picture, ...]
    models: Mapping[str, Model]

    def better(self, name: str) -> float:
        """How many times less the distortion of this picture is than that of the raw one."""
        of = {one.name: one.frame.distortion_nm for one in self.pictures}
        return of["raw"] / of[name]

    @property
    def reached(self) -> bool:
        """Whether both are as much better as they have to be."""
        return (
            self.better("compensated") >= COMPENSATED_LEAST
            and self.better("learned") >= LEARNED_LEAST
        )


def image(
    progress: Callable[[float], None] = lambda share: None,
    lines: int = LINES,
) -> Imaged:
    """Identify the axes, image the grid three times. progress: called with the share done; lines:
    of a picture, an even number. Raises BadInput on less than 2 lines."""
    models = identify_axes()
    scan = scan_raster(SIZE_UM, SIZE_UM, lines, LINE_S, PERIOD_S)
    targets = {"x": scan.x + CENTRE_UM[0], "y": scan.y + CENTRE_UM[1]}
    raw, compensated = (_approached(models, targets, linear) for linear in (True, False))
    frames = (
        *(partial(raw.follow, targets) for _ in range(SHOWN)),
        *(partial(compensated.follow, targets) for _ in range(SHOWN)),
    )
    followed = []
    for frame in frames:
        followed.append(frame())
        progress(len(followed) / (len(frames) + LESSONS + 1))
    before = followed[-1]
    for one in _learn(compensated, models, targets, before):
        followed.append(one)
        progress(len(followed) / (len(frames) + LESSONS + 1))
    shown = {
        "raw": (followed[SHOWN - 1], "volts proportional to the target position"),
        "compensated": (before, "volts from the inverse model, open loop"),
        "learned": (followed[-1], f"the same, after {LESSONS} frames of learning from its gauges"),
    }
    pictures = (
        Picture(name, says, _frame(scan, one, lines), one) for name, (one, says) in shown.items()
    )
    return Imaged(tuple(pictures), models)


def _learn(
    run: PlatformRun,
    models: Mapping[str, Model],
    targets: Mapping[str, Floats],
    before: TrackingRun,
) -> Iterator[TrackingRun]:
    """LESSONS frames that are learned from, and one that is not. before: the frame before them, by
    which the gauges' zeros are set."""
    learners, expected = {}, {}
    for axis, target in targets.items():
        noise_um = models[axis].fit.noise_rms or NOISE_UM
        learners[axis] = Learner(target, PERIOD_S, noise_um, BOUND_UM)
        reading = expected_reading(models[axis], target, PERIOD_S)
        expected[axis] = reading + np.mean(before.shown[axis] - reading)
    used = {axis: np.zeros(target.size) for axis, target in targets.items()}
    fade = fade_share(np.arange(used["x"].size), round(TUNING.fade_s * RATE_HZ))
    for number in range(LESSONS + 1):
        for axis, learner in learners.items():  # faded in as `dehyst play --learn` does it
            used[axis] = used[axis] + fade * (learner.correction - used[axis])
        followed = run.follow({axis: targets[axis] + used[axis] for axis in targets})
        for axis, learner in learners.items():
            if number < LESSONS:
                learner.take(Pass(followed.shown[axis] - expected[axis], used[axis]))
        yield followed


def identify_axes() -> dict[str, Model]:
    """The model of each axis, from a recording of its own."""
    drive = design(0.0, TOP_V, BAND_HZ, RECORD_S, RECORD_HZ).u
    known = record_platform(AXES, drive, RECORD_HZ)
    return {axis: identify([one]).model for axis, one in known.items()}


def _approached(
    models: Mapping[str, Model], targets: Mapping[str, Floats], linear: bool
) -> PlatformRun:
    """A stage that has gone to the first targets from rest."""
    run = PlatformRun(models, PERIOD_S, linear)
    share = 0.5 * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, round(APPROACH_S * RATE_HZ))))
    run.follow({axis: share * target[0] for axis, target in targets.items()})
    return run


def _frame(scan: Scan, followed: TrackingRun, lines: int) -> Frame:
    return Frame(scan, followed.true["x"], followed.true["y"], CENTRE_UM, lines, SIZE_UM)
