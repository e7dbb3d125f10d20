"""Parts of the diagnosis, compared with the model's blocks, closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis.base import compact_base, rich_base
from dehyst.models.diagnosis.data.locate import hot_spots, locate, seconds_since_turn, time_in_hold
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.effects import Effect, internal_parameters, move_parameters
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import PHYSICS, check_block, list_candidates
from dehyst.models.physics.candidate import Context
from dehyst.models.recording import Recording
from dehyst.models.signals import filters
from dehyst.models.signals.joined import Data
from dehyst.models.signals.lines import find_lines

DT = 1e-3


def two_recordings(n: int = 3000) -> list[Recording]:
    rng = np.random.default_rng(3)
    out = []
    for k in range(2):
        t = np.arange(n) * DT
        u = 5 + 3 * np.sin(2 * np.pi * (0.8 + k) * t) + 1.5 * np.sin(2 * np.pi * 9.3 * t + k)
        u[n // 2 : n // 2 + 600] = u[n // 2]
        u *= np.clip(t / 0.2, 0, 1)
        y = 1.1 * u + 0.02 * rng.standard_normal(n)
        channels = {"temp_c": 22 + t, "u2_v": np.cos(9 * t), "force_n": np.sin(5 * t)}
        out.append(Recording(t, u, y, channels=channels, name=f"r{k}.csv"))
    return out


@pytest.fixture(scope="module")
def data() -> Data:
    return prepare(two_recordings())


STRAIGHT = Hysteresis(r=np.zeros(1), b=np.ones(1), c=np.array([0.0, 1.0]))


def through_model(data: Data, *blocks: Block) -> np.ndarray:
    """Return the output of the model file's blocks after a stage without hysteresis."""
    model = Model(STRAIGHT, Validity(0.0, 10.0), blocks=blocks)
    parts = []
    for i in range(len(data.names)):
        k = data.rec == i
        channels = {name: c[k] for name, c in data.channels.items()}
        parts.append(simulate(model, data.t[k], data.u[k], channels))
    return np.concatenate(parts)


@pytest.mark.parametrize(
    ("key", "theta"),
    [
        ("delay", (2.4e-3,)),
        ("delay", (0.3e-3,)),
        ("lag-drive", (1.7e-3,)),
        ("lag2-sensor", (1.7e-3, 0.4e-3)),
        ("lag-second", (40.0, 0.8)),
        ("slew", (30.0,)),
        ("clip", (1.0, 7.5)),
        ("creep", (0.02, 0.03, 9.0)),
        ("resonance", (80.0, 0.02, 0.7)),
    ],
)
@pytest.mark.parametrize("stepped", [False, True])
def test_candidate_does_what_its_blocks_do(
    data: Data, key: str, theta: tuple[float, ...], stepped: bool
) -> None:
    data = replace(data, stepped=stepped)
    c = next(c for c in list_candidates(data) if c.key == key)
    if c.mode == "drive":
        x = c.drive(data, data.u, theta)
    else:
        x = c.output(data, data.u[:, None], theta)[:, 0]
    y = through_model(data, *c.blocks(theta, np.zeros(0), data))
    np.testing.assert_allclose(x, y, atol=1e-9)


@pytest.mark.parametrize(
    ("key", "theta", "amplitudes"),
    [
        ("coupling-u2_v", (), (0.3,)),
        ("coupling2-u2_v", (0.004,), (0.3, -0.1, 0.2, 0.05, -0.02)),
        ("coupledmode-u2_v", (40.0, 0.03), (0.3, 0.1)),
        ("coupledmode-u2_v", (40.0, 0.03, 90.0, 0.2), (0.3, 0.0, -0.2, 0.05)),
        ("drift-temp_c", (), (0.2, 0.03)),
        ("drift2-temp_c", (0.5,), (0.2, 0.03)),
        ("sensor", (2.5,), (0.02, -0.03)),
        ("friction", (0.1, 20.0), (0.05, 1e-3)),
        ("rate", (0.7, 0.05), (0.01, -0.02, 0.01, 0.3, 0.2, 1e-4, 2e-4, -1e-4, 5e-5, 0.0)),
        ("asymmetry", (0.6,), (0.02, -0.01)),
        ("drift-trend", (2.0, 2.0), (0.4, 0.4)),
    ],
)
def test_columns_add_what_their_blocks_add(
    data: Data, key: str, theta: tuple[float, ...], amplitudes: tuple[float, ...]
) -> None:
    c = next(c for c in list_candidates(data) if c.key == key)
    plain = through_model(data)
    a = np.array(amplitudes)
    added = c.columns(data, Context(data.u, plain), theta) @ a
    y = through_model(data, *c.blocks(theta, a, data))
    np.testing.assert_allclose(y - plain, added, atol=1e-9)


