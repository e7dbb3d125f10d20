"""A sudden change of the stage in mid-record: a preload that slips, a load that is taken off, a
gauge that is moved or switched to another range.

From one sample on, the displacement has another gain and another level. Slow physics (creep, drift)
fits a part of that in each recording, and does not predict the next.
"""

import numpy as np

from dehyst.models.diagnosis.findings.episodes import Episode
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import misfit_beyond_noise
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import format_length
from dehyst.models.signals.joined import Floats

EDGE = 0.1  # of a recording, at either end, where no change is looked for
TIMES = 24  # that are tried at once, in ever shorter parts


def find_stage_change(problem: Problem, null: JointFit, sigma: float) -> Episode | None:
    """Return a sudden change of gain and level, at most once in each recording, that leaves little
    of what the base leaves (null: its fit), and at most half of what slow physics leaves; None
    where there is none. Of a ramp, the best step removes three quarters of the power."""
    data = problem.data
    left = misfit_beyond_noise(problem, null, sigma)
    if left < (TUNING.strong * sigma) ** 2:
        return None
    light = problem.with_fewer_rows(TUNING.limit_rows)
    screen = Screen(light, light.solve([]))
    x = screen.output - screen.output.mean()
    columns, changes, gains = [], [], []
    for i, name in enumerate(data.names):
        at_s, gain = _best_time(screen, x, i)
        if gain > TUNING.crumb * float(screen.r @ screen.r):
            since = ((data.rec == i) & (data.t >= at_s)).astype(float)
            columns.append(np.column_stack([since * x, since]))
            changes.append((name, at_s))
            gains.append(gain)
    if not changes:
        return None
    each = np.concatenate(columns, axis=1)
    own, rest = problem.projector(null)(each), null.residual(data)[problem.row_index]
    amplitudes = np.linalg.lstsq(own, rest, rcond=None)[0]
    free = rest.size - null.design.shape[1] - own.shape[1]
    sse = float(np.sum((rest - own @ amplitudes) ** 2))
    remaining = max(sse / max(free, 1) - sigma**2, 0.0)
    if remaining > TUNING.minor * left:
        return None
    if remaining > TUNING.half * _least_by_slow_physics(screen, sigma):
        return None
    removed = each @ amplitudes
    sizes = amplitudes.reshape(-1, 2)
    says = "; ".join(
        f"at {at_s:.3g} s of {name} its gain changes by {100.0 * more:+.2g} % and its mean level "
        f"by {format_length((float(level), data.unit))}"
        for (name, at_s), (more, level) in zip(changes, sizes, strict=True)
    )
    place, when_s = changes[int(np.argmax(gains))]
    finding = Finding(
        name="unknown",
        key="unknown",
        place="stage",
        title="A sudden change of the stage",
        equation="y -> (1 + g) y + o from a time on",
        source="",
        share=left - remaining,
        evidence={"removed_rms": float(np.sqrt(left - remaining))},
        parameters={},
        ambiguous_with=(),
        where={"recording": place, "from_s": when_s},
        says=(
            f"The stage changes suddenly: {says}. No model predicts this: look for what was moved, "
            "loaded or switched then (mounting, preload, the gauge's range)."
        ),
    )
    return Episode(finding, removed, of_stage=True)


def _least_by_slow_physics(screen: Screen, sigma: float) -> float:
    """Return the least mean square beyond the noise that a slow candidate leaves, estimated."""
    problem = screen.problem
    slow = [screen.starts(c) for c in list_candidates(problem.data) if c.slow]
    gain = max((ranked[0][0] for ranked in slow if ranked), default=0.0)
    free = max(screen.rows.size - screen.current.design.shape[1], 1)
    return max((float(screen.r @ screen.r) - gain) / free - sigma**2, 0.0)


def _best_time(screen: Screen, x: Floats, i: int) -> tuple[float, float]:
    """Return the time [s] in a recording from which another gain (of x, (N,)) and level explain
    most, and by how much the sum of squares then falls."""
    data = screen.problem.data
    here = data.rec == i
    t = data.t[here]
    low, high = (float(q) for q in np.quantile(t, (EDGE, 1.0 - EDGE)))
    both = np.column_stack([x, np.ones(data.n)])
    at_s = gain = 0.0
    while high - low > 2.0 * data.period:
        times = np.linspace(low, high, TIMES)
        inside = here[:, None] & (data.t[:, None] >= times[None, :])
        gains, _ = screen.gains_in(both, screen.split_samples(inside))
        best = int(np.argmax(gains))
        at_s, gain = float(times[best]), float(gains[best])
        step = (high - low) / (TIMES - 1)
        low, high = max(at_s - step, low), min(at_s + step, high)
    return at_s, gain
