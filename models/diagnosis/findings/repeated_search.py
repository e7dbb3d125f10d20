"""Repeat the search with an effect added to the recordings, to see whether it would be reported.

As this is done many times with the same recordings, the shared parts are computed once: the rows
that count, the base's columns filtered by the effects found, and the contribution of each candidate
from its starts. An effect at a limit is about as large as the noise, so all fits are linearised
about the one that was found (`Problem.linearised_about`).
"""

from collections.abc import Collection, Sequence

from dehyst.models.diagnosis.findings.reported import (
    keep_effects_of_known_size,
    keep_helpful_effects,
)
from dehyst.models.diagnosis.judge import CandidateTrial, SearchState
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.search import accept_best, refit_each
from dehyst.models.diagnosis.shortlist import (
    ScreenedCandidate,
    drop_weak,
    list_eligible,
    list_remaining,
    rank_by_estimated_gain,
)
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Candidate
from dehyst.models.signals.joined import Floats


class RepeatedSearch:
    """The recordings of a search, to be searched again with effects added."""

    def __init__(self, found: SearchState) -> None:
        light = found.problem.with_fewer_rows(TUNING.limit_rows).with_sequential_fits()
        known = light.solve(found.accepted.effects, found.problem.output_of(found.accepted))
        self._plain, self._problem = light, light.linearised_about(known)
        self._found, self._known = found, self._problem.solve(known.effects, light.output_of(known))
        self._output = light.output_of(self._known)
        self._everything = list_eligible(light, found.share, ())
        screen = Screen(self._problem, self._known)
        self._screen = screen.with_residual(screen.residual)
        # starts that a candidate derives from a residual: here from the one that was found
        self._starts = [
            (c, [tuple(s) for s in c.starts(light.data, screen.residual)])
            for c in list_remaining(light, self._known, self._everything)
        ]

    def names(self, put_in: Candidate, added: Floats) -> set[str]:
        """Return the names reported in addition to what was found, where (N,) `added` is added to
        the reading.

        put_in: the candidate whose effect was added. If it does not remove all of that effect, it
        is compared with the other candidates; those that may be confused with it derive their
        starts from the new residual.
        """
        there = self._problem.with_reading(self._problem.data.y + added)
        known = there.solve(self._known.effects, self._output)
        null = self._plain.with_reading(there.data.y).solve([]) if known.effects else known
        counted = int(there.data.rows.sum())
        state = SearchState(
            there, self._found.sigma, null, known, counted=counted, share=self._found.share
        )
        screen = self._screen.with_residual(known.residual(there.data))
        ranked = self._rank(state, screen, {put_in.name})
        own = [p for p in ranked[: TUNING.shortlist] if p.candidate.name == put_in.name][:1]
        trials = refit_each(state, own, lambda text, share: None, 0)
        if not trials or self._has_rivals(state, trials[0], ranked):
            ranked = self._rank(state, screen, {put_in.name, *put_in.confused_with})
            others = [p for p in ranked if p.candidate.key not in {o.candidate.key for o in own}]
            near = drop_weak(others, ranked)[: TUNING.few - len(own)]
            more = refit_each(state, near, lambda text, share: None, 0)
            trials = sorted([*trials, *more], key=lambda t: -t.worth)
        reported = keep_effects_of_known_size(
            keep_helpful_effects(accept_best(state, trials, ()))
        ).accepted
        return {e.candidate.name for e in reported.effects}

    def _rank(
        self, state: SearchState, screen: Screen, fresh: Collection[str]
    ) -> list[ScreenedCandidate]:
        """Return the candidates ranked by estimated gain; fresh: names of the candidates that
        derive their starts from this residual."""
        return rank_by_estimated_gain(
            state,
            [
                (c, screen.starts(c) if c.name in fresh else screen.rank(c, starts))
                for c, starts in self._starts
            ],
        )

    def _has_rivals(
        self, state: SearchState, own: CandidateTrial, ranked: Sequence[ScreenedCandidate]
    ) -> bool:
        """Return whether another candidate could take the place of the one that was added (own):
        that one leaves more than was left before the effect was added, or it is not of the plainest
        and another's estimated gain is more than half of its own."""
        n, sigma = state.counted, state.sigma
        if own.fit.sse - self._known.sse > n * (TUNING.trace * sigma) ** 2:
            return True
        plainest = own.price < 1.5 * TUNING.price * sigma**2  # it has one parameter, not two
        others = [p.gain for p in ranked if p.candidate.name != own.candidate.name]
        return not plainest and max(others, default=0.0) > TUNING.half * own.gain
