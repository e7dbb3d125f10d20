"""The commands that the gate lets through to the loop, on a simulated clock; a brute-force queue is
the reference."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.rigs.gate import Gate, S, grid

from dehyst.daemon.rings.records import LARGEST_TARGET, LATEST_OFFSET_NS, LoopCommand, State


@pytest.fixture
def gate() -> Gate:
    gate = Gate()
    assert gate.request(1, "acquire", label="first").ok
    return gate


def test_a_good_setpoint_becomes_one_record(gate: Gate) -> None:
    assert gate.setpoint(0, 2.5).ok
    assert gate.records.size == 1
    record = gate.records[0]
    assert (record["kind"], record["value"], record["client"]) == (LoopCommand.SETPOINT, 2.5, 1)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"value": float("nan")}, "not-finite"),
        ({"value": float("inf")}, "not-finite"),
        ({"value": 5.1}, "unreachable"),
        ({"value": -5.1}, "unreachable"),
        ({"unit": "nm"}, "unit"),
        ({"lease": 12345}, "no-lease"),
        ({"client": 2}, "lease-taken"),
    ],
)
def test_bad_setpoints_are_refused_with_the_reason(gate: Gate, change: dict, code: str) -> None:
    reply = gate.setpoint(0, **change)
    assert not reply.ok
    assert reply.code == code
    assert reply.text
    assert gate.gate.rejected == {code: 1}
    assert gate.setpoint(0).ok  # the next good one is accepted


def test_unreachable_may_be_allowed_but_nan_never(gate: Gate) -> None:
    assert gate.setpoint(0, 50.0, allow_unreachable=True).ok
    assert gate.setpoint(1, float("nan"), allow_unreachable=True).code == "not-finite"


@pytest.mark.parametrize("share", [-0.999, -1.001, 0.999, 1.001])
def test_what_the_loop_would_drop_is_refused(gate: Gate, share: float) -> None:
    """No command is acknowledged and then dropped: gateway and loop have the same limits."""
    dropped = abs(share) > 1.0
    reply = gate.setpoint(0, share * LARGEST_TARGET, allow_unreachable=True)
    assert (reply.ok, reply.code) == ((False, "unreachable") if dropped else (True, "ok"))
    late_s = abs(share) * LATEST_OFFSET_NS * 1e-9
    reply = gate.chunk(0, np.array([late_s - 0.1, late_s]))
    assert (reply.ok, reply.code) == ((False, "offset") if dropped else (True, "ok"))


@given(st.lists(st.integers(0, 30), max_size=30))
def test_only_ascending_sequences_pass(sequence: list[int]) -> None:
    gate = Gate()
    gate.request(1, "acquire")
    newest = -1
    for number in sequence:
        reply = gate.setpoint(number)
        assert reply.ok == (number > newest)
        assert reply.ok or reply.code == "old"
        newest = max(newest, number)


def test_who_is_late_is_there_all_the_same(gate: Gate) -> None:
    """A full link delays every command: they are refused, but no other client can take the
    lease."""
    gate.request(1, "acquire")
    for sequence in range(1, 6):
        gate.now += 2 * S
        assert gate.setpoint(sequence, sent_ns=gate.sent(1, ago_s=2.5)).code == "late"
    assert gate.request(2, "acquire").code == "lease-taken"
    gate.now += round(3.1 * S)
    assert gate.request(2, "acquire").ok


def test_late_setpoints_are_refused_whatever_the_clients_clock_says(gate: Gate) -> None:
    assert gate.setpoint(0, sent_ns=gate.sent(1, ago_s=1.9)).ok
    assert gate.setpoint(1, sent_ns=gate.sent(1, ago_s=2.1)).code == "late"
    assert gate.setpoint(2, sent_ns=gate.sent(1, ago_s=-5.0)).code == "late"
    gate.now += S
    assert gate.setpoint(3).ok


def test_a_recorded_setpoint_is_worth_nothing_under_the_next_lease(gate: Gate) -> None:
    old_lease, sent = gate.leases[1], gate.sent(1)
    assert gate.setpoint(5, sent_ns=sent).ok
    assert gate.setpoint(5, sent_ns=sent).code == "old"  # replayed immediately
    assert gate.request(1, "acquire").ok
    assert gate.setpoint(99, lease=old_lease).code == "no-lease"


def test_the_other_client_is_reported_who_commands_until_the_lease_ends(gate: Gate) -> None:
    assert gate.setpoint(0).ok
    refused = gate.request(2, "acquire")
    assert refused.code == "lease-taken"
    assert "first" in refused.text
    gate.now += 3 * S - 1
    assert not gate.request(2, "acquire").ok
    gate.now += 2
    assert gate.request(2, "acquire").ok
    assert gate.setpoint(1, client=2).ok
    assert gate.setpoint(1).code == "lease-taken"


def test_renewing_keeps_the_lease_and_giving_up_ends_it(gate: Gate) -> None:
    for _ in range(5):
        gate.now += 2 * S
        assert gate.request(1, "renew").ok
    assert not gate.request(2, "acquire").ok
    assert gate.request(1, "give-up").ok
    assert gate.request(2, "acquire").ok
    assert gate.request(1, "renew").code == "lease-taken"


def test_take_over_ends_the_others_trajectory(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.request(2, "take-over").ok
    assert gate.chunk(1, grid(0.5, 0.5)).code == "lease-taken"
    assert gate.request(1, "take-over").ok
    reply = gate.chunk(1, grid(0.5, 0.5))
    assert reply.code == "over"
    assert "took over" in reply.text


def test_anybody_may_stop_and_it_ends_the_trajectory(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.5)).ok
    assert gate.request(2, "stop").ok
    assert gate.records["kind"].tolist() == [LoopCommand.STOP_MOTION]
    reply = gate.chunk(1, grid(0.5, 0.5))
    assert reply.code == "over"
    assert "stopped" in reply.text
    assert gate.request(2, "release").ok
    assert gate.records["kind"].tolist() == [LoopCommand.RELEASE]


@pytest.mark.parametrize("stop", ["stop", "release"])
@pytest.mark.parametrize("value", [2.5, 3.0])
def test_no_set_point_undoes_the_stop_of_another(gate: Gate, stop: str, value: float) -> None:
    assert gate.setpoint(0, 2.5).ok
    assert gate.setpoint(1, 2.5).ok
    assert gate.request(1, "stop").ok
    assert gate.setpoint(2, 2.5).ok  # it knows of its own stop
    assert gate.request(2, stop).ok
    for sequence in (3, 4):  # a scan sends a new value each time
        reply = gate.setpoint(sequence, value)
        assert (reply.code, gate.records.size) == ("over", 0)
        assert "acquire" in reply.text
    assert gate.chunk(0, grid(0, 0.5)).code == "over"
    assert gate.request(1, "hold").code == "over"
    assert gate.request(1, "acquire").ok
    assert gate.setpoint(0, 3.0).ok


def test_a_hold_that_is_repeated_does_not_cancel_the_ramp_of_another(gate: Gate) -> None:
    assert gate.request(1, "hold").ok
    assert gate.request(1, "hold").ok
    assert gate.request(2, "release").ok
    assert gate.request(1, "hold").code == "over"
    assert gate.request(1, "acquire").ok
    assert gate.request(1, "hold").ok


@pytest.mark.parametrize("stop", ["stop", "release"])
def test_what_was_sent_before_the_own_stop_does_not_undo_it(gate: Gate, stop: str) -> None:
    """Puts are served after queries, so a stop overtakes a fast stream."""
    assert gate.setpoint(0, 2.5).ok
    assert gate.request(1, stop).ok
    before = gate.sent(1, 0.01)
    assert gate.setpoint(1, 3.0, sent_ns=before).code == "old"
    assert gate.chunk(0, grid(0, 0.5), sent_ns=before).code == "old"
    assert gate.request(1, "hold", sent_ns=before).code == "old"
    assert gate.setpoint(1, 3.0).ok  # sent after it


def test_a_zero_sent_again_moves_it_once(gate: Gate) -> None:
    sent = gate.sent(1)
    assert gate.request(1, "zero", value=0.5, sent_ns=sent).ok
    assert gate.records["kind"].tolist() == [LoopCommand.ZERO]
    assert gate.request(1, "zero", value=0.5, sent_ns=sent).ok
    assert not gate.records.size
    gate.now += S
    assert gate.request(1, "zero", value=0.5).ok
    assert gate.records.size == 1


@pytest.mark.parametrize("action", ["zero", "hold"])
def test_a_request_that_moves_something_is_refused_when_it_is_old(gate: Gate, action: str) -> None:
    assert gate.request(1, action, sent_ns=gate.sent(1, 2.5)).code == "late"
    assert gate.request(1, "renew", sent_ns=gate.sent(1, 2.5)).ok
    assert gate.request(1, action).ok


@pytest.mark.parametrize("action", ["renew", "zero", "hold", "give-up", "clear", "stop"])
def test_a_time_in_the_future_does_not_spoil_the_lease(gate: Gate, action: str) -> None:
    reply = gate.request(1, action, sent_ns=2**63 - 1)
    assert reply.code == ("ok" if action == "stop" else "late")
    if action == "stop":  # it stops whatever its time
        assert gate.request(1, "acquire").ok
    assert gate.setpoint(0, 2.5).ok


@pytest.mark.parametrize("between", ["setpoint", "hold", "stop"])
def test_a_number_used_again_after_another_motion_is_said_to_be_over(
    gate: Gate, between: str
) -> None:
    assert gate.chunk(0, grid(0, 0.5), last=True).ok
    assert gate.chunk(0, grid(0, 0.5), last=True).code == "duplicate"
    assert (gate.setpoint(0) if between == "setpoint" else gate.request(1, between)).ok
    assert gate.chunk(0, grid(0, 0.5), last=True).code == "over"
    assert gate.chunk(0, grid(0, 0.5), last=True, trajectory=10).ok


def test_a_release_while_a_device_has_failed_is_not_said_to_ramp(gate: Gate) -> None:
    gate.gate.core.state = State.FAULT
    reply = gate.request(1, "release")
    assert (reply.code, gate.records.size) == ("state", 0)
    assert "release again once it is back" in reply.text
    assert gate.request(1, "stop").ok


@pytest.mark.parametrize("state", [State.START, State.FAULT, State.STOPPING])
def test_states_that_follow_nothing(gate: Gate, state: State) -> None:
    gate.gate.core.state = state
    code = "starting" if state is State.START else "state"
    assert gate.setpoint(0).code == code
    assert gate.chunk(0, grid(0, 0.1)).code == code
    assert gate.request(1, "stop").ok


def test_without_a_loop_nothing_passes(gate: Gate) -> None:
    gate.gate.core.alive = False
    assert gate.setpoint(0).code == "no-core"
    assert gate.request(1, "stop").code == "no-core"
    assert gate.request(1, "renew").ok


def test_before_the_reach_is_known_nothing_passes(gate: Gate) -> None:
    gate.gate.core.reachable = (float("nan"), float("nan"))
    assert gate.setpoint(0).code == "unreachable"


def test_a_full_ring_refuses_but_leaves_room_for_a_stop(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.1), room=120).code == "queue-full"
    assert gate.chunk(0, grid(0, 0.1), room=170).ok
    assert gate.request(1, "stop").ok


def test_a_chunk_that_is_repeated_after_a_stop_is_refused(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.1)).ok
    assert gate.chunk(1, grid(0.1, 0.1)).ok
    assert gate.request(2, "stop").ok
    assert gate.chunk(1, grid(0.1, 0.1)).code == "over"
    assert gate.records.size == 0


def test_a_chunk_that_is_repeated_after_the_last_one_is_a_duplicate(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.1), last=True).ok
    assert gate.chunk(0, grid(0, 0.1), last=True).code == "duplicate"


def test_chunks_in_order_pass_and_repeated_ones_do_nothing(gate: Gate) -> None:
    for i in range(3):
        assert gate.chunk(i, grid(0.1 * i, 0.1)).code == "ok"
        assert gate.records.size == 100
        assert gate.chunk(i, grid(0.1 * i, 0.1)).code == "duplicate"
        assert gate.records.size == 0
    assert gate.chunk(4, grid(0.4, 0.1)).code == "order"
    assert gate.chunk(3, grid(0.3, 0.1), last=True).ok
    assert gate.records["last"].tolist() == [0] * 99 + [1]
    assert gate.chunk(4, grid(0.4, 0.1)).code == "over"


@pytest.mark.parametrize(
    ("times", "values", "code"),
    [
        ([0.2, 0.1], [0, 0], "order"),
        ([0.1, 0.1], [0, 0], "order"),
        ([-0.1, 0.1], [0, 0], "offset"),
        ([0.0, 0.1], [0, float("nan")], "not-finite"),
        ([0.0, 0.1], [0, 6], "unreachable"),
        ([0.0, 1e-5], [0, 0], "dense"),
        ([0.0, 10.5], [0, 0], "span"),
        ([0.0, 1.1e9], [0, 0], "offset"),
        ([1.1e9, 1.1e9 + 0.1], [0, 0], "offset"),
        ([1.1e9, 0.1], [0, 0], "order"),
    ],
)
def test_bad_chunks_are_refused(gate: Gate, times: list, values: list, code: str) -> None:
    assert gate.chunk(0, np.array(times), np.array(values, float)).code == code
    assert gate.chunk(0, grid(0, 0.1)).ok  # a trajectory can still begin


def test_a_chunk_in_the_midst_of_nothing_is_refused(gate: Gate) -> None:
    assert gate.chunk(3, grid(0, 0.1)).code == "over"


def test_a_chunk_must_begin_after_the_one_before(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.1)).ok
    assert gate.chunk(1, grid(0.09, 0.1)).code == "order"


@settings(max_examples=50)
@example([(3.0, False)] * 12)  # sent twice as fast as they are played
@given(st.lists(st.tuples(st.floats(0.05, 3.0), st.booleans()), min_size=1, max_size=40))
def test_the_queue_never_holds_more_than_configured(steps: list[tuple[float, bool]]) -> None:
    """The loop's queue never holds more than the configured 10 s. Chunks of random length arrive at
    random times; the reference queue is simulated directly: the loop plays from the first chunk on
    and reports now and then."""
    gate = Gate()
    gate.request(1, "acquire")
    core, sent_s, begun, index = gate.gate.core, 0.0, 0, 0
    for length_s, reports in steps:
        gate.request(1, "renew")
        if gate.chunk(index, grid(sent_s, length_s, 0.01)).ok:
            begun = begun or gate.now
            sent_s, index, core.state = (
                sent_s + round(length_s / 0.01) * 0.01,
                index + 1,
                State.RUNNING,
            )
        gate.now += round(0.5 * length_s * S)
        played_s = (gate.now - begun) / S if begun else 0.0
        assert sent_s - played_s <= 10.0 + 1e-6
        ahead_s = max(0.0, sent_s - played_s)
        assert gate.gate.queue_ahead_s(gate.now) >= ahead_s - 0.011
        if reports:
            core.queue_s, core.status_ns = ahead_s, gate.now


def test_a_new_gateway_goes_on_where_the_old_one_was_killed(gate: Gate) -> None:
    assert gate.chunk(0, grid(0, 0.1)).ok
    newest = gate.records[-1:]
    fresh = Gate()
    fresh.gate.resume(newest)
    fresh.request(1, "acquire")
    fresh.gate.core.queue_s = 0.1
    assert fresh.chunk(0, grid(0, 0.1)).code == "duplicate"  # the client never got the answer
    assert fresh.chunk(1, grid(0.1, 0.1)).ok
    again = Gate()
    again.gate.resume(newest)
    again.request(1, "acquire")
    assert again.chunk(0, grid(0, 0.2)).ok  # half of it is known: only the rest is passed on
    assert np.allclose(again.records["offset_ns"] * 1e-9, grid(0.1, 0.1))
    assert again.chunk(5, grid(0.9, 0.1)).code == "order"


def test_a_learned_correction_goes_to_the_loop_beside_its_target(gate: Gate) -> None:
    values, learned = np.array([1.0, 2.0, 3.0]), np.array([0.1, -0.2, 0.0])
    assert gate.chunk(0, grid(0.0, 0.003), values, correction=learned.tobytes()).ok
    np.testing.assert_array_equal(gate.records["value"], values)
    np.testing.assert_array_equal(gate.records["correction"], learned)
    wrong = np.array([0.0, np.nan, 0.0])
    later = gate.chunk(1, grid(0.003, 0.003), values, correction=wrong.tobytes())
    assert later.code == "not-finite"


@pytest.mark.parametrize(
    ("value", "code"), [(0.3, "ok"), (float("nan"), "not-finite"), (11.0, "unreachable")]
)
def test_the_gauges_zero_moves_within_reason(gate: Gate, value: float, code: str) -> None:
    reply = gate.request(1, "zero", value=value)
    assert reply.code == code
    if reply.ok:
        assert (gate.records[-1]["kind"], gate.records[-1]["value"]) == (LoopCommand.ZERO, value)


def test_the_gauges_zero_is_the_leaseholders_to_move(gate: Gate) -> None:
    assert gate.request(2, "zero", value=0.1).code == "lease-taken"


@pytest.mark.parametrize("allowed", [True, False])
def test_what_lasts_without_a_client_is_the_configurations_to_allow(
    gate: Gate, allowed: bool
) -> None:
    gate.gate.may_stay = allowed
    for ask in (
        lambda: gate.setpoint(1, 2.0, stay=True),
        lambda: gate.request(1, "hold", stay=True),
    ):
        reply = ask()
        assert (reply.ok, reply.code) == ((True, "ok") if allowed else (False, "stay"))
        if allowed:
            assert gate.records["last"].tolist() == [1]
        else:
            assert "setpoint.stay is false" in reply.text
    assert gate.request(1, "hold").ok
    assert (gate.records["kind"].tolist(), gate.records["last"].tolist()) == (
        [LoopCommand.HOLD],
        [0],
    )
    assert gate.request(2, "hold").code == "lease-taken"
