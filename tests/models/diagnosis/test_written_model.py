"""The written augmented model contains the shape that was found, and stays bounded everywhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.hardware_stages import make_rig
from tests.rigs.plants.drives import small_scan
from tests.rigs.plants.hysteresis import preisach

from dehyst.daemon.api.prediction import predict
from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis, diagnose, written_model
from dehyst.models.diagnosis.augment import REACH_S, build_augmented_model, slow_sweeps
from dehyst.models.diagnosis.base import no_base, rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.diagnosed_model import THRESHOLDS, DiagnosedModel, fit_plain_model
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.findings.weigh import Conclusion
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.held_out import (
    HeldOutErrors,
    Refitted,
    WritableFit,
    make_held_out_groups,
)
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.diagnosis.verdict import is_shape_known_here_only
from dehyst.models.diagnosis.written_model import (
    WrittenModel,
    add_model_prior,
    choose_written_model,
)
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps, loads
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording

DT, NOISE, LEVEL, SWING = 2e-3, 0.01, 6.0, 2.5


def scan(seed: int) -> Recording:
    """Return a scan of a Preisach stage about a level that it reached from 0, unrecorded."""
    t = DT * np.arange(4000)
    u = small_scan(LEVEL, SWING)(np.random.default_rng(seed), t, DT)
    way = np.linspace(0.0, LEVEL, 200)
    y = preisach(np.random.default_rng(5))(np.append(way, u))[way.size :]
    noise = NOISE * np.random.default_rng(seed + 10).standard_normal(u.size)
    return Recording(t, u, y + noise, name=f"scan {seed}")


def recorded() -> list[Recording]:
    """Return two scans; the second one's recorder has jittering stamps and misses readings."""
    one, other = scan(1), scan(2)
    rng = np.random.default_rng(3)
    y = np.array(other.displacement)
    y[rng.permutation(y.size)[:5]] = np.nan
    stamps = other.t_s + 0.2 * DT * rng.uniform(-1.0, 1.0, y.size)
    return [one, replace(other, t_s=stamps, displacement=y)]


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(recorded())


def test_the_shape_is_in_the_augmented_model(found: Diagnosis) -> None:
    shape = next(f for f in found.findings if f.name == "shape")
    assert "The augmented model contains it" in shape.says
    for view in found.views:
        k = view.counted
        assert np.std((view.displacement - view.augmented)[k]) < 1.3 * NOISE
        assert np.std((view.displacement - view.base)[k]) > 2.0 * NOISE


def test_on_the_way_up_that_nobody_has_seen_it_stays_near_the_model_in_use(
    found: Diagnosis,
) -> None:
    low, high = LEVEL - SWING, LEVEL + SWING
    u = np.concatenate([np.linspace(a, b, 300) for a, b in ((low, high), (high, low))])
    with_all, in_use = (simulate(m, 0.05, u) for m in (found.model, found.base_model))
    stroke = float(np.ptp(found.views[0].displacement))
    assert np.abs(with_all - in_use).max() < 0.3 * stroke


def test_rows_that_were_not_recorded_cost_the_recorded_ones_next_to_nothing() -> None:
    """The recordings show only the loops, not the move to their level."""
    data = prepare([scan(1), scan(2)])
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    free = Problem(data, rich_base(data), diagnosed)
    held = add_model_prior(free, 0.01)
    u = slow_sweeps(data)
    in_use = simulate(diagnosed.model, REACH_S, u)
    left, off = [], []
    for problem in (free, held):
        fit = problem.solve([])
        left.append(float(np.std(fit.residual(data)[data.rows])))
        there = simulate(build_augmented_model(problem, fit), REACH_S, u) - in_use
        off.append(float(np.ptp(there)) / float(np.ptp(data.y)))
    assert left[1] < 1.03 * left[0]
    assert off[1] < 0.3
    assert off[0] > 2.0 * off[1]


def test_the_lightest_pull_holds_a_shape_where_nothing_was_recorded() -> None:
    """The scans show small loops about a level. A sine that grows from rest to the whole of their
    range is predicted as well as by the model in use, by the first of the pulls that are tried."""
    data = prepare([scan(1), scan(2)])
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    free = Problem(data, rich_base(data), diagnosed)
    lightly = add_model_prior(free, TUNING.leanings[0])
    t = DT * np.arange(6000)
    sine = LEVEL - SWING * np.cos(2 * np.pi * 1.1 * t) * (0.3 + 0.7 * t / t[-1])
    way = np.linspace(0.0, sine[0], 200)
    u = np.append(way, sine)
    y = preisach(np.random.default_rng(5))(u)

    def error(model: Model) -> float:
        return float(np.std((y - simulate(model, DT, u))[way.size :]))

    freely, held = (problem.solve([]) for problem in (free, lightly))
    assert held.sse < 1.002 * freely.sse
    in_use = error(diagnosed.model)
    assert error(build_augmented_model(free, freely)) > 5.0 * in_use
    assert error(build_augmented_model(lightly, held)) < 1.5 * in_use


