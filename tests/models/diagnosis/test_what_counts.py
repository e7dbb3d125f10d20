"""What a cause must show before it is reported, with explicit figures: its price, its least size,
that it is constant; and how small an effect would have been seen."""

from dataclasses import replace

import numpy as np
import pytest

from dehyst.models.diagnosis.base import compact_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.evidence import constancy
from dehyst.models.diagnosis.findings import reported
from dehyst.models.diagnosis.findings.limits import limits
from dehyst.models.diagnosis.findings.reported import keep_effects_of_known_size, unidentified
from dehyst.models.diagnosis.findings.rivals import rivals
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.judge import (
    CandidateTrial,
    SearchState,
    effect_of,
    fit_with_companion,
    implausible_with_companion,
    judge,
    misfit_beyond_noise,
    try_candidate,
    worth_with_companion,
)
from dehyst.models.diagnosis.result import Finding, Value
from dehyst.models.diagnosis.search import search
from dehyst.models.diagnosis.shortlist import ScreenedCandidate, select_for_refit
from dehyst.models.diagnosis.steps import with_sighting
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate, Sighting
from dehyst.models.physics.earlier_creep import MOST_MOVE
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Data, Floats

DT, N, SIGMA = 1e-3, 1500, 0.02


def make(late_s: float = 0.0, gains: tuple[float, float] = (0.0, 0.0), n: int = N) -> Data:
    """Return two recordings of a straight stage, 1.1 um/v, with white noise of 0.02 um. late_s:
    delay of its drive; gains: of a second channel in each recording [um/v]."""
    rng, out, t = np.random.default_rng(7), [], np.arange(n) * DT
    for k in range(2):
        v = t - late_s
        u, late = (
            (5 + 3 * np.sin(2 * np.pi * (1.7 + k) * s) + 1.5 * np.sin(2 * np.pi * 9.3 * s + k))
            * np.clip(s / 0.2, 0, 1)
            for s in (t, v)
        )
        other = np.cos(2 * np.pi * 4.1 * t + k) + 0.3 * np.sin(2 * np.pi * 31 * t)
        y = 1.1 * late + gains[k] * other + SIGMA * rng.standard_normal(n)
        out.append(Recording(t, u, y, channels={"u2_v": other}, name=f"r{k}.csv"))
    return prepare(out)


def problem_of(data: Data) -> tuple[Problem, SearchState]:
    problem = Problem(data, compact_base(data))
    null = problem.solve([])
    return problem, SearchState(problem, SIGMA, null, null, counted=data.n)


def candidate(data: Data, key: str) -> Candidate:
    return next(c for c in list_candidates(data) if c.key == key)


def test_each_parameter_costs_16_noise_variances() -> None:
    problem, state = problem_of(make(gains=(0.2, 0.2), n=500))
    found = search(problem, SIGMA, state.null, lambda text, share: None)
    assert found.accepted.effect_keys == ("coupling-u2_v",)
    seen = 0
    for trial in found.rounds[0]:
        effect = trial.fit.effects[0]
        count = len(effect.theta) + trial.fit.amplitudes[0].size
        assert trial.price == pytest.approx(16.0 * SIGMA**2 * count)
        assert trial.worth == pytest.approx(trial.gain - trial.price)
        seen += 1
    assert seen >= 1


@pytest.mark.parametrize(("gain_in_prices", "refused"), [(0.99, True), (1.01, False)])
def test_what_is_not_worth_its_price_is_refused(gain_in_prices: float, refused: bool) -> None:
    data = make(gains=(0.2, 0.2))
    problem, state = problem_of(data)
    coupling = candidate(data, "coupling-u2_v")
    fit = problem.refit([Effect(coupling, ())])
    trial = CandidateTrial(coupling, fit, gain_in_prices * 400.0 * SIGMA**2, 400.0 * SIGMA**2)
    said = judge(state, trial, 0.0).refused
    assert (said == "its improvement does not justify its parameters") == refused


