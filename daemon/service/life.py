"""The supervisor's state machine for the loop's process, as one table.

    starting   the process has been started and has written no sample yet
    beating    the process writes samples
    ending     the process was asked to end and ramps the output
    saving     the process is gone: `dehyst safe` brings the output to its safe state
    unsafe     `dehyst safe` has failed: it is tried again before anything else is started
    waiting    the output is safe: the process is started again after its pause
    last       as saving, but nothing is started afterwards
    over       the supervisor ends

"-": the event changes nothing in that state. `still`: no sample (or no end) within the time that
the state allows; the hanging process is killed first. `refused`: the process exited with code 2,
having said why, before any process ever wrote a sample.
"""

from enum import StrEnum

TABLE = """
          sample   still    died     refused  well     saved    failed   due       end
starting  beating  saving   saving   over     saving   -        -        -         ending
beating   -        saving   saving   saving   saving   -        -        -         ending
ending    -        last     last     last     over     -        -        -         -
saving    -        unsafe   -        -        -        waiting  unsafe   -         last
unsafe    -        -        -        -        -        -        -        saving    last
waiting   -        -        -        -        -        -        -        starting  over
last      -        over     -        -        -        over     over     -         -
over      -        -        -        -        -        -        -        -         -
"""


class Life(StrEnum):
    """States of the loop's process as the supervisor sees it."""

    STARTING = "starting"
    BEATING = "beating"
    ENDING = "ending"
    SAVING = "saving"
    UNSAFE = "unsafe"
    WAITING = "waiting"
    LAST = "last"
    OVER = "over"


class LifeEvent(StrEnum):
    """Events that the supervisor observes."""

    SAMPLE = "sample"
    STILL = "still"
    DIED = "died"
    REFUSED = "refused"
    WELL = "well"
    SAVED = "saved"
    FAILED = "failed"
    DUE = "due"
    END = "end"


def _parse(table: str) -> dict[tuple[Life, LifeEvent], Life]:
    head, *rows = (line.split() for line in table.strip().splitlines())
    return {
        (Life(state), LifeEvent(event)): Life(state) if after == "-" else Life(after)
        for state, *cells in rows
        for event, after in zip(head, cells, strict=True)
    }


NEXT: dict[tuple[Life, LifeEvent], Life] = _parse(TABLE)
"""(state, event) -> next state, for every pair."""
