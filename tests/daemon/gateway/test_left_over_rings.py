"""The gateway recognises whether the process that made the rings still runs, whatever process id
they contain."""

import os
from pathlib import Path

from hypothesis import example, given
from hypothesis import strategies as st

from dehyst.daemon.gateway.core_rings import LAYOUTS, CoreRings
from dehyst.daemon.rings.layout import PID
from dehyst.daemon.rings.ring import Ring

WORD = st.integers(-(2**63), 2**63 - 1)


def attached(folder: Path) -> CoreRings:
    """Return a reader attached to rings that this process made."""
    for name, dtype in LAYOUTS.items():
        Ring.create(folder / f"{name}.ring", dtype, 64)
    rings = CoreRings(folder)
    assert rings.refresh()
    return rings


def test_those_of_a_running_process_are_in_use(tmp_path: Path) -> None:
    rings = attached(tmp_path)
    assert not rings.is_left_over
    assert not CoreRings(tmp_path / "none").is_left_over


def test_no_number_in_a_ring_ends_the_gateway(tmp_path_factory) -> None:
    rings = attached(tmp_path_factory.mktemp("rings"))
    words = rings._rings["event"].words

    @given(WORD)
    @example(2**63 - 1)
    @example(-(2**63))
    def holds(number: int) -> None:
        words[PID] = number
        running = Path(f"/proc/{number}").exists()
        said = rings.is_left_over
        if number > 0:
            assert said != running

    holds()
    words[PID] = os.getpid()
