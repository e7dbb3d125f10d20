"""Clients and daemons of different versions on real sessions: what is compatible works, the rest is
refused with a reason. Also a client that uses only zenoh and msgpack."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
from tests.rigs.gateway_bench import ROOT, Bench, environment, free_port, started_bench, wait_until

from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.rings.records import State

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    # the plain client sleeps for a second between two commands
    long = {"lease_s = 1.5": "lease_s = 10.0"}
    with started_bench(tmp_path_factory.mktemp("bench"), **long) as bench:
        yield bench


def test_a_client_of_the_older_keys_is_reported_in_words(bench: Bench) -> None:
    """A client of 0.1.0 finds the daemon's token, asks for the status, and gets an error that says
    to update the client."""
    with Bus.connect([bench.address]) as bus:
        assert list(bus.alive("dehyst/@v0/*/alive")) == ["dehyst/@v0/bench/alive"]
        with pytest.raises(BusError, match=r"refused: .*speaks @v1 of the bus; update the client"):
            list(bus.ask("dehyst/@v0/bench/rpc/status"))
        with pytest.raises(BusError, match="update the client"):
            list(bus.ask("dehyst/@v0/bench/rpc/command", b"\x80"))


def test_a_daemon_of_the_older_keys_is_named_in_words() -> None:
    address = f"tcp/127.0.0.1:{free_port()}"
    with Bus.serve([address], []) as old:
        old.announce("dehyst/@v0/stage-1/alive")
        with pytest.raises(BusError, match=r"stage-1 .* speaks an older version of the bus"):
            Client(connect=address)


def test_a_command_with_fields_of_a_later_version_works(bench: Bench) -> None:
    with Bus.connect([bench.address]) as bus:
        request = {
            "schema": "dehyst.request", "version": 9, "client": 11, "sent_ns": 1,
            "action": "acquire", "of_later": {"a": [1, 2]},
        }  # fmt: skip
        key = "dehyst/@v1/bench/rpc/command"
        reply = msgpack.unpackb(next(iter(bus.ask(key, msgpack.packb(request)))))
        assert reply["ok"], reply
        request |= {"action": "give-up", "lease": reply["lease"], "sent_ns": 2}
        assert msgpack.unpackb(next(iter(bus.ask(key, msgpack.packb(request)))))["ok"]


def test_the_plain_client_commands_and_reads(bench: Bench) -> None:
    example = Path(ROOT) / "docs" / "examples" / "plain_client.py"
    source = example.read_text()
    assert "dehyst." not in source.replace('"dehyst.', "").replace("`dehyst", "").replace(
        "a dehyst daemon", ""
    ), "it must use nothing of dehyst"
    begun = bench.loop.seq
    done = subprocess.run(
        [sys.executable, "-P", str(example), bench.address],
        env=environment(), text=True, capture_output=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "samples, targets from" in done.stdout
    targets = bench.loop.samples(begun)["target"]
    status_reach = done.stdout
    assert status_reach
    assert targets[targets == targets].size > 300


KILLED = """
import sys, time
sys.argv[1:] = [{address!r}]
sys.path.insert(0, {folder!r})
import plain_client, zenoh
stage = plain_client.Stage(plain_client.connect())
stage.acquire()
while True:
    stage.go(6.5)
    time.sleep(0.05)
"""


def test_a_plain_client_that_is_killed_in_motion_leaves_the_stage_as_any_client_does(
    bench: Bench,
) -> None:
    bench.rest()  # nobody else commands
    code = KILLED.format(address=bench.address, folder=str(ROOT / "docs" / "examples"))
    program = subprocess.Popen([sys.executable, "-P", "-c", code], env=environment())
    newest = lambda: bench.loop.samples(bench.loop.seq - 1)[-1]  # noqa: E731
    try:
        wait_until("it moves", lambda: newest()["target"] == 6.5)
    finally:
        program.kill()
        program.wait()
    wait_until("it lets go", lambda: bench.loop.state == State.READY)
    assert newest()["volts"] == pytest.approx(0.0, abs=0.1)
