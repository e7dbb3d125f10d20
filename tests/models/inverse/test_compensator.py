"""The compensator in preview, causal and static mode, on the paper's plant and on random ones."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys
from tests.rigs.random_models import DROUGHT, NEVER, driven, outcome

from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.inverse import sample
from dehyst.models.inverse.choice import MODES
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed, invert_trajectory
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.modelfile import shipped

DT = 1e-3


def _sine(f: float, size: float, seconds: float) -> np.ndarray:
    t = np.arange(round(seconds / DT)) * DT
    return 6.0 - 0.5 * size * np.cos(2 * np.pi * f * t)


def _error(model: Model, drive: np.ndarray, target: np.ndarray, dt: float = DT) -> np.ndarray:
    start = min(max(0.0, model.validity.drive_min), model.validity.drive_max)
    return simulate_hysteresis(model.hysteresis, np.concatenate([[start], drive]), dt)[1:] - target


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(
    ("f", "size", "causal_bar", "preview_bar"),
    [(1, 9, 0.035, 0.008), (5, 6, 0.11, 0.005), (10, 4, 0.26, 0.004), (20, 2, 0.43, 0.004)],
)
def test_tracking_on_the_papers_rate_dependent_plant(
    f: float, size: float, causal_bar: float, preview_bar: float
) -> None:
    model = shipped("paper-eq12")
    target = _sine(f, size, 4 / f if f > 1 else 2.0)
    late = slice(round(1 / f / DT), None)
    errors = {}
    for mode in ("static", "causal", "preview"):
        c = Compensator(model, DT, 0.0, 10.0, 1e4, mode, 0.1)
        errors[mode] = _rms(_error(model, invert_streamed(c, target).drive, target)[late])
    whole = invert_trajectory(Compensator(model, DT, 0.0, 10.0, 1e4), target)
    errors["whole"] = _rms(_error(model, whole.drive, target)[late])
    assert errors["preview"] < preview_bar
    assert errors["causal"] < causal_bar
    assert errors["whole"] < 0.001
    assert errors["preview"] < 0.1 * errors["static"]


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(100_000, 2**31))
def test_limits_hold_and_preview_stays_near_static_on_random_models(seed: int) -> None:
    """Range and slew limits always hold; the error is bounded within the window only, so a rare
    model may lose to the static inverse, but never by much."""
    found = outcome(seed)
    assert found.limits
    assert found.times("preview") <= 3.0


def test_few_random_models_lose_to_the_static_inverse() -> None:
    """New models each time: of about 30 with a full window at most one is worse by more than the
    noise; `python -m tests.benchmarks.models.inverse` tries 5000."""
    seeds = np.random.default_rng().integers(100_000, 2**31, 50)
    found = {int(seed): outcome(int(seed), ("static", "preview")) for seed in seeds}
    worse = [s for s, o in found.items() if o.starving == NEVER and o.excess("preview") > 1.0]
    assert len(worse) < 2, f"seeds {worse}"


@pytest.mark.parametrize("period_s", [2e-4, 1e-3, 5e-3])
def test_a_whole_trajectory_of_steps_is_not_worse_than_the_preview(period_s: float) -> None:
    model = shipped("paper-eq12")
    at = (np.arange(round(0.4 / period_s)) + 0.5) * period_s
    target = 6.0 + np.sign(np.sin(2 * np.pi * 10.0 * at))
    c = Compensator(model, period_s, 0.0, 10.0, 1e4, "preview", 0.1)
    errors = [
        _rms(_error(model, invert(c, target).drive, target, period_s))
        for invert in (invert_trajectory, invert_streamed)
    ]
    assert errors[0] <= errors[1]


@pytest.mark.parametrize("reported", [0, 1, 30])
def test_one_starved_sample_in_a_hundred_does_not_hurt(reported: int) -> None:
    model = shipped("paper-eq12")
    target = _sine(5, 6, 2.0)
    c = Compensator(model, DT, 0.0, 10.0, 1e4, "preview", 0.1)
    errors = []
    for starves in (False, True):
        state, drive = c.init(0.0), np.empty(target.size)
        for i in range(target.size):
            window = target[i : i + c.window_samples]
            n = reported if starves and i % 100 == 57 else window.size
            c.step(state, window, min(n, window.size), np.zeros(0))
            drive[i] = state.drive
            flagged = bool(state.flags & sample.STARVED)
            assert flagged == (n < c.window_samples)
            c.applied(state, drive[i])
        errors.append(_rms(_error(model, drive, target)[200:1900]))
    assert errors[1] == pytest.approx(errors[0], rel=1e-9)


def test_a_stream_that_changes_its_mind_is_believed() -> None:
    """A short window that disagrees with the one before replaces it."""
    model = shipped("paper-eq12")
    target = _sine(5, 6, 0.5)
    c = Compensator(model, DT, 0.0, 10.0, 1e4, "preview", 0.1)
    state = c.init(0.0)
    for i in range(300):
        c.step(state, target[i : i + c.window_samples], c.window_samples, np.zeros(0))
        c.applied(state, state.drive)
    for _ in range(400):
        c.step(state, np.full(1, 5.0), 1, np.zeros(0))
        c.applied(state, state.drive)
        assert state.mode == sample.STATIC
    assert state.predicted == pytest.approx(5.0, abs=0.05)


def test_the_applied_drive_leads_the_model() -> None:
    """A converter of 16 bits follows the compensator: the state follows the converter's output."""
    model = shipped("paper-eq12")
    target = _sine(5, 6, 0.8)
    c = Compensator(model, DT, 0.0, 10.0, 1e4, "preview", 0.1)
    state = c.init(0.0)
    drive = np.empty(target.size)
    for i in range(target.size):
        window = target[i : i + c.window_samples]
        c.step(state, window, window.size, np.zeros(0))
        drive[i] = round(state.drive / 10 * 65535) * 10 / 65535
        c.applied(state, drive[i])
        assert state.drive == drive[i]
    y = simulate_hysteresis(model.hysteresis, np.concatenate([[0.0], drive]), DT)[1:]
    assert state.predicted == pytest.approx(y[-1], abs=1e-9)
    assert _rms((y - target)[300:]) < 0.03


