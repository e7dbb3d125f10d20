"""The supervisor's table of states, every state with every event.

The requirements are written here as rules, not copied from the table.
"""

import itertools

import pytest

from dehyst.daemon.service.life import NEXT, Life, LifeEvent

ALIVE = {Life.STARTING, Life.BEATING, Life.ENDING}
GONE = {LifeEvent.DIED, LifeEvent.WELL, LifeEvent.REFUSED}
PAIRS = list(itertools.product(Life, LifeEvent))


def test_the_table_is_complete() -> None:
    assert set(NEXT) == set(PAIRS)


@pytest.mark.parametrize(("state", "event"), PAIRS)
def test_every_state_with_every_event(state: Life, event: LifeEvent) -> None:
    after = NEXT[state, event]
    if state is Life.OVER:
        assert after is Life.OVER
    if after is Life.STARTING and state is not Life.STARTING:
        # the only way to a start: the output was made safe, and the pause is over
        assert (state, event) == (Life.WAITING, LifeEvent.DUE)
    if after is Life.WAITING and state is not Life.WAITING:
        assert (state, event) == (Life.SAVING, LifeEvent.SAVED)
    if state in ALIVE and event in GONE | {LifeEvent.STILL}:
        # a process that has ended is in no running state, and the output is made safe, unless the
        # process ended as asked or has never moved anything
        assert after not in ALIVE
        well = state is Life.ENDING and event is LifeEvent.WELL
        never_moved = state is Life.STARTING and event is LifeEvent.REFUSED
        assert after in ({Life.OVER} if well or never_moved else {Life.SAVING, Life.LAST})
    if event is LifeEvent.END and state is not Life.OVER:
        # after a request to end there is no new start
        assert after in {Life.ENDING, Life.LAST, Life.OVER}
        assert (after is Life.OVER) == (state is Life.WAITING)
    if state in {Life.ENDING, Life.LAST}:
        assert after in {Life.ENDING, Life.LAST, Life.OVER}
    if event is LifeEvent.FAILED and state is Life.SAVING:
        assert after is Life.UNSAFE
    if state is Life.UNSAFE and event is LifeEvent.DUE:
        assert after is Life.SAVING


def test_the_end_is_reached_from_everywhere() -> None:
    for state in Life:
        after = NEXT[state, LifeEvent.END]
        for event in (LifeEvent.DIED, LifeEvent.FAILED):
            after = NEXT[after, event]
        assert after is Life.OVER, state


def test_a_core_that_keeps_dying_comes_back_as_long_as_the_output_can_be_made_safe() -> None:
    state = Life.STARTING
    for _ in range(5):
        for event in (
            LifeEvent.SAMPLE,
            LifeEvent.DIED,
            LifeEvent.FAILED,
            LifeEvent.DUE,
            LifeEvent.SAVED,
            LifeEvent.DUE,
        ):
            state = NEXT[state, event]
        assert state is Life.STARTING
