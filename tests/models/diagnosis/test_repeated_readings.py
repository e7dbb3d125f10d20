"""A reading counts once, at the row at which it was taken, however irregularly it is repeated; and
what only looks like a repeat, or like a lone wild reading, is left."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.models.diagnosis.test_diagnosed_model import (
    DT,
    NOISE_UM,
    N,
    dead_bands,
    drive,
    plain,
    recordings,
)
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.identify import identify
from dehyst.models.physics.clip import Clip
from dehyst.models.recording import Recording
from dehyst.models.signals.drive_segments import find_turns

T = np.arange(N) * DT
SLOW = 5.0 + 4.0 * np.sin(2 * np.pi * 0.7 * T) * np.cos(2 * np.pi * 0.13 * T)
FAST = 5.0 + 4.0 * np.sin(2 * np.pi * 17.0 * T)
HOLDS = np.repeat(np.random.default_rng(2).uniform(0, 9, N), 2 + np.arange(N) * 3 % 7)[:N]
MONITOR = 0.003 * np.random.default_rng(3).standard_normal(N)


def ramps(hold_s: float) -> np.ndarray:
    """Return holds of up to that length, and ramps of 20 ms between them."""
    times = np.cumsum(np.outer(np.arange(400) * 5 % 8 / 8 + 1, [hold_s / 2, 0.01]).ravel())
    return np.interp(T, times, np.repeat(np.arange(401) * 7.3 % 9.7, 2)[1:801])


def dead_bands_only(u: np.ndarray, width: float) -> np.ndarray:
    """Return a stage that does not move for that part of the drive [V] after each turn."""
    return dead_bands(u, (width / 2,), (1.0,))


def repeated(y: np.ndarray, most: int, share: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a reading whose values stand for 2 to `most` rows each, or for one row in all but a
    share of the cases, and which rows repeat."""
    rng, out, at = np.random.default_rng(4), np.array(y), 0
    again = np.zeros(y.size, dtype=bool)
    while at < y.size:
        size = int(rng.integers(2, most + 1)) if rng.random() < share else 1
        out[at : at + size] = y[at]
        again[at + 1 : at + size] = True
        at += size
    return out, again


@pytest.mark.parametrize(("most", "share"), [(5, 1.0), (12, 1.0), (2, 0.5), (4, 0.05)])
@pytest.mark.parametrize("u", [drive(0), ramps(0.2), drive(1) + MONITOR, HOLDS])
@pytest.mark.parametrize("step", [0.0, 5e-4])
def test_a_reading_that_is_repeated_at_irregular_intervals_counts_once(
    u: np.ndarray, most: int, share: float, step: float
) -> None:
    y = plain(u) + NOISE_UM * np.random.default_rng(1).standard_normal(N)
    y, again = repeated(np.round(y / step) * step if step else y, most, share)
    data = prepare([Recording(T, u, y)])
    chance = 0 if not step else N * step / NOISE_UM / 3
    assert again.sum() <= data.repeats <= again.sum() + chance
    assert not np.any(data.rows[again])
    assert data.missing == data.frozen == data.lone == 0


def behind(u: np.ndarray) -> np.ndarray:
    """Return the mean of the last ten rows, to 1 nm."""
    return np.round(np.convolve(np.r_[np.zeros(9), u], np.full(10, 0.1), "valid"), 3)


@pytest.mark.parametrize(
    ("u", "y"),
    [
        (drive(0), np.round(recordings(plain)[0].displacement / 0.01) * 0.01),
        (drive(0), np.round(recordings(plain)[0].displacement / 0.15) * 0.15),
        (FAST, np.round(FAST / 0.03) * 0.03),  # without noise, in steps
        (SLOW, np.round(SLOW / 0.05) * 0.05),
        (SLOW, np.round(dead_bands_only(SLOW, 1.5) / 0.002) * 0.002),
        (FAST, dead_bands_only(FAST, 0.3)),
        (FAST, np.minimum(FAST, 8.9)),
        (HOLDS, HOLDS),
        (HOLDS, np.r_[HOLDS[:1], HOLDS[:-1]]),  # read before the drive is set
        (HOLDS, np.round((HOLDS + MONITOR) / 0.05) * 0.05),  # and a few are at the edge of a step
        (HOLDS + MONITOR, np.round(HOLDS / 0.003) * 0.003),  # in steps coarser than the noise
        (ramps(0.06), behind(ramps(0.06))),
        (ramps(0.03), behind(ramps(0.03))),
    ],
    ids=range(13),
)
def test_what_stays_for_another_reason_is_no_repeat(u: np.ndarray, y: np.ndarray) -> None:
    assert prepare([Recording(T, u, y)]).repeats == 0


def test_of_repeated_readings_no_lag_is_made() -> None:
    given = [
        Recording(one.t_s, one.drive, repeated(one.displacement, 5)[0], name=one.name)
        for one in recordings(plain)
    ]
    d = diagnose_without_limits(given, identify(recordings(plain, seed=1)).model)
    assert d.verdict == "clean"
    assert not {f.name for f in d.findings} & {"lag", "delay", "unknown"}
    assert d.noise == pytest.approx(NOISE_UM, rel=0.1)
    assert any("samples repeat the previous reading" in said for said in d.data.says)


@pytest.mark.parametrize("wild", [0, 4])
def test_a_turn_of_the_motion_is_no_lone_reading(wild: int) -> None:
    """An amplifier follows at 400 V/s: the stage turns sharply, at another time than its drive."""
    u, late = 5.0 + 3.0 * np.sin(2 * np.pi * 31.0 * T) * np.sin(2 * np.pi * 0.4 * T), np.zeros(N)
    for i in range(1, N):
        late[i] = late[i - 1] + np.clip(u[i] - late[i - 1], -0.4, 0.4)
    y = plain(late) + 4e-3 * np.random.default_rng(6).standard_normal(N)
    assert len(find_turns(late, 1.0)) > 100
    at = np.array([1203, 2717, 4100, 6555])[:wild]
    y[at] += [2.0, -3.0, 1.5, -2.0][:wild]
    data = prepare([Recording(T, u, y)])
    assert data.lone == wild
    assert not np.any(data.rows[at])


@pytest.mark.parametrize("stage", [plain, lambda u: dead_bands_only(u, 2.0)])
@pytest.mark.parametrize(
    ("lowest", "low", "stated"),
    [(-1.0, 0.4, {"max_v"}), (-1.0, 1.5, {"max_v"}), (1.5, 1.5, {"min_v", "max_v"})],
)
def test_a_limit_beyond_which_the_reading_moves_is_none(
    stage: Callable[[np.ndarray], np.ndarray], lowest: float, low: float, stated: set[str]
) -> None:
    """The amplifier clips at 8 V, and at the lower limit where there is one."""
    u = drive(0)
    y = stage(np.clip(u, lowest, 8.0)) + NOISE_UM * np.random.default_rng(7).standard_normal(N)
    data = prepare([Recording(T, u, y)])
    clip, ends = Clip(data), (low, 8.0)
    assert set(clip.values(ends, np.zeros(0))) == stated
    (block,) = clip.blocks(ends, np.zeros(0), data)
    assert (block.params["min_v"] > u.min()) == ("min_v" in stated)