def y_at_rest(model: Model, drive: np.ndarray) -> float:
    return float(simulate_hysteresis(model.hysteresis, np.concatenate([[0.0], drive]), DT)[-1])


def test_preview_runs_dry_and_returns_without_a_jump() -> None:
    model = shipped("paper-eq12")
    target = _sine(5, 6, 2.0)
    c = Compensator(model, DT, 0.0, 10.0, 1e4, "preview", 0.1)
    state = c.init(0.0)
    drive, modes = np.empty(target.size), []
    for i in range(target.size):
        window = target[i : i + c.window_samples]
        n = window.size
        if 600 <= i < 1000:  # the stream runs dry over 100 samples, stops, and comes back
            n = max(0, 700 - i)
        c.step(state, window, min(n, window.size), np.zeros(0))
        drive[i] = state.drive
        modes.append(MODES[state.mode])
        c.applied(state, drive[i])
    assert modes[500] == modes[650] == "preview"
    assert modes[698] == "preview"  # the plan is valid to its end
    assert modes[800] == "hold"
    # The hold fades to where the stage rests at the last target.
    assert np.all(drive[820:1000] == drive[820])
    assert abs(y_at_rest(model, drive[:900]) - target[699]) < 0.03
    quiet = np.abs(np.diff(drive[200:1000]))
    assert quiet.max() < 0.2
    y = simulate_hysteresis(model.hysteresis, np.concatenate([[0.0], drive]), DT)[1:]
    assert _rms((y - target)[1200:]) < 0.03


def test_bad_targets_hold_and_are_flagged() -> None:
    c = Compensator(shipped("paper-eq12"), DT, 0.0, 10.0, 1e4, "preview", 0.05)
    state = c.init(2.0)
    c.step(state, np.full(c.window_samples, np.nan), c.window_samples, np.zeros(0))
    assert state.drive == 2.0
    assert state.flags & sample.BAD_TARGET