@pytest.mark.parametrize(
    ("key", "theta", "size"),
    [("delay", (2e-3,), 0.17), ("coupling-u2_v", (), 0.12), ("asymmetry", (0.6,), 0.3)],
    ids=["driven", "beside the drive", "like a hysteresis of another shape"],
)
def test_what_removes_less_than_its_least_size_is_refused(
    key: str, theta: tuple[float, ...], size: float
) -> None:
    """Sizes are rms, in rms of the noise: 0.17 if the drive causes it, 0.12 if something else does,
    0.3 for what resembles a hysteresis."""
    data = make(late_s=2e-3, gains=(0.2, 0.2))
    problem, state = problem_of(data)
    c = candidate(data, key)
    fit = problem.refit([Effect(c, theta)])
    for share, refused in ((0.95, True), (1.05, False)):
        gain = data.n * (share * size * SIGMA) ** 2
        said = judge(
            state, CandidateTrial(c, fit, gain, 0.0), 1e9 if key == "asymmetry" else 0.0
        ).refused
        assert (said == "too small compared with the noise") == refused, (share, said)


@pytest.mark.parametrize(("share", "refused"), [(0.95, True), (1.05, False)])
def test_round_one_loop_alone_a_cause_must_remove_half_a_noise(share: float, refused: bool) -> None:
    """The held-out part repeats what was seen, so a small gain there does not count."""
    t, rng = np.arange(4 * N) * DT, np.random.default_rng(7)
    u = 5 - 3 * np.cos(2 * np.pi * 2.0 * t)
    late = 5 - 3 * np.cos(2 * np.pi * 2.0 * (t - 2e-3))
    y = late + SIGMA * rng.standard_normal(t.size)
    data = prepare([Recording(t, u, y, name="one.csv")])
    problem, state = problem_of(data)
    c = candidate(data, "delay")
    gain = data.n * (share * 0.5 * SIGMA) ** 2
    trial = CandidateTrial(c, problem.refit([Effect(c, (2e-3,))]), gain, 0.0)
    assert (judge(state, trial, 0.0).refused == "too small compared with the noise") == refused


@pytest.mark.parametrize(("damping", "refused"), [(0.01, False), (0.2, True)])
def test_a_mode_that_rings_long_counts_below_the_error_of_the_base(
    damping: float, refused: bool
) -> None:
    """No loop is known to a four thousandth of the stroke, so smaller effects are refused; but the
    error of a loop does not ring, so a lightly damped mode counts."""
    t, quiet, given = np.arange(4 * N) * DT, 1e-4, []
    for k in range(2):
        rng = np.random.default_rng(k)
        u = 5 + 4 * np.sin(2 * np.pi * (1.3 + k) * t) * np.clip(t / 0.2, 0, 1)
        u[N:] += 0.5 * np.sign(np.sin(2 * np.pi * 1.9 * t[N:]))
        given.append(Recording(t, u, 1.1 * u + quiet * rng.standard_normal(t.size), name=f"{k}"))
    data = prepare(given)
    c = candidate(data, "resonance")
    theta = (150.0, damping, 0.005)
    x = 1.1 * data.u[:, None]
    data = replace(data, y=data.y + (c.output(data, x, theta) - x)[:, 0])
    problem = Problem(data, compact_base(data))
    null = problem.solve([])
    state = SearchState(problem, quiet, null, null, counted=data.n)
    trial = try_candidate(problem, quiet, null, c, theta)
    assert 1e-4 < np.sqrt(trial.gain / data.n) < 2.5e-4 * np.ptp(data.y)
    said = judge(state, trial, trial.gain / data.n).refused
    assert (said == "too small compared with the noise") == refused, said


