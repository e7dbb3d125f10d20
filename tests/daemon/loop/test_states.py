"""Every state of the loop with every event, on the real kernels; the table and its documentation.

The expected transitions are written out here once more: the state stays where nothing is listed.
"""

import itertools
from pathlib import Path

import numpy as np
import pytest
from tests.daemon.loop.test_step import GAIN, PERIOD_NS, Bench, compensator, model, points

from dehyst.daemon.loop import step_kernel
from dehyst.daemon.loop.records_in_memory import SETTINGS
from dehyst.daemon.loop.states import NEXT, NOTHING, TABLE, LoopEvent
from dehyst.daemon.rings.records import COMMAND, LoopCommand, State

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "loop-states.md"
SAFE_V, START_V = 3.0, 20.0
S, E = State, LoopEvent
FOLLOWS = {
    (S.START, E.FAULT): S.FAULT, (S.START, E.END): S.STOPPING,
    (S.READY, E.TARGET): S.RUNNING, (S.READY, E.RELEASE): S.HOLDING,
    (S.READY, E.FAULT): S.FAULT, (S.READY, E.END): S.STOPPING,
    (S.RUNNING, E.HALT): S.HOLDING, (S.RUNNING, E.RELEASE): S.HOLDING,
    (S.RUNNING, E.STALE): S.HOLDING, (S.RUNNING, E.FAULT): S.FAULT,
    (S.RUNNING, E.END): S.STOPPING,
    (S.HOLDING, E.TARGET): S.RUNNING, (S.HOLDING, E.ARRIVED): S.READY,
    (S.HOLDING, E.FAULT): S.FAULT, (S.HOLDING, E.END): S.STOPPING,
    (S.FAULT, E.RAMP): S.HOLDING, (S.FAULT, E.STAY): S.READY, (S.FAULT, E.END): S.STOPPING,
}  # fmt: skip
WAYS = {
    E.TARGET: ("set-point", "trajectory"),
    E.HALT: ("stop", "clear", "hold"),
}


def in_state(state: State) -> Bench:
    """Return a controller in this state, with its output away from the safe voltage."""
    bench = Bench(START_V)
    bench.tick()
    if state is S.START:
        bench.stepper.control["state"] = S.START
    elif state in (S.RUNNING, S.HOLDING):
        bench.send(points(7, np.linspace(2.0, 4.0, 1000).tolist(), 0, True), n=100)
        if state is S.HOLDING:
            bench.tick((LoopCommand.STOP_MOTION, 0.0))
    elif state is S.FAULT:
        bench.stepper.fault(bench.now, "pulled")
    elif state is S.STOPPING:
        bench.stepper.stop(bench.now)
    assert bench.stepper.state is state
    return bench


def inject(bench: Bench, event: LoopEvent, way: str = "") -> None:
    """Apply the event to a controller."""
    if way == "set-point":
        bench.tick((LoopCommand.SETPOINT, 2.0))
    elif way == "trajectory":
        bench.send(points(9, [2.0, 2.1], 0, True))
    elif way == "stop":
        bench.tick((LoopCommand.STOP_MOTION, 0.0))
    elif way == "hold":
        bench.tick((LoopCommand.HOLD, 0.0))
    elif way == "clear":
        clear = points(7, [0.0], 0, False)
        clear["kind"] = LoopCommand.CLEAR
        bench.send(clear)
    elif event is E.RELEASE:
        bench.tick((LoopCommand.RELEASE, 0.0))
    elif event is E.STALE:
        bench.tick(n=3500)  # the trajectory's last second, stale_s 2 s; hold_s is 5 s
    elif event is E.ARRIVED:
        bench.stepper.control["hold_ns"] = 0
        bench.stepper.follow_output(SAFE_V)
        bench.tick()
    elif event is E.FAULT:
        bench.stepper.fault(bench.now, "pulled")
    elif event is E.END:
        bench.stepper.stop(bench.now)
    else:
        bench.stepper.table.kept[SETTINGS]["ramp_on_fault"] = event is E.RAMP
        bench.stepper.recover(bench.now, bench.stepper.volts)


@pytest.mark.parametrize(
    ("state", "event", "way"),
    [(s, e, w) for s, e in itertools.product(State, LoopEvent) for w in WAYS.get(e, ("",))],
)
def test_every_state_with_every_event(state: State, event: LoopEvent, way: str) -> None:
    bench = in_state(state)
    before = bench.stepper.volts
    expected = FOLLOWS.get((state, event), state)
    inject(bench, event, way)
    assert bench.stepper.state is expected
    followed = int(NEXT[state, event])
    assert State(state if followed == NOTHING else followed) is expected
    bench.tick(n=3)
    if expected in (S.FAULT, S.READY, S.START) and event is not E.ARRIVED:
        assert bench.stepper.volts == before  # the output stays in these states
    if expected is S.STOPPING:
        bench.tick(n=1000)
        assert bench.stepper.volts == SAFE_V
        assert bench.stepper.stopped
    elif expected is S.FAULT:
        assert np.isnan(bench.stepper.control["target"][0])  # no motion resumes by itself
    assert (expected is S.STOPPING) >= bench.stepper.stopped