def test_targets_beyond_the_range_are_flagged() -> None:
    model = shipped("paper-eq12")
    for mode in ("static", "preview"):
        c = Compensator(model, DT, 0.0, 10.0, 1e4, mode, 0.05)
        result = invert_streamed(c, np.full(400, 20.0))
        assert result.drive[-1] == pytest.approx(10.0, abs=1e-3)
        assert result.flags[-1] & (sample.BEYOND_DRIVE | sample.BEYOND_SATURATION)


def test_the_chooser_says_which_and_why() -> None:
    static = Model(Hysteresis(r=[0.0, 1.0], b=[1.0, 0.2], c=[0.0, 1.0]), Validity(0.0, 10.0))
    paper = shipped("paper-eq12")
    cases = [
        (static, "auto", 0.1, "static", "rate-independent"),
        (paper, "auto", 0.1, "preview", "rate"),
        (paper, "auto", 0.0, "static", "no look-ahead"),
        (paper, "static", 0.1, "static", "asked for"),
        (shipped("paper-eq11"), "auto", 0.1, "static", "not monotone"),
    ]
    for model, wish, preview_s, mode, why in cases:
        c = Compensator(model, DT, 0.0, 10.0, 1e4, wish, preview_s)
        assert c.mode == mode
        assert why in c.reason
        assert (c.latency_s > 0) == (mode == "preview")
    with pytest.raises(BadInput, match="mode"):
        Compensator(paper, DT, 0.0, 10.0, 1e4, "magic")
    with pytest.raises(BadInput, match="drive_min"):
        Compensator(paper, DT, 10.0, 0.0, 1e4)


def _all_rates() -> tuple[Model, ...]:
    """Return the paper's rate-dependent model: bare, and with a delay, creep and a sensor lag."""
    paper = shipped("paper-eq12")
    blocks = (
        Block("delay", "drive", {"delay_s": 2e-3}),
        Block("creep", "stage", {"gain_per_decade": 0.02, "tau_min_s": 0.01, "tau_max_s": 100.0}),
        Block("lag", "sensor", {"tau_s": 1e-3}),
    )
    return paper, replace(paper, blocks=blocks)


@pytest.mark.parametrize("model", _all_rates(), ids=("bare", "blocks"))
@pytest.mark.parametrize("mode", ["static", "causal", "preview"])
def test_the_loop_allocates_nothing(model: Model, mode: str) -> None:
    """numba's own count of allocations in compiled code stays constant over many samples, in plans,
    holds and hand-overs."""
    _nrt_python.memsys_enable_stats()
    target = _sine(5, 6, 1.0)
    target[400:500] += 2.0
    c = Compensator(model, DT, 0.0, 10.0, 1e4, mode, 0.1)
    driven(c, target[:50], DROUGHT, 0.0)  # compiled from here on
    counts = []
    for n in (100, 1000):
        before = rtsys.get_allocation_stats()
        driven(c, target[:n], DROUGHT, 0.0)
        after = rtsys.get_allocation_stats()
        counts.append((after.alloc - before.alloc, after.mi_alloc - before.mi_alloc))
    assert counts[0] == counts[1]  # allocations are per call, not per sample


def test_the_loop_holds_no_memory() -> None:
    """A thousand steps leave nothing allocated: all state is in arrays made once."""
    c = Compensator(shipped("paper-eq12"), DT, 0.0, 10.0, 1e4, "preview", 0.1)
    state = c.init(0.0)
    target = _sine(5, 6, 2.3)
    nothing = np.zeros(0)

    def run(first: int, last: int) -> None:
        for i in range(first, last):
            c.step(state, target[i : i + c.window_samples], c.window_samples, nothing)
            c.applied(state, state.drive)

    run(0, 1100)  # numba keeps a pool of what it wraps
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    run(1100, 2100)
    grown = sum(s.size_diff for s in tracemalloc.take_snapshot().compare_to(before, "filename"))
    tracemalloc.stop()
    assert grown < 5_000