@pytest.mark.parametrize(("turn", "written"), [(0.0, 1), (0.15, 1), (0.4, 0), (1.0, 0), (np.pi, 0)])
def test_a_line_is_written_where_the_recordings_share_its_phase(
    data: Data, turn: float, written: int
) -> None:
    """turn: phase of the second recording relative to the first [rad]. Of 100 pairs of phases at
    random, 13 are within 0.4 rad of each other."""
    (line,) = (c for c in list_candidates(data) if c.key == "hum")
    amplitudes = 0.1 * np.array([1.0, 0.0, np.cos(turn), np.sin(turn)])
    blocks = line.blocks((50.0,), amplitudes, data)
    assert len(blocks) == written
    if written:
        assert blocks[0].params["phase_rad"] == pytest.approx(0.5 * turn, abs=0.05)


def test_a_line_of_one_recording_alone_is_not_written() -> None:
    t = 1e-3 * np.arange(4000)
    u = 5.0 - 5.0 * np.cos(2 * np.pi * t)
    one = prepare([Recording(t, u, u)])
    (line,) = (c for c in list_candidates(one) if c.key == "hum")
    assert line.blocks((50.0,), np.array([0.1, 0.0]), one) == ()


@pytest.mark.parametrize(
    ("key", "theta", "amplitudes"),
    [("drift-trend", (0.9, 60.0), (0.4, 3.0)), ("creep-earlier", (0.2, 2.0), (0.2, 0.1))],
)
def test_a_block_of_two_pasts_comes_as_near_to_both_as_one_amplitude_can(
    data: Data, key: str, theta: tuple[float, float], amplitudes: tuple[float, float]
) -> None:
    """The reference tries many amplitudes; levels are excluded, as no model predicts them."""
    c = next(c for c in list_candidates(data) if c.key == key)
    added = c.columns(data, Context(data.u, data.y), theta) @ np.array(amplitudes)
    (block,) = c.blocks(theta, np.array(amplitudes), data)
    size = next(k for k in block.params if k.startswith("amount"))

    def left(factor: float) -> float:
        params = {**block.params, size: factor * float(block.params[size])}
        off = through_model(data, replace(block, params=params)) - through_model(data) - added
        here = [off[(data.rec == i) & data.rows] for i in range(2)]
        return float(sum(np.sum((x - x.mean()) ** 2) for x in here))

    assert left(1.0) <= min(left(f) for f in (-1.0, 0.0, 0.5, 0.9, 0.99, 1.01, 1.1, 1.5, 2.0))


def test_library_tells_people_what_it_looks_for(data: Data) -> None:
    found = list_candidates(data)
    assert len({c.key for c in found}) == len(found)
    names = {one.name for one in PHYSICS.values()}
    assert {c.name for c in found} == names
    assert [c.order for c in found] == sorted(c.order for c in found)
    for c in found:
        assert all((c.title, c.equation, c.source)), c.key
        assert set(c.confused_with) <= names, c.key
        residual = 0.05 * np.sin(2 * np.pi * 47 * data.t)
        for theta in c.starts(data, residual):
            for p, v in zip(c.params_at(theta), theta, strict=True):
                assert p.low <= v <= p.high, (c.key, p.key, v)
            columns = c.columns(data, Context(data.u, data.y), theta)
            ones = np.ones(columns.shape[1])
            for block in c.blocks(theta, ones, data):
                check_block(block, "v", "um")
            assert c.describe(c.values(theta, ones)).endswith(".")


def test_base_without_columns_is_the_base_with_columns(data: Data) -> None:
    rng = np.random.default_rng(0)
    for base in (rich_base(data), compact_base(data)):
        w = rng.standard_normal(base.width)
        columns = base.columns(data.u, data.starts)
        np.testing.assert_allclose(
            columns @ w, base.combine(data.u, data.starts, w), rtol=0, atol=1e-9
        )


def test_base_does_not_know_the_rate() -> None:
    rng = np.random.default_rng(1)
    u = np.cumsum(rng.standard_normal(400))
    slow = np.interp(np.arange(0, 399.001, 0.25), np.arange(400), u)
    one = np.zeros(400, dtype=bool)
    four = np.zeros(slow.size, dtype=bool)
    one[0] = four[0] = True
    base = rich_base(prepare(two_recordings()))
    np.testing.assert_allclose(base.columns(u, one), base.columns(slow, four)[::4], atol=1e-9)


