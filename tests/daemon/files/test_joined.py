"""Telemetry of several axes that arrives in pieces, against what was sampled."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.files.joined import JoinedTelemetry, at_the_same_time
from dehyst.daemon.rings.records import TELEMETRY


def telemetry(numbers: list[int], scale: float) -> np.ndarray:
    out = np.zeros(len(numbers), TELEMETRY)
    out["seq"] = numbers
    out["scheduled_ns"] = 5_000_000 * out["seq"] + 1_000
    out["measured"] = scale * out["seq"]
    return out


@given(st.integers(0, 2**32))
@settings(max_examples=60, deadline=None)
def test_every_sample_is_given_once_and_none_before_it_has_come_of_all(seed: int) -> None:
    draw = np.random.default_rng(seed)
    held = JoinedTelemetry("xyz")
    there: dict[str, list[int]] = {}
    for axis in "xyz":
        first = int(draw.integers(0, 5))
        lost = set(draw.integers(6, 41, draw.integers(0, 9)).tolist())
        there[axis] = [n for n in range(first, 41) if n not in lost]
    place, given_ = dict.fromkeys("xyz", 0), {axis: [] for axis in "xyz"}
    while any(place[axis] < len(there[axis]) for axis in "xyz"):
        axis = "xyz"[draw.integers(3)]
        count = int(draw.integers(1, 16))
        held.add(axis, telemetry(there[axis][place[axis] : place[axis] + count], 1.0))
        place[axis] += count
        for name, part in held.take().items():
            given_[name] += part["seq"].tolist()
        newest = min(
            (there[a][min(place[a], len(there[a])) - 1] if place[a] else -1) for a in "xyz"
        )
        assert all(numbers[-1] <= newest for numbers in given_.values() if numbers)
    for name, part in held.take(end=True).items():
        given_[name] += part["seq"].tolist()
    begin = max(numbers[0] for numbers in there.values())
    assert given_ == {axis: [n for n in there[axis] if n >= begin] for axis in "xyz"}


def test_where_the_clock_starts_anew_it_begins_again_with_what_all_have() -> None:
    """After a reboot, joining starts again with the first sample that all axes have, although one
    axis arrives first and older samples of another one follow."""
    held = JoinedTelemetry("xy")
    held.add("x", telemetry([900, 901, 902, 903], 1.0))
    held.add("y", telemetry([900, 901], 1.0))
    assert {a: part["seq"].tolist() for a, part in held.take().items()} == {
        "x": [900, 901],
        "y": [900, 901],
    }
    held.add("x", telemetry([5, 6], 1.0))
    held.add("y", telemetry([902], 1.0))
    assert all(not part.size for part in held.take().values())
    held.add("y", telemetry([6, 7], 1.0))
    held.add("x", telemetry([7, 8], 1.0))
    assert all(part["seq"].tolist() == [7] for part in held.take().values())


def test_beside_a_sample_stands_what_the_other_had_then_or_nothing() -> None:
    mine, other = telemetry([3, 4, 5, 8, 9], 1.0), telemetry([4, 6, 8], 10.0)
    assert np.array_equal(
        at_the_same_time(mine, other)["measured"], [np.nan, 40.0, np.nan, 80.0, np.nan],
        equal_nan=True,
    )  # fmt: skip
    assert np.isnan(at_the_same_time(mine, other[:0])["volts"]).all()


def test_one_axis_alone_is_given_as_it_comes() -> None:
    held = JoinedTelemetry([""])
    held.add("", telemetry([1, 2], 1.0))
    assert held.take()[""]["seq"].tolist() == [1, 2]
    assert held.take()[""].size == 0
