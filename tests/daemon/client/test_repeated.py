"""A trajectory that is played repeatedly, and what is learned from its telemetry."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.client.learning import LessonTaker, Outputs
from dehyst.daemon.client.repeated import Repeated, on_grid
from dehyst.daemon.files.learned import Learned, read_learned, trajectory_digest, write_learned
from dehyst.daemon.rings.records import TELEMETRY, Flag, State
from dehyst.models.errors import BadInput
from dehyst.models.learning.passes import Learner, Outcome

PERIOD_NS, N = 5_000_000, 200
T = PERIOD_NS * 1e-9 * np.arange(N)
TARGET = 5.0 + np.sin(2 * np.pi * T)


@given(st.integers(1, 4), st.integers(2, 40), st.floats(0.01, 0.5))
def test_the_pieces_are_the_passes_one_behind_the_other(times: int, n: int, span_s: float) -> None:
    t_s = np.cumsum(np.r_[0.3, 0.01 * (1 + np.arange(n - 1) % 3)])
    points, sent, found = Repeated(t_s, np.arange(float(n)), times), 0, []
    while not points.over(sent):
        offsets, values, learned = points.piece(sent, span_s, 1000)
        assert values.size
        assert not learned.any()
        found.append(np.column_stack([offsets * 1e-9, values]))
        sent += values.size
    whole = np.concatenate(found)
    begun, step = t_s - t_s[0], float(np.median(np.diff(t_s)))
    expected = np.concatenate([begun + k * (begun[-1] + step) for k in range(times)])
    np.testing.assert_allclose(whole[:, 0], expected, atol=2e-9 * times)
    np.testing.assert_array_equal(whole[:, 1], np.tile(np.arange(float(n)), times))


@given(st.lists(st.integers(1, 40_000), min_size=1, max_size=8), st.floats(0.01, 3.0), st.data())
def test_points_that_are_far_apart_are_sent_in_short_steps(
    gaps_ms: list[int], span_s: float, data: st.DataObject
) -> None:
    """A daemon refuses a long chunk; the way between two points is the straight line."""
    t_s = np.r_[0.0, np.cumsum(gaps_ms)] * 1e-3
    given_targets = np.array(
        data.draw(st.lists(st.floats(0, 9), min_size=t_s.size, max_size=t_s.size))
    )
    points, sent, times, targets = Repeated(t_s, given_targets, 2), 0, [], []
    while not points.over(sent):
        offsets, values, _ = points.piece(sent, span_s, 1000)
        before = times[-1] if times else offsets[0] * 1e-9
        assert offsets[-1] * 1e-9 - before <= max(span_s, 1.0) + 1.0 + 1e-6
        times += list(offsets * 1e-9)
        targets += list(values)
        sent += values.size
    of_pass = np.array(times[: len(times) // 2])
    assert set(np.round(t_s, 6)) <= set(np.round(of_pass, 6))  # each given point is still reached
    np.testing.assert_allclose(
        targets[: of_pass.size], np.interp(of_pass, t_s, given_targets), atol=1e-6
    )
    np.testing.assert_array_equal(targets[of_pass.size :], targets[: of_pass.size])


def test_times_that_are_not_in_seconds_are_refused() -> None:
    with pytest.raises(BadInput, match="takes 231 days: are its times in seconds"):
        Repeated([0.0, 1e7, 2e7], [1.0, 2.0, 1.0])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("times", "says"),
    [
        ([0.0, math.nan, 1.0], "must be finite and strictly increase"),
        ([0.0, 1.0, math.inf], "must be finite and strictly increase"),
        ([0.0, -1.0, 2.0], "must be finite and strictly increase"),
        ([0.0, 1.0, 1e300], "are its times in seconds"),
        ([0.0, -1e300, 1.0], "must be finite and strictly increase"),
    ],
)
def test_times_that_are_none_are_refused_without_a_warning(times: list[float], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        Repeated(times, [1.0, 2.0, 1.0])


def test_one_without_an_end_ends_with_its_pass() -> None:
    points = Repeated(T, TARGET, 0)
    assert not points.over(10**9)
    offsets, values, _ = points.piece(10 * N + 5, 0.25, 1000)
    assert offsets[0] == 10 * N * PERIOD_NS + 5 * PERIOD_NS
    assert values[0] == TARGET[5]
    points.end(10 * N + 5)
    assert points.over(11 * N)
    assert not points.over(11 * N - 1)


def test_a_pass_on_the_grid_is_a_whole_number_of_periods() -> None:
    coarse = np.arange(0.0, 1.0, 0.0173)
    times, values = on_grid(coarse, np.cos(2 * np.pi * coarse), 0.005)
    np.testing.assert_allclose(np.diff(times), 0.005)
    assert times.size == round((coarse[-1] + 0.0173) / 0.005)
    inside = times <= coarse[-1]
    np.testing.assert_allclose(values[inside], np.cos(2 * np.pi * times[inside]), atol=2e-3)


class Loop:
    """A simulated daemon: turns points into telemetry of a stage whose error repeats with the
    passes."""

    def __init__(self, start_ns: int = 77_000_000) -> None:
        self.learner = Learner(TARGET, PERIOD_NS * 1e-9, 0.02, 1.5)
        self.reported: list[Outcome] = []
        self.taker = LessonTaker(self.learner, TARGET, TARGET, PERIOD_NS, self.reported.append)
        self.points = Repeated(T, TARGET, 0, self.taker.correct)
        self.rng, self.start_ns, self.sent, self.played = np.random.default_rng(3), start_ns, 0, 0
        self.learned = np.zeros(0)
        self.repeats = 0.1 * np.sin(2 * np.pi * 3 * T)

    def go(self, seconds: float, ahead_s: float = 1.0, spoil: int = 0) -> None:
        """Play for `seconds`; points are sent `ahead_s` ahead."""
        last = self.played + round(seconds * 1e9 / PERIOD_NS)
        while self.played < last:
            while self.sent < self.played + round(ahead_s * 1e9 / PERIOD_NS) + 1:
                _, _, learned = self.points.piece(self.sent, 0.25, 1000)
                self.learned = np.concatenate([self.learned, learned])
                self.sent += learned.size
            k = np.arange(self.played, min(self.played + 20, last))
            self.played = int(k[-1]) + 1
            records = np.zeros(k.size, TELEMETRY)
            records["seq"], records["state"] = k + 1000, State.RUNNING
            records["scheduled_ns"] = self.start_ns + k * PERIOD_NS
            records["target"], records["learned"] = TARGET[k % N], self.learned[k]
            off = self.repeats[k % N] + self.learned[k] + self.rng.normal(0.0, 0.02, k.size)
            records["measured"] = records["target"] + off
            if spoil:
                records["flags"][:spoil] = Flag.MISSED
            self.taker.add(records)


def test_the_error_falls_while_points_are_sent_ahead() -> None:
    loop = Loop()
    loop.go(2.0)
    assert not loop.reported  # the trajectory's start is not known yet
    loop.taker.start_ns = loop.start_ns
    loop.go(18.0)
    assert len(loop.reported) == 20
    assert loop.reported[0].rms == pytest.approx(loop.repeats.std(), rel=0.1)
    left = loop.repeats + loop.learned[loop.played - N : loop.played]
    assert left.std() < 0.1 * loop.repeats.std()


def test_corrections_are_faded_in_and_never_step() -> None:
    loop = Loop()
    loop.taker.start_ns = loop.start_ns
    loop.go(15.0)
    smooth = np.abs(np.diff(np.r_[0.0, loop.learned]))
    own = np.abs(np.diff(loop.learner.correction)).max()
    assert smooth.max() < 2.0 * own + 0.02


def test_a_pass_with_missed_samples_is_reported_and_not_learned_from() -> None:
    loop = Loop()
    loop.taker.start_ns = loop.start_ns
    loop.go(5.0)
    loop.go(1.0, spoil=1)
    loop.go(1.0)
    spoiled = [one for one in loop.reported if not one.learned and one.number > 1]
    assert len(spoiled) == 1
    assert "10 of 200 samples" in spoiled[0].says


def test_where_the_loop_held_it_is_not_learned_at_the_wrong_places() -> None:
    """A group holds while one of its axes starves. Everything after that is late, and this is
    reported only some passes later: those passes must not be learned from."""
    loop = Loop()
    loop.taker.start_ns = loop.start_ns
    loop.go(5.0)
    loop.start_ns += 40 * PERIOD_NS
    loop.go(2.5)
    loop.taker.start_ns = loop.start_ns
    loop.go(8.5)
    assert [one.number for one in loop.reported if not one.learned] == [1, 6, 7, 8]
    left = loop.repeats + loop.learned[loop.played - N : loop.played]
    assert left.std() < 0.15 * loop.repeats.std()


def test_a_slow_gauge_is_learned_from_too() -> None:
    """The error is learned even if only every third reading is fresh."""
    loop = Loop()
    loop.taker.start_ns = loop.start_ns
    add = loop.taker.add

    def held(samples: np.ndarray) -> None:
        samples = samples.copy()
        samples["flags"][samples["seq"] % 3 != 0] |= int(Flag.SENSOR_HELD)
        add(samples)

    loop.taker.add = held  # type: ignore[method-assign]
    loop.go(20.0)
    assert all(one.learned for one in loop.reported[1:])
    left = loop.repeats + loop.learned[loop.played - N : loop.played]
    assert left.std() < 0.25 * loop.repeats.std()


def test_what_was_learned_is_kept_for_its_model_and_trajectory_only(tmp_path: Path) -> None:
    path, digest = tmp_path / "scan.learned.json", trajectory_digest(TARGET, 0.005)
    assert read_learned(path, "m1", digest, "um", N) is None
    correction = 0.1 * np.sin(T)
    write_learned(
        path,
        Learned(model="m1", trajectory=digest, period_s=0.005, unit="um", passes=7,
                correction=correction.tolist()),
    )  # fmt: skip
    found = read_learned(path, "m1", digest, "um", N)
    assert found is not None
    np.testing.assert_array_equal(found, correction)
    with pytest.raises(BadInput, match="another model"):
        read_learned(path, "m2", digest, "um", N)
    with pytest.raises(BadInput, match="another trajectory"):
        read_learned(path, "m1", trajectory_digest(TARGET + 1e-9, 0.005), "um", N)
    with pytest.raises(BadInput, match="another unit"):
        read_learned(path, "m1", digest, "nm", N)


@pytest.mark.parametrize("text", ["", "{}", "[1, 2]", '{"format": 1, "x": 2}', "\x00\xff"])
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "no.json"
    path.write_text(text)
    with pytest.raises(BadInput, match=r"no\.json"):
        read_learned(path, "m", "t", "um", N)


@pytest.mark.parametrize("wrong", [[0.0] * (N - 1), [1e999] * N])
def test_corrections_that_do_not_fit_are_refused(tmp_path: Path, wrong: list[float]) -> None:
    path = tmp_path / "no.json"
    good = {"format": 1, "model": "m", "trajectory": "t", "period_s": 0.005, "unit": "um",
            "passes": 1, "correction": wrong}  # fmt: skip
    path.write_text(json.dumps(good))
    with pytest.raises(BadInput):
        read_learned(path, "m", "t", "um", N)


def test_steps_before_each_reading_are_those_of_the_loop_across_the_seam() -> None:
    n, back, rng = 20, 4, np.random.default_rng(5)
    records = np.zeros(3 * n, TELEMETRY)
    woke = np.arange(3 * n) * 0.005 + rng.uniform(0.0, 1e-4, 3 * n)
    records["actual_ns"], records["volts"] = np.round(woke * 1e9), rng.normal(50.0, 5.0, 3 * n)
    records["exec_us"] = rng.uniform(1900.0, 2200.0, 3 * n)
    outputs = Outputs(n, back)
    for of_pass in (1, 2):
        mine = slice(of_pass * n, (of_pass + 1) * n)
        outputs.put(of_pass, records[mine][:7], np.arange(7))
        outputs.put(of_pass, records[mine][7:], np.arange(7, n))
    steps, since_s = outputs.steps_of_pass(2)
    for place in range(n):
        for j in range(1, back + 1):
            at = 2 * n + place - j
            step = records["volts"][at] - records["volts"][at - 1]
            assert steps[place, j - 1] == step
            written = woke[at] + 1e-6 * records["exec_us"][at]
            ago = woke[2 * n + place] - written
            assert since_s[place, j - 1] == pytest.approx(ago, abs=2e-9)
    missed = records[2 * n :].copy()
    missed["flags"][5] = Flag.MISSED
    outputs.put(3, missed, np.arange(n))
    assert np.isnan(outputs.steps_of_pass(3)[0][6:10].sum(axis=1)).all()