def test_noise_is_found_beside_lines_and_slow_moves(data: Data) -> None:
    rng = np.random.default_rng(2)
    residual = (
        0.03 * rng.standard_normal(data.n)
        + 0.4 * np.sin(2 * np.pi * 50 * data.t)
        + 0.3 * np.sin(2 * np.pi * 0.7 * data.t)
        + 0.2 * np.sin(2 * np.pi * 310 * data.t)
    )
    assert noise_rms(data, residual) == pytest.approx(0.03, rel=0.05)


def test_lines_are_found_and_nothing_in_noise(data: Data) -> None:
    rng = np.random.default_rng(4)
    noise = 0.03 * rng.standard_normal(data.n)
    assert find_lines(data, noise) == []
    lines = find_lines(data, noise + 0.02 * np.sin(2 * np.pi * 61.3 * data.t + 2.0 * data.rec))
    assert lines == [pytest.approx(61.3, abs=0.1)]
    assert find_lines(data, noise + 0.2 * (data.u - 5)) == []  # lines of the drive itself


def test_misfit_is_located_where_it_was_put(data: Data) -> None:
    rng = np.random.default_rng(5)
    residual = 0.01 * rng.standard_normal(data.n)
    hold = time_in_hold(data)
    residual[hold > 0.3] += 0.1
    tables = locate(data, residual, 0.01)
    late = np.array(tables["in_hold"]["edges"][1:]) > 0.31
    assert np.array(tables["in_hold"]["share"])[late].sum() > 0.95
    assert tables["direction"]["share"][1] > 0.95
    assert "in_hold" in hot_spots(tables)
    quiet = locate(data, 0.01 * rng.standard_normal(data.n), 0.01)
    assert hot_spots(quiet).keys() <= {"channel"}


def test_since_turn_by_brute_force(data: Data) -> None:
    k = data.rec == 1
    ours = seconds_since_turn(data)[k]
    u, t = data.u[k], data.t[k]
    smooth = slice(700, 1400)  # two sines without a rest
    turns = [i for i in range(1, 1500) if (u[i] - u[i - 1]) * (u[i + 1] - u[i]) < 0]
    for i in range(smooth.start, smooth.stop, 17):
        last = max(j for j in turns if j <= i)
        if abs(u[i] - u[last]) > 0.03:  # further than the margin: the turn is known
            assert ours[i] == pytest.approx(t[i] - t[last], abs=1.5e-3)


def test_parameters_move_inside_their_bounds(data: Data) -> None:
    c = next(c for c in list_candidates(data) if c.key == "resonance")
    (e,) = move_parameters(
        [Effect(c, (80.0, 0.02, 0.9))],
        internal_parameters([Effect(c, (80.0, 0.02, 0.9))]),
        np.array([0.1, -20.0, 5.0]),
    )
    assert e.theta == (pytest.approx(80 * np.exp(0.1)), 5e-4, 1.0)


def test_joint_refit_finds_delay_behind_a_wrong_base() -> None:
    recordings = []
    for r in two_recordings():
        late = np.interp(r.t_s - 1.9e-3, r.t_s, r.drive)
        y = np.tanh(late / 8) * 9 + 0.1 * late**2 / 10
        recordings.append(Recording(r.t_s, r.drive, y + 1e-4 * np.sin(7e3 * r.t_s), name=r.name))
    data = prepare(recordings)
    problem = Problem(data, rich_base(data))
    delay = next(c for c in list_candidates(data) if c.key == "delay")
    fit = problem.refit([Effect(delay, (0.6e-3,))], rounds=8, settle=0.0)
    assert fit.effects[0].theta[0] == pytest.approx(1.9e-3, rel=0.01)


def test_gaps_start_a_new_part_and_unknown_history_is_left_out() -> None:
    r = two_recordings()[0]
    keep = np.r_[0:1000, 1200:3000]
    cut = Recording(r.t_s[keep], r.drive[keep], r.displacement[keep], name="gap.csv")
    data = prepare([cut])
    assert np.flatnonzero(data.starts).tolist() == [0, 1000]
    assert data.rows[:1000].all()  # starts at rest at the lowest drive
    assert not data.rows[1000]  # after the gap the loop is not known at first
    x = np.ones((data.n, 1))
    x[1000:] = 2.0
    lowpassed = filters.lowpass(x, data.dt / 0.1, data.starts)
    np.testing.assert_array_equal(lowpassed, x)  # filters start settled after the gap