@pytest.mark.parametrize("changes", [False, True])
def test_a_model_that_predicts_no_other_recording_is_not_written(changes: bool) -> None:
    """The gain steps within each recording, at another time and by another amount: the base fits
    this as a loop that no other recording has."""
    given = []
    for seed in (1, 2, 3):
        one = scan(seed)
        late = np.arange(one.size) > 700 * seed
        gain = 1.0 + changes * 0.06 * (-1) ** seed * late
        given.append(replace(one, displacement=one.displacement * gain))  # type: ignore[operator]
    data = prepare(given)
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    problem = Problem(data, rich_base(data), diagnosed)
    bare = Problem(data, no_base(data), replace(diagnosed, carries=True))
    fit = problem.solve([])
    weighed = Conclusion((), problem, fit, 0.0, 0.0)
    written = choose_written_model(data, bare, weighed, NOISE)
    assert written.gained is not changes
    assert (written.model is diagnosed.model) is changes
    assert written.held.mean_square <= written.held_in_use.mean_square


def test_a_model_is_written_from_the_other_rows_alone() -> None:
    """Its weights are those of a fit without the rows that are left out."""
    data = prepare([scan(1), scan(2), scan(3)])
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    problem = Problem(data, rich_base(data), diagnosed)
    here = data.rec == 1
    fit = problem.solve([])
    without = Problem(replace(data, rows=data.rows & ~here), rich_base(data), diagnosed)
    u = np.linspace(LEVEL - SWING, LEVEL + SWING, 200)
    ours = simulate(WritableFit(problem, fit, True).write_without(here), DT, u)
    theirs = simulate(build_augmented_model(without, without.solve([])), DT, u)
    assert np.std(ours - theirs) < 1e-3 * NOISE
    assert np.std(ours - simulate(build_augmented_model(problem, fit), DT, u)) > 0.03 * NOISE


@pytest.mark.parametrize("carries", [False, True])
def test_a_refitted_hysteresis_follows_the_fit_whatever_carries_it(carries: bool) -> None:
    data = prepare(recorded())
    plain = fit_plain_model(data, THRESHOLDS * data.span)
    problem = Problem(data, rich_base(data), DiagnosedModel(plain, carries=carries))
    model = Refitted(problem, problem.solve([]), False).write()
    before, after = (
        float(np.std((data.y - DiagnosedModel(one, carries=True).predict(data))[data.rows]))
        for one in (plain, model)
    )
    assert after < 1.2 * before < 0.1 * float(np.std(data.y))


def test_the_error_of_each_recording_left_out_is_known() -> None:
    """Of three scans the second is of a stage whose gain has changed."""
    given = [scan(1), scan(2), scan(3)]
    given[1] = replace(given[1], displacement=1.05 * given[1].displacement)  # type: ignore[operator]
    data = prepare(given)
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    problem = Problem(data, rich_base(data), diagnosed)
    left = make_held_out_groups(problem, data.u).held_out_errors(lambda here: diagnosed.model)
    error = data.y - diagnosed.predict(data)
    each = [float(np.std(error[(data.rec == i) & data.rows])) for i in range(3)]
    assert each[1] == max(each) > 1.2 * min(each)
    assert left.of_each == pytest.approx(each, rel=1e-6)
    assert left.mean_square < left.of_each[1] ** 2


@pytest.mark.parametrize(("samples_per_period", "groups"), [(10, 2), (1000, 10)])
def test_blocks_that_repeat_each_other_are_left_out_together(
    samples_per_period: int, groups: int
) -> None:
    """Of two sizes of a loop that is read at ten places a block tells nothing that others do not;
    read densely, the noise and the places of each differ."""
    u = 5.0 + 4.0 * np.sin(2 * np.pi * np.arange(3000) / samples_per_period)
    noise = NOISE * np.random.default_rng(1).standard_normal(u.size)
    given = [
        Recording(DT * np.arange(u.size), size * u, size * u + noise, name=f"{size}")
        for size in (1.0, 0.8)
    ]
    data = prepare(given)
    problem = Problem(data, rich_base(data))
    held_out = make_held_out_groups(problem, data.u)
    assert len(held_out.groups) == groups


