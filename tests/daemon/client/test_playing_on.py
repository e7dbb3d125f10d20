"""The player survives whatever the daemon survives, and reports what ended it. Real processes."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import Bench, environment, wait_until
from tests.rigs.stage_model import kept_model

from dehyst.daemon.bus.messages import Reply, Status
from dehyst.daemon.bus.refusal_codes import CODES
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client import player
from dehyst.daemon.client.client import Refusal
from dehyst.daemon.client.player import Player
from dehyst.daemon.client.repeated import Repeated
from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import State

PERIOD_S, SECONDS = 0.005, 30.0
SHARE = 0.9  # of the reach


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path, **{"stale_s = 1.0": "stale_s = 6.0"})  # a gateway may start slowly
    bench.start_gateway()
    yield bench
    bench.close()


def start_play(bench: Bench, seconds: float = SECONDS) -> "subprocess.Popen[str]":
    """Start `dehyst play` of a 0.5 Hz sine through most of the reach; return once it runs."""
    status = bench.client().status()
    middle = 0.5 * (status.reach_min + status.reach_max)
    half = 0.5 * SHARE * (status.reach_max - status.reach_min)
    t_s = PERIOD_S * np.arange(round(seconds / PERIOD_S))
    target = middle - half * np.cos(np.pi * t_s)
    path = bench.path.parent / "scan.csv"
    rows = "\n".join(f"{a:.3f},{b:.6f}" for a, b in zip(t_s, target, strict=True))
    path.write_text(f"t_s,target_um\n{rows}\n")
    command = [sys.executable, "-m", "dehyst.daemon.main", "play", str(path)]
    process = subprocess.Popen(
        [*command, "--connect", bench.address, "--json"],
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_until(
        "it plays or is refused",
        lambda: bench.loop.state is State.RUNNING or process.poll() is not None,
    )
    assert process.poll() is None, process.communicate()
    return process


def use_model(bench: Bench, share: float) -> None:
    """Load by SIGHUP a model that is valid up to this share of the drive's range."""
    model = kept_model()
    v = model.validity
    top = v.drive_min + share * (v.drive_max - v.drive_min)
    before = bench.loop.ring("status").read(0)[0][-1]["model"]
    save_model(replace(model, validity=replace(v, drive_max=top)), bench.path.parent / "model.toml")
    os.kill(bench.loop.process.pid, signal.SIGHUP)
    wait_until(
        "the loop runs another model",
        lambda: bench.loop.ring("status").read(0)[0][-1]["model"] != before,
    )
    # the scan continues; give its player time to receive the change
    seen = bench.loop.seq
    wait_until("a second of motion with it", lambda: bench.loop.seq > seen + round(1.5 / PERIOD_S))


def test_a_scan_goes_on_through_models_and_a_killed_gateway(bench: Bench) -> None:
    process = start_play(bench)
    begun = bench.loop.seq
    use_model(bench, 0.45)
    bench.kill_gateway()
    bench.start_gateway()
    use_model(bench, 1.0)
    out, err = process.communicate(timeout=120)
    result = json.loads(out)
    assert (result["completed"], result["reason"]) == (True, ""), err
    assert result["samples"] == result["expected_samples"]
    assert len(result["notes"]) == 2, result["notes"]  # one for each model
    assert "are beyond it, by up to" in result["notes"][0]
    assert "they are played at the nearest position" in err
    assert "goes on" in result["notes"][1]
    assert result["unreachable_samples"] > 0
    samples = bench.loop.samples(begun)
    steps = np.abs(np.diff(samples["volts"]))
    assert steps.max() <= bench.config.limits.slew_v_per_s * PERIOD_S * 1.001
    with_client = bench.client()
    text = " ".join(event.text for event in with_client.events())
    assert "points passed on so far are beyond it" in text


def test_a_loop_that_dies_ends_it_in_words_in_the_last_line(bench: Bench) -> None:
    process = start_play(bench, 60.0)
    begun = time.monotonic()
    bench.loop.close()
    bench.start_loop()
    wait_until("the new loop runs", bench.loop.running)
    bench.client()  # the gateway sees it
    took_s = time.monotonic() - begun
    out, err = process.communicate(timeout=120)
    result = json.loads(out)
    assert not result["completed"]
    reasons = ["the loop was restarted"]
    if took_s > player.PATIENCE_S:
        reasons += ["has sent nothing for 10 s", "the loop's process does not run"]
    assert any(reason in result["reason"] for reason in reasons), (took_s, result, err)
    assert process.returncode == 1


class Daemon:
    """Answers the player's requests from a list of refusals. The test drives the clock."""

    patience_s = 0.0

    def __init__(self, answers: list[Exception | None]) -> None:
        self.answers, self.taken = answers, 0

    def report(self, text: str) -> None: ...

    def stream(self) -> object:
        return None

    def feed(self) -> object:
        @dataclass
        class Feed:
            status: Status | None = None

        return Feed()

    def status(self) -> object:
        return Quiet()

    def chunk(self, *_: object) -> Reply:
        answer = self.answers.pop(0) if self.answers else None
        if answer is not None:
            raise answer
        self.taken += 1
        return Reply(ok=True)

    def renew(self) -> None: ...


class Quiet:
    """The parts of a status that a player reads before it begins."""

    core_alive, period_ns, time_ns, trajectory, run = True, 5_000_000, 0, 0, 1
    origin = trim = reach_min = reach_max = 0.0


def play_against(*answers: Exception | None, step_s: float = 0.3, seconds: float = 6.0) -> Player:
    """Return a player that receives these answers in turn, `step_s` apart; later chunks are
    accepted."""
    daemon = Daemon(list(answers))
    t_s = np.arange(round(seconds / PERIOD_S)) * PERIOD_S
    playing = Player(daemon, Repeated(t_s, np.zeros(t_s.size)))  # type: ignore[arg-type]
    now_ns = playing.due_ns
    for _ in range(len(answers) + 3):
        if playing.silent_too_long(now_ns) or playing.refused:
            break
        playing.send(now_ns)
        now_ns += round(step_s * 1e9)
    return playing


REFUSED = sorted(set(CODES) - {"ok", "duplicate"})


@pytest.mark.parametrize("code", REFUSED)
def test_of_all_codes_those_that_ask_for_time_are_waited_out(code: str) -> None:
    playing = play_against(None, *[Refusal(code, "not now")] * 5, None)
    assert bool(playing.refused) is not CODES[code].waits
    assert (playing.index > 2) is CODES[code].waits


@pytest.mark.parametrize("code", REFUSED)
def test_of_all_codes_the_beginning_waits_for_the_same(code: str) -> None:
    if CODES[code].waits:
        assert play_against(*[Refusal(code, "not now")] * 5).index > 0
    else:
        with pytest.raises(Refusal):
            play_against(Refusal(code, "no"))


@pytest.mark.parametrize("code", [c for c in REFUSED if CODES[c].waits])
def test_a_daemon_that_asks_for_time_without_an_end_ends_it(code: str) -> None:
    many = round(2 * player.PATIENCE_S / 0.3)
    playing = play_against(None, *[Refusal(code, "not now")] * many)
    assert bool(playing.refused) is (code != "queue-full")  # a full queue drains


def test_a_daemon_that_is_silent_too_long_ends_it_in_words() -> None:
    many = round(2 * player.PATIENCE_S / 0.3)
    assert "has not answered" in play_against(None, *[BusError("gone")] * many).refused
    assert play_against(None, *[BusError("gone")] * 5, None).index > 2
    with pytest.raises(BusError, match="has not answered"):
        play_against(*[BusError("gone")] * many)
