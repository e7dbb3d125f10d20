"""The gateway as a real process, between real rings and real zenoh clients."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import ROOT, Bench, follows, renewed, wait_until

from dehyst.daemon.bus import encoding, messages, topics
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.player import PATIENCE_S
from dehyst.daemon.files.models import load_model
from dehyst.daemon.rings.records import LoopCommand, State

STRANGER = 2**63 - 1
"""The largest number that a client may have."""


def collect(client: Client, count: int) -> np.ndarray:
    """Return at least `count` samples."""
    stream, parts = client.stream(), []
    end = time.monotonic() + 60.0
    while sum(p.size for p in parts) < count:
        assert time.monotonic() < end, "no telemetry"
        parts.append(stream.read(0.1))
    stream.close()
    return np.concatenate(parts)


def test_every_sample_arrives_bit_for_bit(shared: Bench) -> None:
    client = shared.client()
    samples = collect(client, 200)
    assert np.all(np.diff(samples["seq"]) == 1)
    first = int(samples["seq"][0])
    written = shared.loop.samples(first)[: samples.size]
    assert written.tobytes() == samples.tobytes()
    history = client.history(seconds=0.5)
    assert history.size == 100  # a late loop skips deadlines
    assert np.all(np.diff(history["seq"]) == 1)
    whole = client.history()
    assert whole["seq"][0] == 0
    assert np.all(np.diff(whole["seq"]) == 1)


def test_setpoints_asked_and_put_reach_the_loop(shared: Bench) -> None:
    client, begun = shared.client(), shared.loop.seq
    client.send(3.0)

    def there(target: float) -> bool:
        """Return whether the loop has followed this target and the model predicted that it was
        reached."""
        heard = client.history(10.0)
        heard = heard[heard["seq"] >= begun]
        return bool(np.any((heard["target"] == target) & (abs(heard["predicted"] - target) < 1e-3)))

    wait_until("the loop follows and is there", lambda: there(3.0))
    for value in (4.0, 5.0):
        client.put(value)
    wait_until("the last one holds", lambda: there(5.0))

    def runs() -> bool:
        client.put(5.0)  # repeated before it is a second old
        status = client.status()
        return status.state == "running" and status.gateway.lease_client == client.client

    wait_until("the status says so", runs)
    with pytest.raises(Refusal, match="cannot be reached"):
        client.send(100.0)
    with pytest.raises(Refusal, match="NaN"):
        client.send(float("nan"))
    client.stop()
    wait_until("stopped", lambda: shared.loop.state is State.READY)


def test_questions_are_answered(shared: Bench) -> None:
    client = shared.client()
    assert client.name == "bench"
    assert client.config() == shared.config
    model = client.model()
    assert model.displacement_unit == "um"
    assert np.array_equal(model.hysteresis.b, load_model(shared.config.model.file).hysteresis.b)
    status = client.status()
    assert 0.0 < status.reach_min < 2.0  # after moving up, 0 V does not bring it back to 0 um
    assert 9.0 < status.reach_max < 14.0
    assert status.gateway.pid == (shared.gateway.pid if shared.gateway else 0)


def test_whatever_is_put_or_asked_the_gateway_goes_on(shared: Bench) -> None:
    client = shared.client()
    feed = client.feed()
    key = client.keys.pubsub("setpoint_um", str(STRANGER))
    good = messages.Setpoint(client=STRANGER, lease=1, sequence=1, sent_ns=0, value=1.0, unit="um")
    request = messages.Request(client=STRANGER, sent_ns=0, action="stop")
    bad = [
        b"",
        b"\xff" * 100,
        b"\xdd\xff\xff\xff\xff",
        b"\x91" * 10_000,
        os.urandom(5000),
        b"\x00" * 10_000_000,
        encoding.encode(good),  # without a valid lease
        encoding.encode(request),  # must be sent as a query
    ]
    with Bus.connect([shared.address]) as raw:
        sender = raw.sender(key, topics.SETPOINT)
        wait_until("the way is known", lambda: sender.put(b"") or bool(feed.rejections))
        for payload in bad:
            sender.put(payload)
        for payload in bad[:5]:
            answer = next(iter(raw.ask(client.keys.rpc("command"), payload)))
            assert encoding.decode(messages.Reply, answer).code == "bad-message"
            with pytest.raises(BusError, match="refused"):
                list(raw.ask(client.keys.rpc("history"), payload + b"\x01"))
        wait_until("all have come", lambda: {r.code for r in feed.rejections} >= {"no-lease"})
    of_its_sender = {"no-lease", "bad-message"}  # a put has no answer: this is how it learns of it
    assert {r.code for r in feed.rejections if r.client == STRANGER} >= of_its_sender
    client.send(2.0)
    rejected = client.status().gateway.rejected
    assert rejected["bad-message"] >= 5 + 6
    assert rejected["no-lease"] >= 1
    assert not np.any(shared.loop.commands["client"] == STRANGER)
    assert np.any(shared.loop.commands["client"] == client.client)


def test_a_flood_neither_stops_telemetry_nor_a_stop(shared: Bench) -> None:
    client, other = shared.client("the flooder"), shared.client("the one who stops")
    client.send(2.0)
    flooding = threading.Event()
    flooding.set()
    count = [0]

    def flood() -> None:
        while flooding.is_set():
            for _ in range(100):
                client.put(2.0 + count[0] % 5)
                count[0] += 1

    stream = other.stream()
    thread = threading.Thread(target=flood)
    thread.start()
    try:
        wait_until("a flood", lambda: count[0] > 5000)
        other.stop()
        wait_until("more of it", lambda: count[0] > 10_000)
    finally:
        flooding.clear()
        thread.join()
    samples = stream.read(0.5)
    assert np.all(np.diff(samples["seq"]) == 1)
    assert stream.lost == 0
    given = shared.loop.commands
    assert np.any((given["kind"] == LoopCommand.STOP_MOTION) & (given["client"] == other.client))
    assert other.status().core_alive


def test_one_commands_and_the_other_is_reported(shared: Bench) -> None:
    first, second = shared.client("the first"), shared.client("the second")
    first.send(2.0)
    with renewed(first), pytest.raises(Refusal, match="the first commands") as refused:
        second.send(3.0)
    assert refused.value.code == "lease-taken"
    second.take_over()
    second.send(3.0)
    with renewed(second), pytest.raises(Refusal, match="the second commands"):
        first.send(2.0)
    second.close()  # gives up the lease
    first.send(4.0)
    wait_until("silence ends the lease", lambda: first.status().gateway.lease_client == 0)


def test_kill_the_gateway_and_nobody_loses_a_sample(shared: Bench) -> None:
    client = shared.client()
    client.send(2.0)
    stream = client.stream()
    samples = [stream.read(1.0)]
    beats = shared.loop.seq
    assert shared.kill_gateway() == -signal.SIGKILL
    with pytest.raises(BusError):
        client.status()
    wait_until("the loop goes on", lambda: shared.loop.seq > beats + 50)
    shared.start_gateway()
    resumed = shared.loop.seq + 50
    while not samples[-1].size or samples[-1]["seq"][-1] < resumed:
        samples.append(stream.read(1.0))
        assert len(samples) < 10_000
    seq = np.concatenate(samples)["seq"]
    assert np.all(np.diff(seq) == 1)
    assert stream.lost == 0
    client.send(3.0)  # acquires the lease again


@pytest.mark.timing  # the client retries for 10 s; the gateway must be back by then
def test_a_trajectory_survives_a_killed_gateway(bench: Bench) -> None:
    client = bench.client()
    t_s = np.arange(0.0, 12.0, 0.005)
    killing: list[threading.Thread] = []
    over, took_s = threading.Event(), [0.0]

    def again() -> None:
        begun = time.monotonic()
        bench.kill_gateway()
        bench.start_gateway()
        took_s[0] = time.monotonic() - begun
        over.wait()  # the gateway dies with the thread that started it: PR_SET_PDEATHSIG, prctl(2)

    def progress(at_s: float, _total_s: float) -> None:
        if at_s > 2.0 and not killing:  # all that is sent ahead has been sent
            killing.append(threading.Thread(target=again))
            killing[0].start()

    targets = 5.0 + 3.0 * np.sin(2 * np.pi * t_s)
    try:
        played = client.play(t_s, targets, progress=progress, lead_s=9.0)
    finally:
        over.set()
    killing[0].join()
    if not played.completed and took_s[0] > PATIENCE_S:
        pytest.skip(f"the gateway was back after {took_s[0]:.3g} s: {played.reason}")
    assert played.completed, played.reason
    assert played.tracking.samples == played.tracking.expected
    assert played.lost == 0
    points = bench.loop.commands[bench.loop.commands["kind"] == LoopCommand.POINT]
    assert np.all(np.diff(points["offset_ns"]) > 0)  # no point was passed on twice
    assert points.size == t_s.size
    assert np.allclose(points["value"], 5.0 + 3.0 * np.sin(2 * np.pi * t_s))


def test_a_stop_by_another_ends_a_trajectory_with_the_reason(shared: Bench) -> None:
    client, other = shared.client(), shared.client()
    t_s = np.arange(0.0, 30.0, 0.005)
    stopping = threading.Thread(target=other.stop)

    def look(at_s: float, _: float) -> None:
        if at_s > 0.5 and stopping.ident is None:
            stopping.start()  # beside the player, whose queue runs dry while it waits

    played = client.play(t_s, 5.0 + np.sin(t_s), progress=look)
    stopping.join()
    assert not played.completed
    assert "stopped" in played.reason
    with pytest.raises(Refusal, match="acquire the lease"):
        client.send(2.0)
    client.acquire()
    with pytest.raises(Refusal, match="cannot be reached"):
        client.play(t_s, 100.0 + t_s)


def test_a_callback_that_fails_stops_what_was_sent_ahead(shared: Bench) -> None:
    client, t_s = shared.client(), np.arange(0.0, 30.0, 0.005)

    def fail(at_s: float, _: float) -> None:
        if at_s > 0.5:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        client.play(t_s, 5.0 + np.sin(t_s), progress=fail)
    begun = shared.loop.seq
    wait_until("half a second passes", lambda: shared.loop.seq > begun + 100)
    assert np.isnan(shared.loop.samples(shared.loop.seq - 1)[-1]["target"])


def test_a_client_killed_in_mid_trajectory_ends_in_hold_and_ramp(
    shared: Bench, tmp_path: Path
) -> None:
    path = tmp_path / "long.csv"
    t_s = np.arange(0.0, 60.0, 0.01)
    rows = "".join(f"{t:.2f},{5 + np.sin(t):.6f}\n" for t in t_s)
    path.write_text("t_s,target_um\n" + rows)
    client = shared.client()
    command = [sys.executable, "-m", "dehyst.daemon.main", "play", str(path)]
    player = subprocess.Popen(
        [*command, "--connect", shared.address],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        stderr=subprocess.DEVNULL,
    )
    stream, begun = client.stream(), shared.loop.seq
    wait_until("it plays", lambda: client.status().state == "running")
    player.kill()
    player.wait(10)
    states: list[int] = []
    while State.READY not in states:
        samples = stream.read(1.0)
        states += samples["state"].tolist()
        if State.RUNNING in states:
            states = states[states.index(State.RUNNING) :]
        elif State.HOLDING not in states:
            states.clear()
        assert stream.next_seq < begun + 200 * 30
    order = [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]
    assert order == [State.RUNNING, State.HOLDING, State.READY]


def test_the_core_comes_back_with_new_rings(shared: Bench) -> None:
    client = shared.client()
    restarts = client.status().gateway.restarts_of_core
    feed, stream = client.feed(), client.stream()
    before = stream.read(60.0)
    run = stream.run
    assert before.size
    shared.loop.close()
    wait_until("it is missed", lambda: feed.status is not None and not feed.status.core_alive)
    with pytest.raises(Refusal, match="does not run"):
        client.send(2.0)
    shared.start_loop()

    def new_samples() -> bool:
        return bool(stream.read(0.1).size) and stream.run != run

    wait_until("the new one's samples", new_samples)
    wait_until("and it follows", lambda: follows(client))
    client.send(2.0)
    assert client.status().gateway.restarts_of_core == restarts + 1
    assert {"core"} <= {event.code for event in feed.events}


def test_the_rings_of_an_earlier_daemon_are_no_restart(bench: Bench) -> None:
    bench.loop.close()
    bench.kill_gateway()
    bench.has_loop = False
    bench.start_gateway()
    with Client("bench", bench.address) as asking:
        wait_until("the earlier samples are read", lambda: bool(asking.history().size))
    bench.has_loop = True
    bench.start_loop()
    assert bench.client().status().gateway.restarts_of_core == 0


def test_a_subscriber_that_stands_still_holds_nobody_up(shared: Bench) -> None:
    command = [sys.executable, "-m", "dehyst.daemon.main", "watch", "--connect", shared.address]
    client = shared.client()
    slow = subprocess.Popen(
        command,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.PIPE,
    )
    assert slow.stdout is not None
    assert slow.stdout.readline()
    slow.send_signal(signal.SIGSTOP)
    try:
        samples = collect(client, 400)
        assert np.all(np.diff(samples["seq"]) == 1)
        client.send(2.0)
    finally:
        slow.send_signal(signal.SIGCONT)
        slow.kill()
        slow.stdout.close()
        slow.wait(10)


def test_sigterm_ends_it_and_systemd_is_reported(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.kill_gateway(signal.SIGINT)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(60.0)
        env = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
        env |= {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "400000"}
        env.pop("WATCHDOG_PID", None)
        command = [sys.executable, "-m", "dehyst.daemon.main", "gateway", "--config"]
        bench.gateway = subprocess.Popen([*command, str(bench.path)], env=env)
        said = [manager.recv(4096).decode() for _ in range(4)]
        assert said[0] == "READY=1"
        assert "WATCHDOG=1\nSTATUS=ready" in said[3]
        assert bench.kill_gateway(signal.SIGTERM) == 0
        while said[-1] != "STOPPING=1":
            said.append(manager.recv(4096).decode())


def test_a_second_gateway_is_refused_in_one_line(shared: Bench) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", "gateway", "--config", str(shared.path)],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == 2
    assert shared.gateway is not None
    assert f"in use by process {shared.gateway.pid} (dehyst gateway of" in done.stderr
    assert "Traceback" not in done.stderr