def amplitudes(data: Data, by_block: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return a contribution x and a residual that has it with another amplitude in each block."""
    x = np.cos(2 * np.pi * 4.1 * np.arange(data.n) * DT)
    return x, np.array(by_block)[data.block] * x


def test_constancy_is_the_scatter_of_the_amplitudes_over_blocks_and_recordings() -> None:
    data = make()
    problem, _ = problem_of(data)
    assert np.unique(data.block).size == 10
    same = constancy(problem, 0.0, *amplitudes(data, [1.0] * 10))
    assert same.spread == pytest.approx(0.0, abs=1e-9)
    assert same.wrong == 0.0
    twice = constancy(problem, 0.0, *amplitudes(data, [5.0, 0.0, 0.0, 0.0, 0.0] * 2))
    assert twice.spread == pytest.approx(2.0, rel=0.05)  # sqrt((16 + 4) / 5)
    assert twice.by_recording == pytest.approx([1.0, 1.0], abs=0.15)
    assert twice.wrong == 0.0
    other = constancy(problem, 0.0, *amplitudes(data, [2.2] * 5 + [-0.2] * 5))
    assert other.by_recording == pytest.approx([2.2, -0.2])
    assert other.wrong == pytest.approx(0.5, rel=0.05)


def judged(data: Data, share_of_block: np.ndarray) -> str:
    """Return the verdict on a coupling that has these amplitudes in the ten blocks."""
    t = np.concatenate([np.arange(N) * DT] * 2)
    k = data.rec
    other = np.cos(2 * np.pi * 4.1 * t + k) + 0.3 * np.sin(2 * np.pi * 31 * t)
    changed = replace(data, y=data.y + 0.3 * share_of_block[data.block] * other)
    problem, state = problem_of(changed)
    c = candidate(changed, "coupling-u2_v")
    fit = problem.refit([Effect(c, ())])
    return judge(
        state, CandidateTrial(c, fit, state.null.sse - fit.sse, 16 * SIGMA**2), 0.0
    ).refused


def test_a_cause_that_is_the_same_everywhere_is_not_refused() -> None:
    assert judged(make(), np.ones(10)) == ""


def test_a_cause_that_one_recording_contradicts_is_refused() -> None:
    by_block = np.array([1.4] * 5 + [-0.4] * 5)
    assert judged(make(), by_block) == "not constant over the recordings"


def test_a_cause_that_is_there_in_a_fifth_of_the_time_is_refused() -> None:
    by_block = np.array([5.0, 0.0, 0.0, 0.0, 0.0] * 2)
    assert judged(make(), by_block) == "not constant over the recordings"


def left_with(data: Data, y: Floats) -> float:
    """Return the rms, in noises, that a fit without effects leaves of a reading."""
    return float(np.sqrt(problem_of(replace(data, y=y))[1].null.sse / data.n)) / SIGMA


def test_a_limit_is_reported_a_little_above_what_is_found() -> None:
    """The first probe is at 0.3 noises for effects that the drive does not cause and 0.5 for those
    that it does; the reported value is larger by a factor of 2^0.5, or half of the step from one
    probe to the next (a factor of 2.15)."""
    data = make()
    quiet = replace(data, y=1.1 * data.u)
    _, state = problem_of(quiet)
    found = {x.name: x for x in limits(state, (), lambda c, added: ("coupling", "delay"))}
    coupling = found["coupling"]
    assert coupling.value is not None
    assert (coupling.unit, coupling.side) == ("um/v", "above")
    left = left_with(quiet, quiet.y + coupling.value * data.channels["u2_v"])
    assert left == pytest.approx(0.3 * 2**0.5, rel=0.02)
    late = found["delay"]
    assert late.value is not None
    stage = candidate(quiet, "delay")
    left = left_with(quiet, 1.1 * stage.drive(quiet, quiet.u, (late.value,)))
    assert left == pytest.approx(0.5 * 2.154**0.5, rel=0.1)


def test_a_limit_is_raised_until_the_effect_is_found_and_else_not_reported() -> None:
    data = make()
    _, state = problem_of(replace(data, y=1.1 * data.u))
    others = {c.name for c in list_candidates(data)} - {"coupling"}
    asked: list[float] = []

    def seen(c: Candidate, added: Floats) -> tuple[str, ...]:
        asked.append(float(np.std(added)))
        return ("coupling",) if len(asked) == 2 else ()

    (one,) = limits(state, others, seen)
    assert one.name == "coupling"
    assert asked[1] == pytest.approx(2**0.5 * asked[0], rel=1e-6)
    assert limits(state, others, lambda c, added: ()) == []


def test_a_cause_that_was_found_has_no_limit() -> None:
    data = make(late_s=2e-3)
    problem, state = problem_of(data)
    fit = problem.refit([Effect(candidate(data, "delay"), (2e-3,))])
    names = {
        x.name for x in limits(replace(state, accepted=fit), (), lambda c, added: ("coupling",))
    }
    assert "delay" not in names
    assert "coupling" in names


def creeping(data: Data, gain: float) -> Floats:
    """Return a stage's creep (N,) for this reading: gain log10(1 + t / 0.1 s) of each move."""
    out = np.zeros(data.n)
    for i in range(2):
        k = data.rec == i
        kernel = np.log10(1.0 + np.arange(k.sum()) * DT / 0.1)
        out[k] = gain * np.convolve(np.diff(data.y[k], prepend=data.y[k][0]), kernel)[: k.sum()]
    return out


@pytest.mark.parametrize("gain", [0.0, 0.06], ids=["warming up", "creeping"])
def test_creep_of_an_earlier_move_is_likelier_only_where_the_recorded_moves_creep(
    gain: float,
) -> None:
    """The same slow rise after a move of up to 10 um, another in each recording, with and without
    that creep in the recorded moves."""
    data = make()
    rise = 0.6 * (1.0 - np.exp(-data.t / np.array([1.0, 1.6])[data.rec]))
    problem, state = problem_of(replace(data, y=data.y + rise + creeping(data, gain)))
    worth = {}
    for key in ("creep-earlier", "drift-trend"):
        trial = try_candidate(problem, SIGMA, state.null, candidate(data, key), (0.9, 0.9))
        worth[key] = worth_with_companion(state, trial)
    assert (worth["creep-earlier"] > worth["drift-trend"]) == (gain > 0.0)


def test_creep_of_an_earlier_move_is_refused_where_no_recorded_move_creeps() -> None:
    """Its own curve, so that it fits best; the recorded moves are as large and do not creep. It is
    still reported as what the drift could be: other creep may have ended before the recording."""
    data = make()
    rise = 0.9 * np.log10(1.0 + data.t / 0.9)
    problem, state = problem_of(replace(data, y=data.y + rise))
    trial = try_candidate(problem, SIGMA, state.null, candidate(data, "creep-earlier"), (0.9, 0.9))
    drift = try_candidate(problem, SIGMA, state.null, candidate(data, "drift-trend"), (0.9, 0.9))
    assert trial.fit.sse < drift.fit.sse
    judged = judge(state, trial, misfit_beyond_noise(problem, state.null, SIGMA))
    assert not judged.impossible
    assert judged.refused == "no recorded move creeps as that of an earlier one would imply"
    assert worth_with_companion(state, drift) > 0.0


@pytest.mark.parametrize("gain", [0.002, 0.02])
def test_creep_of_the_recorded_moves_counts_once_it_shows_in_its_own_right(gain: float) -> None:
    """The earlier move is twice as large as the recorded ones."""
    data = make()
    rise = 2.0 * gain * float(np.ptp(data.y)) * np.log10(1.0 + data.t / 0.9)
    problem, state = problem_of(replace(data, y=data.y + rise + creeping(data, gain)))
    trial = try_candidate(problem, SIGMA, state.null, candidate(data, "creep-earlier"), (0.9, 0.9))
    both = fit_with_companion(problem, trial)
    gain_there, earlier = effect_of(both, "creep").theta[0], effect_of(both, "creep-earlier")
    implied = np.abs(both.amplitudes_of(earlier)) / gain_there / float(np.ptp(data.y))
    assert implied.max() < MOST_MOVE
    assert (implausible_with_companion(state, trial, both) == "") == (gain > 0.01)


@pytest.mark.parametrize(("share", "possible"), [(0.99, True), (1.01, False)])
def test_an_earlier_move_is_at_most_four_times_one_from_drive_0(
    share: float, possible: bool
) -> None:
    data = make()
    farthest = float(np.abs(data.u).max()) / float(np.ptp(data.u)) * float(np.ptp(data.y))
    amplitudes = np.array([-share * 0.05 * 4.0 * max(farthest, float(np.ptp(data.y))), 0.1])
    creep = candidate(data, "creep-earlier")
    assert (creep.implausible_with(amplitudes, (0.05, 0.1, 10.0), data) == "") == possible
    assert creep.implausible_with(amplitudes, (), data) != ""


def test_an_explanation_pays_for_each_of_its_parameters() -> None:
    """The logarithm of 3000 samples in noise variances (Schwarz): two times and two amplitudes."""
    data = make()
    problem, state = problem_of(data)
    trial = try_candidate(problem, SIGMA, state.null, candidate(data, "drift-trend"), (0.9, 0.9))
    paid = trial.gain - worth_with_companion(state, trial)
    assert paid == pytest.approx(4 * 8.00637 * SIGMA**2, rel=1e-5)


@pytest.mark.parametrize(
    ("low", "high", "stated"),
    [(0.004, 0.09, False), (0.02, 0.09, True), (-0.01, 0.09, True), (-0.09, -0.004, False)],
)
def test_a_level_is_reported_within_a_factor_of_ten_or_about_zero(
    low: float, high: float, stated: bool
) -> None:
    clip = next(c for c in list_candidates(make()) if c.key == "clip")
    values = {"min_v": Value(0.03, low, high, "v"), "max_v": Value(8.0, 7.9, 8.1, "v")}
    assert unidentified(Effect(clip, (0.03, 8.0)), values) == ([] if stated else ["min_v"])


@pytest.mark.parametrize("count", [2, 3])
def test_beside_three_found_effects_nothing_that_the_drive_causes_is_excluded(count: int) -> None:
    data = make()
    problem, state = problem_of(replace(data, y=1.1 * data.u))
    lines = [Effect(candidate(data, "hum"), (57.3,)), Effect(candidate(data, "coupling-u2_v"))]
    slow = candidate(data, "drift-trend")
    effects = [*lines, Effect(slow, slow.starts(data, data.y)[0])][:count]
    found = replace(state, accepted=problem.solve(effects))
    stated = {x.name for x in limits(found, (), lambda c, added: (c.name,))}
    assert ("delay" in stated) == (count < 3)


def test_of_two_that_are_alike_the_one_that_the_other_makes_up_for_goes_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A warm-up, fitted together with creep of an earlier move: neither is known well next to the
    other, but the warm-up alone is."""
    given, t = [], 4 * DT * np.arange(6000)
    for k in range(2):
        u = (5 + 3 * np.sin(2 * np.pi * (0.4 + 0.1 * k) * t)) * np.clip(t / 0.5, 0, 1)
        y = 1.1 * u + 0.1 * (1.0 - np.exp(-t / 4.0))
        noise = SIGMA * np.random.default_rng(k).standard_normal(t.size)
        given.append(Recording(t, u, y + noise, name=f"r{k}.csv"))
    data = prepare(given)
    problem, state = problem_of(data)
    fit = state.null
    for key in ("drift-trend", "creep-earlier"):
        c = candidate(data, key)
        starts = c.starts(data, state.null.residual(data))
        fits = [problem.refit([*fit.effects, Effect(c, tuple(s))]) for s in starts]
        fit = min(fits, key=lambda f: f.sse)
    monkeypatch.setattr(reported, "TUNING", TUNING._replace(widest=1.08))
    kept = keep_effects_of_known_size(replace(state, accepted=fit)).accepted
    assert kept.effect_keys == ("drift-trend",)


def test_what_explains_another_part_of_the_misfit_is_no_rival() -> None:
    """A delay that removes more than the accepted line and remains when the line is included. A lag
    may replace the delay, whether or not the search had it on its list."""
    late = make(late_s=1e-3)
    line = 0.03 * np.sin(2 * np.pi * 50.0 * late.t)
    data = replace(late, y=late.y + line)
    problem, state = problem_of(data)
    starts = {"hum": (50.0,), "delay": (1e-3,), "lag-drive": (1e-3,), "friction": (0.3, 40.0)}
    trials = [
        try_candidate(problem, SIGMA, state.null, candidate(data, k), s) for k, s in starts.items()
    ]
    assert trials[1].gain > trials[0].gain
    for own, other, stands_for_it in (("hum", "delay", False), ("delay", "lag-drive", True)):
        accepted = problem.refit([Effect(candidate(data, own), starts[own])])
        found = replace(state, accepted=accepted, rounds=[trials])
        untried = replace(found, rounds=[[t for t in trials if t.candidate.key == own]])
        for searched in (found, untried):
            keys = [r.key for r in rivals(searched, accepted.effects[0])]
            assert (other in keys) is stands_for_it
            assert "friction" not in keys  # it has a viscous part, which fits as well as any lag


def test_forms_of_what_the_drive_causes_keep_no_other_cause_off_the_list() -> None:
    data = make()
    late = ("delay", "lag-drive", "lag2-drive", "lag-sensor", "lag2-sensor", "lag-second", "slew")
    keys = ("friction", *late, "coupling-u2_v")
    ranked = [ScreenedCandidate(candidate(data, key), (), 20.0 - k) for k, key in enumerate(keys)]
    listed = [p.candidate.key for p in select_for_refit(ranked, 5)]
    assert listed == ["friction", *late[:5], "coupling-u2_v"]


def test_a_value_that_a_sighting_leaves_open_is_not_reported() -> None:
    delay = candidate(make(), "delay")
    fields = {"place": "drive", "title": "", "equation": "", "source": "", "says": ""}
    seen = {"delay_s": (1e-3, 0.9e-3, 1.1e-3, "s"), "gain": (1.0, -0.2, 2.2, "")}
    values = {key: Value(*interval) for key, interval in seen.items()}
    one = Finding(
        "delay", "delay", share=0.5, evidence={}, parameters=values, ambiguous_with=(), where={},
        **fields,
    )  # fmt: skip
    (reported_,) = with_sighting([one], delay, Sighting((1e-3,), seen, "It is late."))
    assert list(reported_.parameters) == ["delay_s"]
    assert reported_.says == "It is late."
