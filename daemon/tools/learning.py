"""Play a trajectory again and again, and learn from each pass: what `dehyst play --learn` runs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dehyst.daemon.client.client import Client
from dehyst.daemon.client.learning import LessonTaker
from dehyst.daemon.client.player import Played
from dehyst.daemon.client.repeated import Repeated, on_grid
from dehyst.daemon.files.learned import Learned, read_learned, trajectory_digest, write_learned
from dehyst.daemon.rings.records import model_digest
from dehyst.models.learning import trim
from dehyst.models.learning.passes import Learner, Outcome
from dehyst.models.learning.reading import expected_reading
from dehyst.models.modelfile import dumps
from dehyst.models.recording import Floats

NO_NOISE = 0.002
"""Of the reach: the noise of a gauge whose model states none."""
WITHIN = 0.99
"""Part of the loop's own bound that is used."""


@dataclass(frozen=True)
class Lessons:
    """What came of it: the playing, each pass, the errors of the first and the newest pass."""

    played: Played
    outcomes: list[Outcome]
    errors: list[Floats]
    period_s: float


def play_learning(
    client: Client,
    t_s: Floats,
    target: Floats,
    repeat: int,
    file: Path | None,
    told: Callable[[Outcome], None],
    allow_unreachable: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> Lessons:
    """Play (n,) targets `repeat` times (0: until an interrupt) and learn. file: where what was
    learned is taken up and saved. Raises BadInput for a file of another model or trajectory."""
    status, model = client.status(), client.model()
    period_s = status.period_ns * 1e-9
    times, values = on_grid(t_s, target, period_s)
    reach = status.reach_max - status.reach_min
    digests = model_digest(dumps(model)), trajectory_digest(values, period_s)
    known = None
    if file is not None:
        known = read_learned(file, *digests, status.unit, values.size)
    learner = Learner(
        values,
        period_s,
        model.fit.noise_rms or model.fit.rms or NO_NOISE * reach,
        WITHIN * trim.TUNING.limit * reach,
        known,
    )
    expected = expected_reading(model, values, period_s)
    taker = LessonTaker(learner, expected, status.period_ns, told)
    points = Repeated(times, values, repeat, taker.correct)
    try:
        played = client.play_learning(points, taker, allow_unreachable, progress)
    finally:
        if file is not None and learner.learned:
            write_learned(
                file,
                Learned(
                    model=digests[0],
                    trajectory=digests[1],
                    period_s=period_s,
                    unit=status.unit,
                    passes=learner.learned,
                    correction=learner.correction.tolist(),
                ),
            )
    return Lessons(played, learner.outcomes, taker.errors, period_s)
