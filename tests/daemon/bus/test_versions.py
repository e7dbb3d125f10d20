"""Clients and daemons of different versions on real sessions: what works goes on, the rest is said
in words. And a client that has nothing but zenoh and msgpack."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
from tests.rigs.gateway_bench import ROOT, Bench, environment, free_port, started_bench

from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("bench")) as bench:
        yield bench


def test_a_client_of_the_older_keys_is_told_in_words(bench: Bench) -> None:
    """What the client of 0.1.0 does: it finds the token, asks for the status, shows the error."""
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
