"""What `zero`, `send` and `play` say of a large shift and of an interrupt: what the stage does from
then on, and what was not done."""

import signal
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import Bench, wait_until
from tests.rigs.processes import dehyst

from dehyst.daemon.commands.zero import how_usual
from dehyst.daemon.rings.records import State


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("zero", "--exercise", "--seconds", "60"),
            "stopped early, so the zero was not set; the stage holds the output for 0.2 s, "
            "then ramps to 0 V at 1000 V/s",
        ),
        (("send", "2", "--for", "60"), "holds for 1.2 s, then ramps to 0 V at 1000 V/s"),
        (
            ("play", "WAY"),
            "stopped early; the stage holds the output for 0.2 s, then ramps to 0 V at 1000 V/s",
        ),
    ],
)
def test_an_interrupt_says_what_the_stage_does_now(
    shared: Bench, words: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    way = tmp_path / "way.csv"
    way.write_text("t_s,target_um\n0,3\n30,7\n60,3\n")
    process = dehyst(*(str(way) if w == "WAY" else w for w in words), "--connect", shared.address)
    if words[0] != "play":  # play prints nothing before its end
        assert process.stderr is not None
        first = process.stderr.readline()
        assert "moving through" in first or "going to" in first
    wait_until("it moves", lambda: shared.loop.state is State.RUNNING)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60.0)
    assert process.returncode == 130
    lines = err.splitlines()
    assert lines[-1] == f"dehyst {words[0]}: interrupted"
    assert said in lines[-2]
    wait_until("it is at rest", lambda: shared.loop.state is State.READY)


def test_a_large_shift_of_the_zero_is_not_called_usual() -> None:
    for exercised in (False, True):
        assert how_usual(0.05, exercised).startswith("This is usual")
        large = how_usual(0.24, exercised)
        assert "24 % of the reach" in large
        assert "usual: after" not in large
        assert "the model may be another stage's" in large
        assert "model.file, sensor.scale and actuator.gain" in large
    assert "--exercise" in how_usual(0.24, False)
    assert "--exercise" not in how_usual(0.24, True)
