"""What recordings show of a physics directly, beside any fit of the displacement."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.judge import SearchState
from dehyst.models.diagnosis.result import Finding, Value
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate, Sighting
from dehyst.models.signals.joined import Data


def sightings(data: Data, sigma: float) -> list[tuple[Candidate, Sighting]]:
    """Every candidate that shows itself, with what is seen of it."""
    seen = ((c, c.seen(data, sigma)) for c in list_candidates(data))
    return [(c, sighting) for c, sighting in seen if sighting is not None]


def accept(found: SearchState, candidate: Candidate, sighting: Sighting) -> SearchState:
    """The search's result with what was seen in its model, where that predicts held-out samples no
    worse; else as it was."""
    problem, final = found.problem, found.accepted
    if candidate.key in final.effect_names:
        return found
    effects = [*final.effects, Effect(candidate, sighting.theta)]
    fit = problem.solve(effects, problem.output_of(final))
    if by_blocks(problem, fit).mean_square > by_blocks(problem, final).mean_square:
        return found
    return replace(found, accepted=fit)


def retell(
    findings: Sequence[Finding], candidate: Candidate, sighting: Sighting
) -> tuple[Finding, ...]:
    """Findings, of which the one that was seen has the evidence of its own kind."""
    values = {key: Value(*interval) for key, interval in sighting.intervals.items()}

    def same(f: Finding) -> bool:
        return f.key == candidate.key and all(
            np.isclose(f.parameters[key].value, v.value)
            for key, v in values.items()
            if key in f.parameters  # else its interval was too wide to be reported
        )

    return tuple(
        replace(f, says=sighting.says, parameters=values, ambiguous_with=()) if same(f) else f
        for f in findings
    )