def test_the_document_shows_the_table_that_the_loop_runs() -> None:
    assert TABLE.strip() in DOCUMENT.read_text()


def test_after_a_fault_the_model_follows_the_output_as_it_was_found() -> None:
    """After recovery at another voltage the next reading is expected from there, by the play
    operators."""
    bench = in_state(S.RUNNING)
    bench.stepper.fault(bench.now, "pulled")
    bench.stepper.recover(bench.now, 45.0)
    bench.tick()
    fresh = compensator(model())
    state = fresh.init(bench.volts[0] / GAIN)
    for volts in [*bench.volts[1:-1], 45.0, 45.0]:
        fresh.applied(state, volts / GAIN)
    assert bench.stepper.volts == 45.0
    # moving up from below takes up the backlash, so the branch is known whatever came before
    bench.tick((LoopCommand.SETPOINT, 5.0), n=3)
    assert bench.stepper.state is S.RUNNING
    assert abs(bench.stepper.volts - 45.0) <= 2.0


def test_release_goes_to_the_safe_voltage_at_once_and_stop_holds_first() -> None:
    for command, moved in ((LoopCommand.RELEASE, True), (LoopCommand.STOP_MOTION, False)):
        bench = in_state(S.RUNNING)
        before = bench.stepper.volts
        bench.tick((command, 0.0), n=100)
        assert bench.stepper.state is S.HOLDING
        assert (bench.stepper.volts != before) == moved
    bench.tick((LoopCommand.RELEASE, 0.0), n=10)  # and a release ends a hold
    assert bench.stepper.volts == pytest.approx(before - 10 * 0.04)  # ramp 40 V/s at 1 kHz


@pytest.mark.parametrize("ramps", [False, True])
def test_a_stop_during_a_fault_is_carried_out_when_the_device_is_back(ramps: bool) -> None:
    """It holds and then ramps, as after any stop; with on_fault = "ramp" it ramps at once."""
    bench = in_state(S.RUNNING)
    bench.stepper.table.kept[SETTINGS]["ramp_on_fault"] = ramps
    bench.stepper.fault(bench.now, "pulled")
    held = bench.stepper.volts
    for _ in range(3):
        bench.tick((LoopCommand.STOP_MOTION, 0.0), n=10)
    assert bench.stepper.state is S.FAULT
    assert bench.stepper.volts == held
    assert sum("once it is back" in text for text in bench.stepper.events) == 1
    bench.stepper.recover(bench.now, held)
    bench.tick(n=4900)  # hold_s is 5 s
    assert bench.stepper.state is (S.READY if ramps else S.HOLDING)
    assert bench.stepper.volts == (SAFE_V if ramps else held)
    bench.tick(n=3000)
    assert bench.stepper.state is S.READY
    assert bench.stepper.volts == SAFE_V


def test_a_stop_is_kept_for_one_fault_only() -> None:
    bench = in_state(S.RUNNING)
    bench.stepper.fault(bench.now, "pulled")
    bench.tick((LoopCommand.STOP_MOTION, 0.0))
    bench.stepper.recover(bench.now, bench.stepper.volts)
    bench.tick((LoopCommand.SETPOINT, 2.0), n=5)  # the next command counts
    assert bench.stepper.state is S.RUNNING
    bench.stepper.fault(bench.now, "pulled again")
    bench.tick()
    bench.stepper.recover(bench.now, bench.stepper.volts)
    bench.tick()
    assert bench.stepper.state is S.READY  # on_fault = "hold"


@pytest.mark.parametrize("suspended_ns", [60_000_000_000, 3_600_000_000_000])
@pytest.mark.parametrize("before", [0, 50])
def test_a_loop_that_was_suspended_as_it_ended_ramps_after_it(
    suspended_ns: int, before: int
) -> None:
    """before: samples between the stop and the suspension."""
    bench = in_state(S.RUNNING)
    words = bench.stepper.table.words
    bench.stepper.stop(bench.now)
    for _ in range(before):
        bench.tick()
        assert not step_kernel.stopped(words, bench.now)
    bench.now += suspended_ns
    while not step_kernel.stopped(words, bench.now):
        bench.tick()
    assert bench.stepper.volts == SAFE_V
    bench.stepper.collect_events()
    assert bench.stepper.events[-1] == f"the loop ends with the output at {SAFE_V:g} V"


def test_an_output_that_does_not_follow_is_given_up_after_the_ramp_and_5_s() -> None:
    bench = in_state(S.RUNNING)
    volts, begun = bench.stepper.volts, bench.now
    bench.stepper.stop(bench.now)
    while not step_kernel.stopped(bench.stepper.table.words, bench.now):
        bench.now += PERIOD_NS
        bench.stepper.step(bench.now, 1.0, np.zeros(0, COMMAND))  # and nothing is written
    assert bench.stepper.volts == volts
    assert (bench.now - begun) * 1e-9 == pytest.approx((volts - SAFE_V) / 40.0 + 5.0, abs=0.01)
    bench.stepper.collect_events()
    assert "does not reach its safe voltage" in bench.stepper.events[-1]
