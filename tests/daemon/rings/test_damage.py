"""Rings that are cut short or overwritten while in use: the damage is reported, repaired and
counted, and no content is trusted.

The digest is compared with FNV-1a written out here.
"""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.rings.layout import digests
from dehyst.daemon.rings.records import COMMAND, EVENT, TELEMETRY
from dehyst.daemon.rings.ring import Ring, digest
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.daemon.rings.status import STATUS
from dehyst.daemon.service.event_log import EventLog
from dehyst.daemon.service.heartbeat import Heartbeat
from dehyst.models.errors import BadInput

PAIR = np.dtype([("a", "<i8"), ("b", "<f8")])
HEADER = 128
KINDS = {"telemetry": TELEMETRY, "status": STATUS, "event": EVENT, "command": COMMAND}


def filled(path: Path, count: int = 6, capacity: int = 8) -> Ring:
    ring = Ring.create(path, PAIR, capacity, 77)
    for i in range(count):
        ring.push((i, 0.5 * i))
    return ring


def fnv1a(data: bytes, number: int) -> int:
    """Return the 64-bit FNV-1a hash of the number and the bytes."""
    value = (14695981039346656037 ^ (number & (2**64 - 1))) * 1099511628211 % 2**64
    for byte in data:
        value = (value ^ byte) * 1099511628211 % 2**64
    return value


@given(st.binary(min_size=16, max_size=16), st.integers(-(2**63), 2**63 - 1))
@settings(max_examples=60)
def test_both_digests_are_fnv_1a(data: bytes, number: int) -> None:
    record = np.frombuffer(data, PAIR)
    expected = np.array([fnv1a(data, number)], np.uint64).view(np.int64)[0]
    assert digest(np.frombuffer(data, np.uint8), number) == expected
    assert digests(record, np.array([number]))[0] == expected


@given(st.integers(HEADER, HEADER + 8 * 24 - 1), st.integers(1, 255))
@settings(max_examples=100)
def test_a_record_with_one_wrong_byte_is_dropped_and_counted(
    tmp_path_factory: pytest.TempPathFactory, at: int, change: int
) -> None:
    path = tmp_path_factory.mktemp("damage") / "r"
    ring = filled(path)
    with open(path, "r+b") as file:
        file.seek(at)
        byte = file.read(1)[0]
        file.seek(at)
        file.write(bytes([byte ^ change]))
    hit = (at - HEADER) // 8 if at < HEADER + 64 else (at - HEADER - 64) // 16
    expected = [n for n in range(6) if n != hit]
    records, tail, lost = ring.read(0)
    assert records["a"].tolist() == expected
    assert (tail, lost, ring.damaged) == (6, 6 - len(expected), 6 - len(expected))
    with RingFile(path, PAIR) as other:
        assert other.read()[0]["a"].tolist() == expected


@given(st.binary(min_size=8, max_size=400), st.integers(0, 319))
@settings(max_examples=100)
def test_random_bytes_anywhere_stop_nobody(
    tmp_path_factory: pytest.TempPathFactory, junk: bytes, at: int
) -> None:
    path = tmp_path_factory.mktemp("damage") / "r"
    writer, reader = filled(path), Ring.attach(path, PAIR)
    tail = reader.read(0)[1]
    with open(path, "r+b") as file:
        file.seek(at)
        file.write(junk[: max(0, path.stat().st_size - at)])
    seen, tail, _ = reader.read(tail)
    assert set(seen["a"].tolist()) <= set(range(6))
    assert 0 <= reader.free <= reader.capacity
    writer.mend()
    writer.push((100, 50.0))
    seen, tail, _ = reader.read(tail)
    assert set(seen["a"].tolist()) <= set(range(6)) | {100}
    writer.push((101, 50.5))
    assert reader.read(tail)[0]["a"].tolist() == [101]  # works from the next record on
    Ring.attach(path, PAIR)