def test_a_line_whose_phase_no_model_knows_is_left_in_what_is_explained() -> None:
    """Hum of two noises in each of three scans: it is named, and the written model, which is judged
    by the readings as they are, leaves it."""
    given = []
    for seed in (1, 2, 3):
        one = scan(seed)
        hum = 2.0 * np.sqrt(2.0) * NOISE * np.sin(2 * np.pi * 50.0 * one.t_s + 2.0 * seed)
        assert one.displacement is not None
        given.append(replace(one, displacement=one.displacement + hum))
    found = diagnose_without_limits(given)
    assert [f.name for f in found.findings if f.name != "shape"] == ["hum"]
    assert found.verdict == "partly"
    assert found.rms["heldout_augmented"] > 2.0 * NOISE


def test_no_recording_may_become_worse() -> None:
    """That of the largest error hides what becomes of the others."""
    in_use = HeldOutErrors(1.0, (0.9, 0.04, 0.04))
    better = HeldOutErrors(0.8, (0.8, 0.045, 0.04))
    hidden = HeldOutErrors(0.7, (0.7, 0.17, 0.04))
    assert not better.worsens(in_use, 0.01)
    assert hidden.worsens(in_use, 0.01)


def test_the_stated_errors_are_those_of_the_written_file(found: Diagnosis) -> None:
    """The file is read back and run on the original recordings, jitter and gaps included."""
    for kind, model in (("model", found.base_model), ("augmented", found.model)):
        for view, one in zip(found.views, recorded(), strict=True):
            assert one.displacement is not None
            left = one.displacement - predict(loads(dumps(model)), one).displacement
            error = float(np.std(left[view.counted]))
            assert found.rms[kind][one.name] == pytest.approx(error, rel=1e-6)


def test_the_written_file_claims_what_was_found_and_where(found: Diagnosis) -> None:
    """`validate` compares with these figures; without them it has nothing to judge by."""
    model = loads(dumps(found.model))
    assert model.fit.rms == pytest.approx(found.before_after[1], rel=1e-6)
    assert model.fit.holdout_rms == pytest.approx(found.rms["heldout_augmented"], rel=1e-6)
    assert model.fit.noise_rms == pytest.approx(found.noise, rel=1e-6)
    range_ = model.validity
    assert 0.0 < (range_.band_hz or 0.0) < 0.5 / (range_.period_s or 1.0)
    assert (range_.slowest_s or 0.0) > 0.0


def test_rows_without_a_channel_count_for_neither_model() -> None:
    """The written model drifts with the temperature, which was not read in three rows."""
    one = scan(1)
    assert one.displacement is not None
    temp_c = 20.0 + np.sin(2.0 * np.pi * one.t_s / 3.0)
    y = one.displacement + 0.3 * (temp_c - 20.0)
    temp_c[[100, 2000, 3999]] = np.nan
    found = diagnose_without_limits([replace(one, displacement=y, channels={"temp_c": temp_c})])
    assert found.findings[0].name in ("drift", "coupling")
    (view,) = found.views
    assert view.counted.sum() == np.isfinite(view.base + view.augmented)[view.counted].sum()
    for figure in (*found.before_after, loads(dumps(found.model)).fit.rms):
        assert figure is not None
        assert np.isfinite(figure)


@pytest.mark.parametrize("share", [1.0, 0.1])
def test_a_mode_behind_held_commands_is_written_as_it_was_fitted(share: float) -> None:
    """Each command is held from the sample before: the drive takes steps between samples."""
    t, rng = 1e-3 * np.arange(6000), np.random.default_rng(6)
    tones = ((1.3, 3.0), (7.7, 1.0), (23.0, 0.5), (41.0, 0.3), (83.0, 0.1))
    u = 5.0 + sum(size * np.sin(2 * np.pi * (f * t + rng.random())) for f, size in tones)
    u = u + np.where(t % 0.5 < 0.25, 2.0, 0.0)
    w = 2 * np.pi * 60.0
    system = ([w**2], [1.0, 0.06 * w, w**2])
    held = signal.lsim(system, np.append(u[1:], u[-1]) - u[0], t, interp=False)[1]
    y = (1.0 - share) * (u - u[0]) + share * held + 1e-3 * rng.standard_normal(t.size)
    data = prepare([Recording(t, u, y)])
    (mode,) = (c for c in list_candidates(data) if c.key == "resonance")
    problem = Problem(data, rich_base(data)).with_zero_order_hold()
    fitted = problem.refit([Effect(mode, (60.0, 0.03, share))])
    written = loads(dumps(build_augmented_model(problem, fitted)))
    left = data.y - simulate(written, 1e-3, u)
    assert float(np.std(left[data.rows])) < 1.1e-3


