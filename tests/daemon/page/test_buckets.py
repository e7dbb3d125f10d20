"""Check the time buckets against a brute-force search, and the histogram of wake-ups."""

import numpy as np
import pytest

from dehyst.daemon.page.buckets import (
    FINEST_NS,
    KEPT,
    LEVELS,
    SIGNALS,
    Buckets,
    level_between,
    level_for,
)
from dehyst.daemon.page.wakeups import Wakeups, edges_us
from dehyst.daemon.rings.records import TELEMETRY


def telemetry(n: int, period_ns: int, seed: int = 1, begun_ns: int = 7_000_000_123) -> np.ndarray:
    rng = np.random.default_rng(seed)
    out = np.zeros(n, TELEMETRY)
    out["seq"] = np.arange(n)
    out["scheduled_ns"] = begun_ns + period_ns * np.arange(n)
    for name in ("target", "measured", "trim", "learned", "volts"):
        out[name] = rng.normal(size=n)
    out["target"][rng.random(n) < 0.3] = np.nan
    return out


def in_batches(buckets: Buckets, samples: np.ndarray, seed: int = 2) -> None:
    cuts = np.sort(np.random.default_rng(seed).integers(0, samples.size, 40))
    for part in np.split(samples, cuts):
        buckets.add(part)


@pytest.mark.parametrize("period_ns", [100_000, 1_000_000, 7_300_000])
@pytest.mark.parametrize("level", [0, 3, 7])
def test_a_bucket_spans_its_samples(period_ns: int, level: int) -> None:
    samples = telemetry(20_000, period_ns)
    buckets = Buckets()
    in_batches(buckets, samples)
    piece = buckets.since(level, -1, 1e6)
    assert piece.anew
    length_ns = FINEST_NS << level
    columns = [samples["target"], samples["measured"], samples["measured"] - samples["target"]]
    columns += [samples[name] for name in ("trim", "learned", "volts")]
    assert len(columns) == len(SIGNALS)
    where = samples["scheduled_ns"] // length_ns
    begun = np.unique(where)
    # a bucket is finished when a later one begins, at this level and at each finer level
    finished = begun[begun <= piece.number[-1]]
    assert begun.size - 1 - (level + 1) <= finished.size < begun.size
    assert np.array_equal(piece.number, finished[-KEPT:])
    for place in range(0, piece.number.size, max(1, piece.number.size // 50)):
        inside = where == piece.number[place]
        for signal, column in enumerate(columns):
            values = column[inside].astype(np.float32)
            values = values[np.isfinite(values)]
            if not values.size:
                assert np.isnan(piece.least[place, signal])
                continue
            assert piece.least[place, signal] == values.min()
            assert piece.largest[place, signal] == values.max()


def test_one_sample_of_600_000_is_seen_in_ten_minutes() -> None:
    samples = telemetry(60_000, 10_000_000)
    samples["measured"] = 0.0
    samples["measured"][31_234] = 5.0
    buckets = Buckets()
    buckets.add(samples)
    piece = buckets.since(level_for(600.0, 1000), -1, 600.0)
    assert piece.number.size <= 2000
    assert np.nanmax(piece.largest[:, 1]) == 5.0


def test_pieces_follow_one_another_and_a_slow_reader_begins_anew() -> None:
    samples = telemetry(30_000, 1_000_000)
    buckets = Buckets()
    buckets.add(samples[:100])
    cursor, seen = -1, []
    for first in range(100, 20_000, 500):
        piece = buckets.since(0, cursor, 1e6)
        assert piece.anew == (cursor == -1)
        cursor = piece.cursor
        seen.extend(piece.number)
        buckets.add(samples[first : first + 500])
    assert np.array_equal(np.diff(seen), np.ones(len(seen) - 1))
    slow = buckets.since(0, 5, 1e6)
    assert slow.anew
    assert slow.number.size == KEPT
    assert not buckets.since(0, slow.cursor, 1e6).number.size


def test_what_comes_twice_is_taken_once_and_a_clock_that_starts_anew_begins_anew() -> None:
    samples = telemetry(5000, 1_000_000)
    once, twice = Buckets(), Buckets()
    once.add(samples)
    twice.add(samples[:3000])
    twice.add(samples[1000:])
    assert np.array_equal(once.since(2, -1, 1e6).least, twice.since(2, -1, 1e6).least, True)
    twice.add(telemetry(5000, 1_000_000, begun_ns=1_000))
    assert twice.run == 1
    assert twice.since(0, -1, 1e6).number[0] == 0


@pytest.mark.parametrize(("window_s", "width"), [(1.0, 390), (10.0, 1000), (600.0, 1280)])
def test_the_level_fills_the_screen_and_not_more_than_twice(window_s: float, width: int) -> None:
    bucket_s = 1e-3 * 2 ** level_for(window_s, width)
    assert bucket_s == 1e-3 or width <= window_s / bucket_s <= 2 * width


def test_the_past_is_as_fine_as_it_is_kept() -> None:
    second = 1_000_000_000
    assert level_between(100 * second, 99 * second, 100 * second, 1000) == 0
    assert level_between(100 * second, 60 * second, 61 * second, 1000) == 3  # 40 s need 8192 x 8 ms
    assert level_between(10**6 * second, 0, second, 1000) == LEVELS - 1


def test_wakeups_are_counted_by_half_octaves() -> None:
    samples = np.zeros(7, TELEMETRY)
    samples["scheduled_ns"] = 5_000_000_000
    late_us = np.array([0.0, 1.0, 1.5, 2.0, 40.0, 1e6, 9e9])
    samples["actual_ns"] = samples["scheduled_ns"] + (late_us * 1e3).astype(np.int64)
    wakeups = Wakeups()
    wakeups.add(samples)
    counts, edges = wakeups.counts(), edges_us()
    assert sum(counts) == 7
    assert (counts[0], counts[1], counts[2], counts[-1]) == (2, 1, 1, 2)
    place = counts.index(1, 3)
    assert edges[place] <= 40.0 < edges[place + 1]
    for second in range(6, 66):
        samples["scheduled_ns"] = second * 1_000_000_000
        samples["actual_ns"] = samples["scheduled_ns"]
        wakeups.add(samples)
    assert wakeups.counts() == [420] + [0] * 39
