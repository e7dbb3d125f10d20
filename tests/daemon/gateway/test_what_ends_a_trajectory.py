"""Commands that are too old for the loop, and what ends a trajectory: each check of the gate by
itself."""

import numpy as np
import pytest
from tests.rigs.gate import Gate, S, grid

from dehyst.daemon.client.client import Refusal
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.option_words import at_command_line
from dehyst.daemon.rings.records import COMMAND, LoopCommand


@pytest.fixture
def gate() -> Gate:
    gate = Gate()
    assert gate.request(1, "acquire", label="first").ok
    return gate


def test_a_chunk_that_was_more_than_two_seconds_on_its_way_is_refused(gate: Gate) -> None:
    late = gate.chunk(0, grid(0, 0.1), sent_ns=gate.sent(1, ago_s=2.1))
    assert late.code == "late"
    assert "2.1 s ago" in late.text
    assert gate.chunk(0, grid(0, 0.1), sent_ns=gate.sent(1, ago_s=1.9)).ok
    assert gate.chunk(1, grid(0.1, 0.1), sent_ns=gate.sent(1, ago_s=2.1)).code == "late"
    assert gate.chunk(1, grid(0.1, 0.1), sent_ns=gate.sent(1, ago_s=-1.1)).code == "late"


def test_a_setpoint_ends_the_trajectory(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.gate.queue_ahead_s(gate.now) > 0.4
    assert gate.setpoint(0).ok
    assert gate.gate.queue_ahead_s(gate.now) == 0.0
    reply = gate.chunk(1, grid(0.5, 0.5))
    assert (reply.code, gate.records.size) == ("over", 0)
    assert "a set-point replaced it" in reply.text


def test_a_refused_setpoint_does_not_end_the_trajectory(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.setpoint(0, 5.1).code == "unreachable"
    assert gate.chunk(1, grid(0.5, 0.5)).ok


def test_a_clear_ends_the_trajectory_that_it_names_and_tells_the_loop(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.request(1, "clear", trajectory=9).ok
    assert gate.records[["kind", "client", "trajectory"]].tolist() == [
        (int(LoopCommand.CLEAR), 1, 9)
    ]
    reply = gate.chunk(1, grid(0.5, 0.5))
    assert (reply.code, gate.records.size) == ("over", 0)
    assert "its client withdrew it" in reply.text


def test_a_clear_of_another_trajectory_leaves_this_one_alone(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.request(1, "clear", trajectory=8).ok
    assert gate.chunk(1, grid(0.5, 0.5)).ok


def test_who_holds_no_lease_clears_nothing(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    refused = gate.request(2, "clear", trajectory=9)
    assert (refused.code, gate.records.size) == ("lease-taken", 0)
    assert gate.chunk(1, grid(0.5, 0.5)).ok


def test_a_trajectory_that_the_loop_has_left_is_not_taken_up_again(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    gate.gate.take_loop_report(9, running=True)  # still played
    gate.gate.take_loop_report(8, running=False)  # another one
    assert gate.chunk(1, grid(0.5, 0.5)).ok
    gate.gate.take_loop_report(9, running=False)
    reply = gate.chunk(2, grid(1.0, 0.5))
    assert (reply.code, gate.records.size) == ("over", 0)
    assert "the loop no longer follows it" in reply.text


def test_a_new_gateway_knows_that_the_trajectory_was_complete(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.1), last=True).ok
    newest = gate.records[-1:]
    fresh = Gate()
    fresh.gate.resume(newest)
    fresh.request(1, "acquire")
    reply = fresh.chunk(1, grid(0.1, 0.1))
    assert (reply.code, fresh.records.size) == ("over", 0)
    assert "it is complete" in reply.text
    assert fresh.chunk(0, grid(0, 0.1), trajectory=10).ok  # the next one can begin


def test_a_new_gateway_without_a_point_in_the_ring_begins_with_nothing() -> None:
    fresh = Gate()
    fresh.gate.resume(np.zeros(0, COMMAND))
    fresh.request(1, "acquire")
    assert fresh.chunk(1, grid(0.1, 0.1)).code == "over"
    assert fresh.chunk(0, grid(0, 0.1)).ok


def test_a_link_that_grows_slower_is_not_taken_for_a_clock_that_drifts(gate: Gate) -> None:
    """If each renewal takes 0.4 s longer than the one before, 4 s in the end, a set-point that is
    as late is refused, and one that is in time is accepted."""
    for i in range(1, 11):
        gate.now += 2 * S
        assert gate.request(1, "renew", sent_ns=gate.sent(1, ago_s=0.4 * i)).ok
    assert gate.setpoint(0, sent_ns=gate.sent(1, ago_s=4.0)).code == "late"
    assert gate.setpoint(1, sent_ns=gate.sent(1, ago_s=0.0)).ok


def test_a_clock_that_goes_wrong_by_half_a_thousandth_makes_no_command_late(gate: Gate) -> None:
    """A client's clock that loses 0.05 % makes no command late: within two hours it is off by 3.6
    s, where 2 s are allowed."""
    for i in range(3600):
        gate.now += 2 * S
        gate.skew[1] -= round(0.0005 * 2 * S)
        assert gate.setpoint(i).ok, i


def test_an_hour_of_silence_ends_the_lease_whatever_the_drift() -> None:
    lease = Lease(3 * S)
    admission = Admission("um", 10.0, 2.0, lease)
    number = lease.give(1000 * S, 1, "first", 0)
    assert admission.lease.check(1003 * S, 1, number)
    assert not admission.lease.check(1003 * S + 1, 1, number)


def test_who_takes_an_ended_lease_cannot_go_on_with_the_others_trajectory(gate: Gate) -> None:
    """The next holder of a lease cannot continue the trajectory of the previous one, although the
    two clients' trajectory numbers may be equal and nobody took over."""
    assert gate.chunk(0, grid(0.0, 1.0)).ok
    gate.now += 4 * S
    assert gate.request(2, "acquire").ok
    own = {"client": 2, "lease": gate.leases[2], "sent_ns": gate.sent(2)}
    assert gate.chunk(1, grid(1.0, 1.0), **own).code == "over"
    assert gate.chunk(0, grid(0.0, 1.0), **own).ok
    assert gate.chunk(1, grid(1.0, 1.0), **own).ok


@pytest.mark.parametrize("client", [1, 2])
def test_every_lease_counts_its_setpoints_from_0(gate: Gate, client: int) -> None:
    assert gate.setpoint(500).ok
    assert gate.request(client, "take-over").ok
    assert gate.setpoint(0, client=client).ok
    assert gate.setpoint(0, client=client).code == "old"


def test_a_refused_chunk_is_not_reported_as_the_end_of_the_trajectory(gate: Gate) -> None:
    said: list[str] = []
    gate.gate.report = lambda _level, _code, text: said.append(text)
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.chunk(2, grid(1.0, 0.5)).code == "order"
    assert gate.chunk(1, grid(0.5, 0.5)).ok  # it goes on
    (text,) = said
    assert text.startswith("a chunk is refused; the trajectory in play continues: chunk 2")


def test_a_taken_lease_is_refused_with_what_to_do(gate: Gate) -> None:
    reply = gate.request(2, "acquire")
    said = str(Refusal(reply.code, reply.text))
    assert "first commands this daemon" in said
    assert said.endswith(": wait, or take over with take_over() [lease-taken]")
    with at_command_line():
        said = str(Refusal(reply.code, reply.text))
    assert said.endswith(": wait, or take over with --take-over [lease-taken]")
