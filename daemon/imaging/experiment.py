"""Image one grid in three ways: with linear volts, with the inverse model, and after learning from
repeats.

Each image is the same raster on the same simulated stage from rest. The first frame starts from
elsewhere and is not shown. Everything is computed from seeds: two runs give the same images.
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
RECORD_HZ, RECORD_S = 200.0, 30.0  # recordings from which the models are identified
TOP_V, BAND_HZ = 110.0, (0.3, 3.0)
"""Range of these recordings: voltages that include those of the raster with margin, and frequencies
up to that of its lines, 2.5 Hz for trace and retrace."""
CENTRE_UM = (8.0, 7.5)
SIZE_UM, LINES, LINE_S = 8.0, 96, 0.2  # side; lines, 12 per pit; time of a trace or retrace
BOUND_UM = 1.7  # largest learned correction: a tenth of the reach, as in the loop
NOISE_UM = StageSettings().sensor_noise_um  # used if the model states no noise
APPROACH_S = 1.0  # smooth motion from 0 to the first point
SHOWN = 2  # number of the first frame shown: the one before it starts from elsewhere
LESSONS = 10  # frames used for learning
COMPENSATED_LEAST, LEARNED_LEAST = 10.0, 30.0
"""Required ratio of the raw distortion to that of the compensated and of the learned image."""


@dataclass(frozen=True)
class Picture:
    """One image. name, says: how it was made; frame: the frame; followed: all samples of its
    frame."""

    name: str
    says: str
    frame: Frame
    followed: TrackingRun


@dataclass(frozen=True)
class Imaged:
    """The raw, compensated and learned images, in this order; models: by axis."""

    pictures: tuple[Picture, ...]
    models: Mapping[str, Model]

    def better(self, name: str) -> float:
        """Return the ratio of the raw image's distortion to that of this image."""
        of = {one.name: one.frame.distortion_nm for one in self.pictures}
        return of["raw"] / of[name]

    @property
    def reached(self) -> bool:
        """Whether both images reach the required ratio."""
        return (
            self.better("compensated") >= COMPENSATED_LEAST
            and self.better("learned") >= LEARNED_LEAST
        )


def image(
    progress: Callable[[float], None] = lambda share: None,
    lines: int = LINES,
) -> Imaged:
    """Identify the axes, and image the grid in three ways. progress: called with the fraction done;
    lines: of an image, an even number. Raises BadInput on fewer than 2 lines."""
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
    """Yield LESSONS frames that are used for learning, and one more that is not. before: the
    preceding frame, which sets the zeros of the gauges."""
    learners, expected = {}, {}
    for axis, target in targets.items():
        noise_um = models[axis].fit.noise_rms or NOISE_UM
        learners[axis] = Learner(target, PERIOD_S, noise_um, BOUND_UM)
        reading = expected_reading(models[axis], target, PERIOD_S)
        expected[axis] = reading + np.mean(before.shown[axis] - reading)
    used = {axis: np.zeros(target.size) for axis, target in targets.items()}
    fade = fade_share(np.arange(used["x"].size), round(TUNING.fade_s * RATE_HZ))
    for number in range(LESSONS + 1):
        for axis, learner in learners.items():  # faded in as in `dehyst play --learn`
            used[axis] = used[axis] + fade * (learner.correction - used[axis])
        followed = run.follow({axis: targets[axis] + used[axis] for axis in targets})
        for axis, learner in learners.items():
            if number < LESSONS:
                learner.take(Pass(followed.shown[axis] - expected[axis], used[axis]))
        yield followed


def identify_axes() -> dict[str, Model]:
    """Return the model of each axis, identified from the axis' own recording."""
    drive = design(0.0, TOP_V, BAND_HZ, RECORD_S, RECORD_HZ).u
    known = record_platform(AXES, drive, RECORD_HZ)
    return {axis: identify([one]).model for axis, one in known.items()}


def _approached(
    models: Mapping[str, Model], targets: Mapping[str, Floats], linear: bool
) -> PlatformRun:
    """Return a stage that has moved from rest to the first targets."""
    run = PlatformRun(models, PERIOD_S, linear)
    share = 0.5 * (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, round(APPROACH_S * RATE_HZ))))
    run.follow({axis: share * target[0] for axis, target in targets.items()})
    return run


def _frame(scan: Scan, followed: TrackingRun, lines: int) -> Frame:
    return Frame(scan, followed.true["x"], followed.true["y"], CENTRE_UM, lines, SIZE_UM)