@pytest.mark.parametrize("size", [0, 1, 64, 127, 128, 200, 319, 4096])
def test_a_ring_cut_short_is_refused_by_name_and_mended_by_its_writer(
    tmp_path: Path, size: int
) -> None:
    path = tmp_path / "r"
    ring = filled(path)
    os.truncate(path, size)
    for attach in (Ring.attach, RingFile):
        with pytest.raises(BadInput, match=str(path)):
            attach(path, PAIR)
    assert not ring.mend()
    assert ring.mend()
    ring.push((6, 3.0))
    assert Ring.attach(path, PAIR).read(0)[0]["a"].tolist()[-1] == 6
    assert Ring.attach(path, PAIR).run == 77


def test_a_reader_of_the_file_survives_what_ends_one_of_the_mapping(tmp_path: Path) -> None:
    """Reading a truncated ring's file raises BadInput. Reading a mapping would end the process with
    SIGBUS, so the supervisor and `dehyst safe` map nothing."""
    path = tmp_path / "r"
    filled(path, capacity=100_000)
    reader = RingFile(path, PAIR)
    os.truncate(path, 4096)
    with pytest.raises(BadInput, match="damaged"):
        reader.read()
    with pytest.raises(BadInput, match="damaged"):
        reader.place()


def test_a_refused_ring_leaves_no_file_open(tmp_path: Path) -> None:
    """A refused ring leaves no file open: the supervisor looks at a damaged one twice a second."""
    path = tmp_path / "r"
    filled(path)
    os.truncate(path, 64)
    before = len(os.listdir("/proc/self/fd"))
    for attach in (Ring.attach, RingFile):
        for _ in range(20):
            with pytest.raises(BadInput):
                attach(path, PAIR)
    assert len(os.listdir("/proc/self/fd")) <= before


def test_the_supervisor_and_safe_read_without_the_compiler() -> None:
    """What must run when nothing else does needs no numba: no compiled code, no cache."""
    script = (
        "import sys\n"
        "import dehyst.daemon.commands.safe, dehyst.daemon.service.safe_state\n"
        "import dehyst.daemon.service.supervisor, dehyst.drivers.mdt693b\n"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "False"


ANY_64_BITS = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.sampled_from([-(2**63), -1, 2**31, 2**48, 2**62, 2**62 + 1, 2**63 - 9, 2**63 - 1]),
)


@pytest.mark.parametrize("ring", KINDS)
@given(words=st.dictionaries(st.integers(0, 15), ANY_64_BITS, min_size=1))
@settings(max_examples=60)
def test_no_header_whatever_is_in_it_ends_a_reader_or_a_writer(
    tmp_path_factory: pytest.TempPathFactory, ring: str, words: dict[int, int]
) -> None:
    """Random words in a header raise nothing but BadInput, for each ring: in both readers, in the
    writer and in what the supervisor derives from it."""
    folder = tmp_path_factory.mktemp("header")
    path, dtype = folder / f"{ring}.ring", KINDS[ring]
    writer = Ring.create(path, dtype, 8, 77)
    for _ in range(3):
        writer.push(np.zeros(1, dtype)[0])
    reader, file = Ring.attach(path, dtype), RingFile(path, dtype)
    with open(path, "r+b") as raw:
        for place, value in words.items():
            raw.seek(8 * place)
            raw.write(value.to_bytes(8, "little", signed=True))
    for first in (0, 3, 2**62, 2**63 - 1):
        with suppress(BadInput):
            file.read(first)
        with suppress(BadInput), RingFile(path, dtype) as fresh:
            assert fresh.read(first)[0].size <= 8
        records, after, lost = reader.read(first)
        assert records.size <= 8
        assert after >= 0
        assert lost >= 0
    assert reader.free >= 0
    assert reader.tail <= reader.head
    with suppress(BadInput):
        Ring.attach(path, dtype).close()
    heartbeat, config = Heartbeat(folder), SimpleNamespace(directory=folder, axis="")
    heartbeat.core_started(os.getpid())
    heartbeat.look(10**9)
    teller = EventLog(config, lambda text: None)  # type: ignore[arg-type]
    teller.log_new(os.getpid())
    writer.mend()
    writer.push(np.zeros(1, dtype)[0])
    assert reader.head == 4
    writer.close()
    reader.close()
    file.close()
