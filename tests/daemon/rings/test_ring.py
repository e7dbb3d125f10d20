"""Rings between two real processes."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.rings.ring import Ring
from dehyst.models.errors import BadInput

PAIR = np.dtype([("a", "<i8"), ("b", "<f8")])


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.integers(1, 9)), max_size=40))
def test_reader_gets_the_newest_in_order_and_the_count_of_the_lost(
    tmp_path_factory: pytest.TempPathFactory, actions: list[tuple[bool, int]]
) -> None:
    ring = Ring.create(tmp_path_factory.mktemp("ring") / "r", PAIR, 8)
    written = tail = 0
    for is_write, count in actions:
        if is_write:
            for _ in range(count):
                ring.push((written, 0.5 * written))
                written += 1
        else:
            records, after, lost = ring.read(tail, count)
            expected = list(range(tail, written))
            kept = [n for n in expected if n >= tail + lost]
            assert records["a"].tolist() == kept[: records.size]
            assert after == tail + lost + records.size
            assert lost <= max(0, written - 7 - tail)
            tail = after
    ring.close()


def test_push_many_wraps(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", PAIR, 8)
    for start in range(0, 60, 5):
        batch = np.zeros(5, PAIR)
        batch["a"] = np.arange(start, start + 5)
        ring.push_many(batch)
        assert ring.read(start)[0]["a"].tolist() == list(range(start, start + 5))


WRITER = """
import numpy as np, sys
from pathlib import Path
from dehyst.daemon.rings.ring import Ring
dtype = np.dtype([("a", "<i8"), ("b", "<f8")])
ring = Ring.attach(Path(sys.argv[1]), dtype)
for i in range(200_000):
    ring.push((i, 3.0 * i))
"""


def test_no_torn_record_reaches_a_slow_reader_in_another_process(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", PAIR, 64)
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path / "r")])
    tail = lost_in_all = got = 0
    while tail < 200_000:
        assert writer.poll() in (None, 0)
        records, tail, lost = ring.read(tail)
        lost_in_all += lost
        got += records.size
        np.testing.assert_array_equal(records["b"], 3.0 * records["a"])
        assert np.all(np.diff(records["a"]) >= 1)  # records overwritten meanwhile are lost
    assert writer.wait(30) == 0
    assert got + lost_in_all == 200_000


def test_damaged_missing_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no ring"):
        Ring.attach(tmp_path / "none", PAIR)
    for content in (b"", b"x", b"\0" * 4096):
        (tmp_path / "bad").write_bytes(content)
        with pytest.raises(BadInput):
            Ring.attach(tmp_path / "bad", PAIR)
    Ring.create(tmp_path / "other", np.dtype([("a", "<i4")]), 8)
    with pytest.raises(BadInput, match="version"):
        Ring.attach(tmp_path / "other", PAIR)


def test_a_new_ring_leaves_the_old_mapping_alone_and_says_it_is_stale(tmp_path: Path) -> None:
    old = Ring.create(tmp_path / "r", PAIR, 8)
    reader = Ring.attach(tmp_path / "r", PAIR)
    assert not reader.stale()
    new = Ring.create(tmp_path / "r", PAIR, 8)
    new.push((1, 1.0))
    old.push((2, 2.0))
    assert reader.stale()
    assert reader.read(0)[0]["a"].tolist() == [2]
    assert Ring.attach(tmp_path / "r", PAIR).read(0)[0]["a"].tolist() == [1]


def test_a_ring_that_nobody_closed_leaves_no_open_file(tmp_path: Path) -> None:
    Ring.create(tmp_path / "r", PAIR, 8).close()
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(20):
        assert Ring.attach(tmp_path / "r", PAIR).head == 0
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_file_of_the_right_shape_and_another_mark_is_no_ring(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    Ring.create(path, PAIR, 16).close()
    Ring.attach(path, PAIR).close()
    with open(path, "r+b") as file:
        file.write(b"another.")
    with pytest.raises(BadInput, match="not a ring"):
        Ring.attach(path, PAIR)


def test_room_is_what_the_reader_has_taken(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "ring", PAIR, 16)
    assert ring.free == 16
    ring.push_many(np.zeros(10, PAIR))
    assert ring.free == 6
    ring.taken(4)
    assert ring.free == 10
    ring.push_many(np.zeros(10, PAIR))
    assert ring.free == 0
