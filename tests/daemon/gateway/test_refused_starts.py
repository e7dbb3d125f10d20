"""The file in which the gateway notes its failed starts."""

import os
from pathlib import Path

import pytest

from dehyst.daemon.gateway import refused_starts


def test_tries_are_counted_from_the_first_and_the_last_reason_is_kept(tmp_path: Path) -> None:
    refused_starts.add(tmp_path, "the first")
    first = refused_starts.read_refused_starts(tmp_path)
    refused_starts.add(tmp_path, "x" * 9000)
    second = refused_starts.read_refused_starts(tmp_path)
    assert (first.starts, first.because) == (1, "the first")
    assert (second.starts, second.because) == (2, "x" * 500)
    assert second.since_ns == first.since_ns


def test_who_begins_takes_the_note_away(tmp_path: Path) -> None:
    refused_starts.add(tmp_path, "in use")
    assert refused_starts.take_refusals(tmp_path).starts == 1
    assert refused_starts.take_refusals(tmp_path).starts == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("damaged", [b"", b"{", b"[]", b'{"starts": "many"}', b"\xff" * 10_000])
def test_a_damaged_note_counts_as_none(tmp_path: Path, damaged: bytes) -> None:
    (tmp_path / refused_starts.FILE).write_bytes(damaged)
    assert refused_starts.read_refused_starts(tmp_path).starts == 0
    refused_starts.add(tmp_path, "in use")
    assert refused_starts.take_refusals(tmp_path).starts == 1


def test_a_time_after_now_is_of_another_life_of_the_machine(tmp_path: Path) -> None:
    note = b'{"starts": 3, "since_ns": 9000000000000000000, "because": "old"}'
    (tmp_path / refused_starts.FILE).write_bytes(note)
    refused_starts.add(tmp_path, "new")
    assert refused_starts.take_refusals(tmp_path).since_ns < 9_000_000_000_000_000_000


def test_a_folder_that_takes_no_file_costs_the_note_alone(tmp_path: Path) -> None:
    refused_starts.add(tmp_path / "gone", "in use")
    assert refused_starts.take_refusals(tmp_path / "gone").starts == 0


def test_a_link_in_its_place_is_replaced_and_not_followed(tmp_path: Path) -> None:
    target = tmp_path / "of-somebody-else"
    target.write_text("kept")
    os.symlink(target, tmp_path / refused_starts.FILE)
    refused_starts.add(tmp_path, "in use")
    assert target.read_text() == "kept"
    assert refused_starts.read_refused_starts(tmp_path).starts == 1
