"""How busy a machine is, from a /proc that is written here, and how an act is judged
accordingly."""

import multiprocessing
import os
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dehyst.daemon.bus.messages import DoctorReport, FoundEffect
from dehyst.daemon.demo.busy import (
    MOST_STRETCH,
    Busy,
    Patience,
    ProcessorTicks,
    busy_between,
    read_spent,
)
from dehyst.daemon.demo.demo import join_acts
from dehyst.daemon.demo.second_act import Story

QUIET = Busy()
LOADED = Busy(others=0.5)
LATE = Busy(late=0.1)


def lay_proc(folder: Path, cpu: str, processes: dict[int, tuple[int, int]]) -> Path:
    """Write a /proc with processes {pid: (parent, ticks)}; return its folder."""
    folder.mkdir()
    (folder / "stat").write_text(f"cpu  {cpu}\ncpu0 1 2 3\n")
    for pid, (parent, ticks) in processes.items():
        (folder / str(pid)).mkdir()
        words = f"{pid} (a (name) x) S {parent} 1 1 0 -1 0 0 0 0 0 {ticks} 1 1 1 20 0 1 0 9 0 0"
        (folder / str(pid) / "stat").write_text(words)
    return folder


def test_what_this_process_and_its_children_took_is_no_work_of_others(tmp_path: Path) -> None:
    me = os.getpid()
    family = {me: (1, 10), me + 1: (me, 20), me + 2: (me + 1, 30), me + 3: (1, 1000), 1: (0, 5)}
    first = read_spent(lay_proc(tmp_path / "a", "100 0 100 1000 0 0 0 20 0 0", family))
    assert first.own == 10 + 20 + 30 + 3 * 3
    assert (first.total, first.idle, first.stolen) == (1220, 1000, 20)
    last = ProcessorTicks(first.at_s + 1.0, first.total + 200, first.idle + 60, first.stolen + 20,
                 first.own + 70)  # fmt: skip
    busy = busy_between(first, last)
    assert busy.others == pytest.approx(0.25)  # 200 less 60 idle, 20 stolen, 70 of its own
    assert busy.stolen == pytest.approx(0.1)


def test_a_machine_that_says_nothing_of_itself_is_not_called_busy(tmp_path: Path) -> None:
    nothing = read_spent(tmp_path / "none")
    assert busy_between(nothing, nothing).why == ""
    assert busy_between(nothing, nothing).stretch == 1.0


def burn() -> None:
    """Use a processor until killed."""
    while True:
        pass


def test_work_of_a_child_is_its_own_on_this_machine() -> None:
    child = multiprocessing.get_context("fork").Process(target=burn)
    first = read_spent()
    child.start()
    try:
        end = time.monotonic() + 20.0
        while read_spent().own - first.own < 20 and time.monotonic() < end:
            time.sleep(0.02)
        assert read_spent().own - first.own >= 20
    finally:
        child.kill()
        child.join()


@given(
    others=st.floats(0.0, 1.0), stolen=st.floats(0.0, 1.0), load=st.floats(0.0, 100.0),
    late=st.floats(0.0, 1.0),
)  # fmt: skip
@example(others=0.25, stolen=0.03125, load=0.0, late=0.0)  # neither is too much, their sum would be
def test_a_wait_is_never_shorter_nor_without_end_and_longer_only_where_it_is_said_why(
    others: float, stolen: float, load: float, late: float
) -> None:
    busy = Busy(others, stolen, load, late)
    assert 1.0 <= busy.stretch <= MOST_STRETCH
    assert busy.stretch == 1.0 or busy.why
    calm = Busy(others / 2, stolen / 2, load / 2, late)
    assert calm.stretch <= busy.stretch


def test_patience_lasts_longer_on_a_busy_machine_and_says_what_it_waits_for() -> None:
    spent = []
    for busy in (QUIET, LOADED, Busy(others=1.0)):
        said: list[str] = []
        patience = Patience(100.0, "for the doctor", said.append)
        while not patience.over:
            patience.pass_by(1.0, busy)
        spent.append(patience.spent_s)
        assert len(said) == patience.spent_s // 20
        assert said[0].startswith("   waiting for the doctor, 20 s now")
        assert ("busy" in said[0]) == (busy is not QUIET)
    assert spent == [100.0, 200.0, 600.0]


def act(named: str, state: str, after: float, busy: Busy) -> Story:
    """Return a second act in which a lag was drawn."""
    effects = (FoundEffect(name=named, acts_on="stage", share=1.0, says=""),) if named else ()
    report = DoctorReport(case="c", time_ns=1, wall_ns=1, changed_wall_ns=1, state=state,  # type: ignore[arg-type]
                          effects=effects, says="")  # fmt: skip
    rms = {"before": 0.07, "during": 0.3, "after": after}
    return Story(drawn="lag", report=report, rms=rms, busy=busy, t_s=np.arange(9.0))


@pytest.mark.parametrize(
    ("named", "state", "after", "quiet", "loaded", "late"),
    [
        ("lag", "accepted", 0.05, 0, 0, 0),
        ("lag", "accepted", 0.25, 1, 77, 77),  # the error stays closer to that with the effect
        ("creep", "accepted", 0.05, 1, 77, 77),
        ("lag", "returned", np.nan, 1, 77, 77),
        ("lag", "trial", np.nan, 1, 77, 77),
        ("", "working", np.nan, 1, 77, 77),
    ],
)
def test_what_was_not_so_counts_where_the_machine_had_time_and_only_there(
    named: str, state: str, after: float, quiet: int, loaded: int, late: int
) -> None:
    codes = [act(named, state, after, busy).exit_status for busy in (QUIET, LOADED, LATE)]
    assert codes == [quiet, loaded, late]


def test_of_both_acts_what_was_not_so_counts_before_what_cannot_be_judged() -> None:
    assert join_acts([0, 0]) == 0
    assert join_acts([77, 0]) == join_acts([0, 77]) == 77
    assert join_acts([77, 1]) == join_acts([1, 77]) == join_acts([1]) == 1
