"""Connections and subscribers that misbehave do not affect the others."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgpack
import numpy as np
import pytest
from tests.rigs.gateway_bench import ROOT, Bench, environment, longest_pause_s, noted_pauses
from tests.rigs.hostile import idle_connections

from dehyst.daemon.bus import encoding, messages
from dehyst.daemon.bus.encoding import MAX_ANSWERED_BYTES, MAX_COMMAND_BYTES
from dehyst.daemon.bus.session import Asked, Bus
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.telemetry import TelemetryStream

DEAF = 15
SLOW, SLOW_BYTES_PER_S, SLOW_FOR_S = 5, 100_000, 10.0
"""A quarter of what the daemon publishes at 4 kHz."""
LONGEST_SILENCE_S = 0.5


class Ear:
    """The times at which one client received something."""

    def __init__(self, bus: Bus, key: str) -> None:
        self.times: list[float] = []
        bus.listen(key, lambda _key, _payload: self.times.append(time.monotonic()))

    @property
    def longest_silence_s(self) -> float:
        """The longest silence until now [s]: if nothing more arrives, that counts too."""
        return float(np.diff([*self.times, time.monotonic()]).max())


@dataclass
class Watched:
    """A gateway at 4 kHz, an operator, and a listener whose telemetry is timed."""

    bench: Bench
    operator: Client
    listener: Client
    samples: TelemetryStream
    telemetry: Ear
    pauses: list[float]
    begun: int

    @property
    def longest_allowed_s(self) -> float:
        """The longest silence that counts as none [s]: a machine that stands still is silent."""
        pause_s = longest_pause_s(self.bench.loop.samples(self.begun))
        return LONGEST_SILENCE_S + max(self.pauses) + pause_s

    @contextmanager
    def beside(self, count: int, bytes_per_s: int = 0) -> Iterator[None]:
        """Run subscribers that stop reading once they have received something, or read so many
        bytes a second."""
        key = self.operator.keys.root + "/**"
        crowd = [str(self.bench.port), key, str(count), str(bytes_per_s)]
        command = [sys.executable, "-m", "tests.rigs.hostile", *crowd]
        paths = environment() | {"PYTHONPATH": f"{ROOT / 'src'}:{ROOT}"}
        with subprocess.Popen(command, stdout=subprocess.PIPE, env=paths) as deaf:
            try:
                assert deaf.stdout is not None
                assert deaf.stdout.readline() == b"deaf\n"
                assert self.operator.status().gateway.links == 2 + count
                yield
            finally:
                deaf.kill()


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[Watched]:
    bench = Bench(tmp_path, **{"rate_hz = 200.0": "rate_hz = 4000.0"})
    with ExitStack() as stack:
        stack.callback(bench.close)
        bench.start_gateway()
        operator, listener = bench.client("operator"), bench.client("listener")
        samples = listener.stream()
        telemetry = Ear(listener.bus, operator.keys.pubsub("telemetry"))
        pauses, begun = stack.enter_context(noted_pauses()), bench.loop.seq
        yield Watched(bench, operator, listener, samples, telemetry, pauses, begun)


@pytest.mark.timing
@pytest.mark.alone
def test_subscribers_that_do_not_read_cost_nobody_else_anything(watched: Watched) -> None:
    bench, operator = watched.bench, watched.operator
    assert bench.gateway is not None
    status = watched.listener.feed()
    statuses = Ear(watched.listener.bus, operator.keys.pubsub("status"))
    pid = operator.status().gateway.pid
    with watched.beside(DEAF):
        end = time.monotonic() + 90.0
        while time.monotonic() < end and operator.status().gateway.links > 2:
            for act in (lambda: operator.send(2.0), operator.release):  # each change is a status
                act()
                watched.samples.read(0.05)
        assert operator.status().gateway.links == 2
        assert watched.samples.lost == 0
        silences_s = watched.telemetry.longest_silence_s, statuses.longest_silence_s
        allowed_s = watched.longest_allowed_s
        assert silences_s[0] < allowed_s
        assert silences_s[1] < 1.2 + allowed_s
        now = operator.status().gateway
        assert now.pid == pid
        assert now.links_ended >= DEAF
        assert status.bad == 0
        assert bench.gateway.poll() is None


@pytest.mark.timing
@pytest.mark.alone
def test_subscribers_that_read_slowly_lose_batches_and_delay_nobody_else(watched: Watched) -> None:
    with watched.beside(SLOW, SLOW_BYTES_PER_S):
        end = time.monotonic() + SLOW_FOR_S
        while time.monotonic() < end:
            watched.samples.read(0.05)
        silence_s = watched.telemetry.longest_silence_s
        assert watched.operator.status().gateway.links == 2 + SLOW  # none was ended
        assert watched.samples.lost == 0
        assert silence_s < watched.longest_allowed_s


def test_a_command_that_is_too_long_is_answered_with_the_limit(bench: Bench) -> None:
    """The limits are those of docs/topics.md."""
    client = bench.client()
    key = client.keys.rpc("command")
    good = messages.Request(client=client.client, lease=0, sent_ns=1, action="renew")
    for size in (MAX_COMMAND_BYTES, 5_000_000, MAX_ANSWERED_BYTES):
        plain = msgpack.unpackb(encoding.encode(good)) | {"more": b""}
        plain["more"] = b"x" * (size - len(msgpack.packb(plain)) - 3)
        payload = msgpack.packb(plain)
        assert size - 8 <= len(payload) <= size
        (answer,) = client.bus.ask(key, payload, timeout_s=20.0)
        reply = encoding.decode(messages.Reply, answer)
        if size == MAX_COMMAND_BYTES:
            assert reply.code == "no-lease"  # it was read
        else:
            assert reply.code == "bad-message"
            assert "longer than 1048576 bytes" in reply.text
    assert client.status().core_alive
    text = (ROOT / "docs" / "topics.md").read_text()
    assert "at most 1048576 bytes" in text
    assert "more than 8 MiB" in text


def test_few_commands_that_are_too_long_wait() -> None:
    asked = Asked.__new__(Asked)
    for size, most in ((MAX_COMMAND_BYTES, 256), (MAX_COMMAND_BYTES + 1, 8)):
        asked.payload = b"x" * size
        assert asked.may_wait(most - 1, 256)
        assert not asked.may_wait(most, 256)


@pytest.mark.timing
@pytest.mark.alone
def test_idle_connections_keep_no_new_client_out(bench: Bench) -> None:
    with idle_connections(bench.port, 1000):
        took = []
        for _ in range(20):
            begun = time.monotonic()
            with Client("bench", bench.address) as client:
                client.status()
            took.append(time.monotonic() - begun)
    assert np.median(took) < 2.0
