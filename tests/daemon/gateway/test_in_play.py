"""A trajectory that has begun is played to its end, even if the model changes or the gateway
restarts."""

from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gate import Gate, grid

from dehyst.daemon.bus.refusal_codes import CODES
from dehyst.daemon.gateway.in_play import InPlay, read_in_play, write_in_play

Said = list[tuple[int, str, str]]


@pytest.fixture
def said() -> Said:
    return []


@pytest.fixture
def kept() -> list[InPlay]:
    return []


@pytest.fixture
def gate(said: Said, kept: list[InPlay]) -> Gate:
    """A gate whose client 1 holds the lease; the reach is -5 to 5 um."""
    gate = Gate()
    gate.gate.report = lambda *event: said.append(event)
    gate.gate.keep = kept.append
    assert gate.request(1, "acquire", label="first").ok
    return gate


def wave(index: int, top: float, **more: object) -> dict:
    times = grid(0.1 * index, 0.1)
    return {"index": index, "times_s": times, "values": np.linspace(-top, top, times.size), **more}


@pytest.mark.parametrize("reach", [(-3.0, 5.0), (-5.0, 3.0), (-1.0, 1.0), (6.0, 9.0)])
def test_a_model_that_reaches_less_ends_no_trajectory(
    gate: Gate, said: Said, reach: tuple[float, float]
) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    gate.gate.core.reachable = reach
    replies = [gate.chunk(**wave(k, 4.0, last=k == 5)) for k in range(1, 6)]
    assert [r.code for r in replies] == ["ok"] * 5
    assert gate.records["value"][[0, -1]].tolist() == [-4.0, 4.0]  # the gateway does not clip
    values = np.linspace(-4.0, 4.0, 100)
    far = np.maximum(reach[0] - values, values - reach[1])
    assert [bool(r.text) for r in replies] == [True, False, False, False, False]
    assert f"{np.count_nonzero(far > 0)} points" in replies[0].text
    assert f"by up to {far.max():.3g} um" in replies[0].text
    assert len(said) == 2  # one when it begins, one with the total
    assert f"{5 * np.count_nonzero(far > 0)} points" in said[1][2]


def test_what_was_never_in_reach_is_refused_then_as_before(gate: Gate) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    assert gate.chunk(**wave(1, 5.5)).code == "unreachable"
    gate.gate.core.reachable = (-3.0, 3.0)
    assert gate.chunk(**wave(1, 5.5)).code == "unreachable"
    assert gate.chunk(**wave(1, 4.5)).ok


def test_a_wider_reach_counts_for_the_trajectory_in_play(gate: Gate, said: Said) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    gate.gate.core.reachable = (-8.0, 8.0)
    assert gate.chunk(**wave(1, 7.0)).ok
    assert said == []


def test_a_new_trajectory_and_a_set_point_are_judged_by_the_reach_of_now(gate: Gate) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    gate.gate.core.reachable = (-3.0, 3.0)
    assert gate.chunk(**wave(0, 4.0, trajectory=10)).code == "unreachable"
    assert gate.chunk(**wave(1, 4.0)).ok  # the trajectory in play continues
    assert gate.setpoint(0, 4.0).code == "unreachable"


def test_who_allows_the_unreachable_is_not_reported(gate: Gate, said: Said) -> None:
    assert gate.chunk(**wave(0, 4.0, allow_unreachable=True)).ok
    gate.gate.core.reachable = (-3.0, 3.0)
    assert gate.chunk(**wave(1, 4.0, allow_unreachable=True)).text == ""
    assert said == []


def test_the_next_gateway_knows_what_was_admitted(
    gate: Gate, kept: list[InPlay], tmp_path: Path, said: Said
) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    write_in_play(tmp_path, kept[-1])
    newest = gate.records[-1:]
    after = Gate()
    after.gate.report = lambda *event: said.append(event)
    after.gate.core.reachable = (-3.0, 3.0)
    after.gate.begun = read_in_play(tmp_path)
    after.gate.resume(newest)
    assert after.request(1, "acquire").ok
    reply = after.chunk(**wave(1, 4.0))
    assert reply.ok, reply.text
    assert len(said) == 1
    assert after.chunk(**wave(2, 5.5)).code == "unreachable"


def test_without_a_file_or_with_a_damaged_one_nothing_is_known(tmp_path: Path) -> None:
    assert read_in_play(tmp_path) == read_in_play(tmp_path / "none")
    for text in ("", "{", '{"trajectory": "x"}', "[]", "null"):
        (tmp_path / "in-play.json").write_text(text)
        assert read_in_play(tmp_path).trajectory == 0


def test_a_final_refusal_of_the_trajectory_in_play_is_an_event_once(gate: Gate, said: Said) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    assert gate.chunk(**wave(1, 4.0), room=1).code == "queue-full"
    assert said == []
    for _ in range(3):
        assert gate.chunk(**wave(1, 4.0, unit="nm")).code == "unit"
    assert len(said) == 1
    assert "'nm'" in said[0][2]


def test_what_ends_the_trajectory_in_play_is_an_event(gate: Gate, said: Said) -> None:
    assert gate.chunk(**wave(0, 4.0)).ok
    assert gate.request(2, "take-over", label="second").ok
    assert [text for *_, text in said] == ["the trajectory ended early: another client took over"]


@pytest.mark.parametrize("code", sorted(CODES))
def test_every_code_is_in_words(code: str) -> None:
    assert CODES[code].says