def test_a_model_in_use_that_leaves_the_range_does_not_keep_a_better_one_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each model, that in use too, is said to diverge."""
    data = prepare([scan(1), scan(2), scan(3)])
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    problem = Problem(data, rich_base(data), diagnosed)
    bare = Problem(data, no_base(data), replace(diagnosed, carries=True))
    monkeypatch.setattr(written_model, "is_within_reach", lambda model, data: False)
    weighed = Conclusion((), problem, problem.solve([]), 0.0, 0.0)
    assert choose_written_model(data, bare, weighed, NOISE).gained


@pytest.mark.parametrize("times", [1.4, 1.6])
def test_a_shape_less_certain_elsewhere_than_the_model_in_use_is_wrong_is_not_written(
    monkeypatch: pytest.MonkeyPatch, times: float
) -> None:
    """Its uncertainty on other loops is said to be this many times the misfit of the model in use;
    the limit is 1.5."""
    data = prepare([scan(1), scan(2), scan(3)])
    diagnosed = DiagnosedModel(fit_plain_model(data, THRESHOLDS * data.span))
    problem = Problem(data, rich_base(data), diagnosed)
    bare = Problem(data, no_base(data), replace(diagnosed, carries=True))
    weighed = Conclusion((), problem, problem.solve([]), 0.0, 0.0)
    held = choose_written_model(data, bare, weighed, NOISE).held_in_use
    misfit = float(np.sqrt(held.mean_square - NOISE**2))
    monkeypatch.setattr(written_model, "_jackknife_elsewhere", lambda *_: times * misfit)
    written = choose_written_model(data, bare, weighed, NOISE)
    assert written.contains_shape is (times < 1.5)
    assert (written.model is diagnosed.model) is (times > 1.5)


def test_hum_in_a_servo_is_named_and_its_phase_is_not_written() -> None:
    """A Bouc-Wen loop under an integrating controller that sees the hum and drives against it: each
    recording has a phase of its own, and the held-out drive has no hum."""
    case = make_rig(7, 0)
    found = diagnose_without_limits(case.given)
    assert "hum" in {f.name for f in found.findings}
    assert not {"resonance", "lag", "delay"} & {f.name for f in found.findings}
    assert "hum" not in {b.kind for b in found.model.blocks}
    in_use, written = (
        float(np.std(case.held.displacement - predict(m, case.held).displacement))  # type: ignore[operator]
        for m in (found.base_model, found.model)
    )
    assert in_use > 2.5 * case.noise
    assert written < 0.5 * case.noise


@pytest.mark.parametrize("number", [4, 40])
def test_an_effect_of_another_size_in_each_recording_is_not_named(number: int) -> None:
    """The preload changes within each recording, which no effect of the library does. A creep or a
    drift that imitates it would need half the size in one recording and twice in the next, and
    predicts another drive no better than the model in use."""
    case = make_rig(415823, number)
    found = diagnose_without_limits(case.given)
    assert {f.name for f in found.findings} == {"shape", "unknown"}
    in_use, written = (
        float(np.std(case.held.displacement - predict(m, case.held).displacement))  # type: ignore[operator]
        for m in (found.base_model, found.model)
    )
    assert written < in_use + 0.1 * case.noise


def test_what_is_left_in_rows_left_out_is_not_explained() -> None:
    """A lag after a loop of another class, with noise of a twenty-thousandth of the stroke: by far
    the most is explained, but a residual of several times the noise is not."""
    case = make_rig(7, 21)
    found = diagnose_without_limits(case.given)
    assert "lag" in {f.name for f in found.findings}
    assert found.rms["heldout_augmented"] < 0.2 * found.rms["heldout_model"]
    assert found.rms["heldout_augmented"] > 2.0 * case.noise
    assert found.verdict == "partly"


@pytest.mark.parametrize(
    ("before", "left", "removed", "explained"),
    [
        (3.0, 1.22, 0.0, True),
        (3.0, 1.23, 0.0, False),  # more than half of the noise's power in addition to it
        (3.0, 1.22, 0.1, False),
        (1.3, 1.22, 0.0, False),  # most of what the model in use left
        (1.11, 1.1, 0.0, True),  # next to nothing
    ],
)
def test_no_more_than_part_of_the_noise_may_be_left_in_addition_to_it(
    before: float, left: float, removed: float, explained: bool
) -> None:
    in_use, held = (HeldOutErrors(rms**2, (rms, rms)) for rms in (before, left))
    data = prepare(recorded())
    model = fit_plain_model(data, THRESHOLDS * data.span)
    assert WrittenModel(model, held, in_use, gained=True).explains(1.0, removed) is explained


@pytest.mark.parametrize(
    ("before", "left", "explained"), [(1.11, 1.1, False), (1.3, 1.1, True), (3.0, 1.13, False)]
)
def test_of_one_recording_most_of_what_was_left_must_be_explained(
    before: float, left: float, explained: bool
) -> None:
    """Blocks of the same drive are predicted by any model that fits it; 1.8 and 3.1 noises of
    another drive were left."""
    in_use, held = (HeldOutErrors(rms**2, (rms,)) for rms in (before, left))
    model = fit_plain_model(data := prepare(recorded()), THRESHOLDS * data.span)
    assert WrittenModel(model, held, in_use, gained=True).explains(1.0, 0.0) is explained


@pytest.mark.parametrize(("alone", "explained"), [(None, True), (1.41, True), (1.42, False)])
def test_half_of_the_rows_may_leave_twice_the_power_beyond_the_noise(
    alone: float | None, explained: bool
) -> None:
    in_use, held = (HeldOutErrors(rms**2, (rms, rms)) for rms in (3.0, 1.2))
    power = None if alone is None else alone**2
    data = prepare(recorded())
    model = fit_plain_model(data, THRESHOLDS * data.span)
    one = WrittenModel(model, held, in_use, gained=True, alone=power)
    assert one.explains(1.0, 0.0) is explained


@pytest.mark.parametrize(
    ("recordings", "contained", "share", "only_here"),
    [(1, True, 0.2, True), (2, False, 0.2, True), (2, True, 0.2, False), (1, True, 0.05, False)],
)
def test_the_shape_of_one_recording_says_nothing_for_another_waveform(
    recordings: int, contained: bool, share: float, only_here: bool
) -> None:
    data, in_use = prepare([scan(k) for k in range(recordings)]), HeldOutErrors(1.0, (1.0,))
    model = fit_plain_model(data, THRESHOLDS * data.span)
    written = WrittenModel(model, in_use, in_use, contains_shape=contained)
    shape = Finding("shape", "shape", "stage", "", "", "", share, {}, {}, (), {}, "")
    assert is_shape_known_here_only(data, written, [shape]) is only_here


def test_a_part_that_gives_a_value_that_no_model_may_have_costs_that_choice_alone() -> None:
    """A thermometer that hardly moves: the gain changes by 1.98 per kelvin that it shows; a model
    may have 2, and the fit with one recording left out exceeds that."""
    given = []
    for k in range(2):
        one = scan(k)
        assert one.displacement is not None
        shown = 0.003 * np.sin(2 * np.pi * one.t_s / 7.3 + k)
        y = one.displacement * (1.0 + 1.98 * shown)
        given.append(replace(one, displacement=y, channels={"temp_c": 22.0 + shown}))
    d = diagnose_without_limits(given)
    assert "drift" in {f.name for f in d.findings}
    assert d.rms["heldout_augmented"] < d.rms["heldout_model"]


def record_ringing(period_s: float) -> Recording:
    """Return a triangle of this period on a Preisach stage with a mode at 37 Hz."""
    t = 1e-3 * np.arange(5000)
    u = 3.0 + 2.0 * signal.sawtooth(2 * np.pi * t / period_s, 0.5)
    still = preisach(np.random.default_rng(5))(u)
    w = 2 * np.pi * 37.0
    mode = signal.lti([w * w], [1.0, 2 * 0.02 * w, w * w])
    y = still[0] + signal.lsim(mode, still - still[0], t)[1]
    noise = NOISE * np.random.default_rng(int(1e3 * period_s)).standard_normal(t.size)
    return Recording(t, u, y + noise, name=f"triangle of {period_s} s")


@pytest.mark.parametrize("periods", [(0.2,), (0.2, 0.31)])
def test_a_mode_is_written_where_it_is_seen_at_more_than_one_periods_harmonics(
    periods: tuple[float, ...],
) -> None:
    found = diagnose_without_limits([record_ringing(one) for one in periods])
    (mode,) = (f for f in found.findings if f.name == "resonance")
    assert ("record drives of several periods" in mode.says) == (len(periods) == 1)
    assert ("resonance" in [block.kind for block in found.model.blocks]) == (len(periods) > 1)
    assert (found.verdict == "explained") == (len(periods) > 1)
