"""Plays a trajectory repeatedly and learns from each pass, as `dehyst play --learn` does."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from dehyst.daemon.client.client import Client
from dehyst.daemon.client.group import Group
from dehyst.daemon.client.learning import LessonTaker
from dehyst.daemon.client.player import Played
from dehyst.daemon.client.repeated import Repeated, on_grid
from dehyst.daemon.files.learned import Learned, read_learned, trajectory_digest, write_learned
from dehyst.daemon.rings.records import model_digest
from dehyst.models.learning import trim
from dehyst.models.learning.late_gauge import LateGauge
from dehyst.models.learning.passes import Learner, Outcome
from dehyst.models.learning.reading import expected_reading
from dehyst.models.modelfile import dumps
from dehyst.models.recording import Floats

NO_NOISE = 0.002
"""Assumed gauge noise as a fraction of the reach, if the model states none."""
WITHIN = 0.99
"""Fraction of the loop's own correction limit that is used."""


@dataclass(frozen=True)
class Lessons:
    """Result of learning: the play result, the outcome of each pass, and the errors of the first
    and the newest pass."""

    played: Played
    outcomes: list[Outcome]
    errors: list[Floats]
    period_s: float


class Course:
    """One axis that learns: (n,) targets at times t_s, `repeat` passes (0: until an interrupt).

    file: file from which learned corrections are loaded and to which they are saved;
    gauge_filter_s: time constant of the gauge's filter [s], 0: unknown. Raises BadInput for a file
    of another model or trajectory.
    """

    def __init__(
        self,
        client: Client,
        t_s: Floats,
        target: Floats,
        repeat: int,
        file: Path | None,
        on_outcome: Callable[[Outcome], None],
        gauge_filter_s: float = 0.0,
    ) -> None:
        status, model = client.status(), client.model()
        self.file, self.unit, self.period_s = file, status.unit, status.period_ns * 1e-9
        times, values = on_grid(t_s, target, self.period_s)
        reach = status.reach_max - status.reach_min
        self.digests = model_digest(dumps(model)), trajectory_digest(values, self.period_s)
        known = None
        if file is not None:
            known = read_learned(file, *self.digests, status.unit, values.size)
        self.learner = Learner(
            values,
            self.period_s,
            model.fit.noise_rms or model.fit.rms or NO_NOISE * reach,
            WITHIN * trim.TUNING.limit * reach,
            known,
        )
        expected = expected_reading(model, values, self.period_s)
        late = LateGauge(gauge_filter_s) if gauge_filter_s > 0.0 else None
        self.taker = LessonTaker(self.learner, values, expected, status.period_ns, on_outcome, late)
        self.points = Repeated(times, values, repeat, self.taker.correct)

    def save(self) -> None:
        """Write the learned corrections if a file was given. Raises BadInput."""
        if self.file is None or not self.learner.learned:
            return
        write_learned(
            self.file,
            Learned(
                model=self.digests[0],
                trajectory=self.digests[1],
                period_s=self.period_s,
                unit=self.unit,
                passes=self.learner.learned,
                correction=self.learner.correction.tolist(),
            ),
        )

    def lessons(self, played: Played) -> Lessons:
        """Combine the play result with what was learned."""
        return Lessons(played, self.learner.outcomes, self.taker.errors, self.period_s)


def play_learning(
    client: Client,
    course: Course,
    allow_unreachable: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> Lessons:
    """Play and learn with one axis."""
    try:
        played = client.play_learning(course.points, course.taker, allow_unreachable, progress)
    finally:
        course.save()
    return course.lessons(played)


def play_learning_together(
    group: Group,
    courses: Mapping[str, Course],
    allow_unreachable: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> dict[str, Lessons]:
    """Play and learn with several axes on the same samples, each from its own error."""
    points = {axis: course.points for axis, course in courses.items()}
    takers = {axis: course.taker for axis, course in courses.items()}
    try:
        played = group.play_learning(points, takers, allow_unreachable, progress)
    finally:
        for course in courses.values():
            course.save()
    return {axis: course.lessons(played[axis]) for axis, course in courses.items()}
