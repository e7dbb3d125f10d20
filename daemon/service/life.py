"""What the supervisor does with the loop's process: one table of states, and nothing else.

    starting   the process begins; no sample of its own yet
    beating    samples come
    ending     it was asked to end and ramps
    saving     it is gone: `dehyst safe` brings the output to its safe state
    unsafe     `dehyst safe` has failed: it is tried again, nothing is started before
    waiting    the output is safe: the process is started again when its pause is over
    last       as saving, but nothing is started afterwards
    over       the supervisor ends

An event that a state does not list ("-") changes nothing there. `still`: no sample (or no end)
within the time that this state allows; what stands still is killed first. `refused`: the process
ended with 2 before any ever gave a sample, and has said why.
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
    """States of the loop's process, as the supervisor knows it."""

    STARTING = "starting"
    BEATING = "beating"
    ENDING = "ending"
    SAVING = "saving"
    UNSAFE = "unsafe"
    WAITING = "waiting"
    LAST = "last"
    OVER = "over"


class LifeEvent(StrEnum):
    """What the supervisor sees."""

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
"""(state, event) -> state; complete."""
