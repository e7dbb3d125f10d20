"""`send` and `play` report what happens next; `--stay` keeps the position after the client has
gone."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.daemon.commands.test_remote import run, trajectory
from tests.rigs.gateway_bench import Bench, wait_until

from dehyst.daemon.rings.records import State

STALE_S, HOLD_S = 1.0, 0.2  # as on the bench


@pytest.fixture(scope="module")
def staying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """A bench whose configuration allows a position to be kept."""
    stay = {"approach_um_per_s": "stay = true, approach_um_per_s"}
    bench = Bench(tmp_path_factory.mktemp("staying"), **stay)
    try:
        bench.start_gateway()
        yield bench
    finally:
        bench.close()


def test_what_comes_next_is_said_and_comes(shared: Bench) -> None:
    shared.client()
    begun = shared.loop.seq
    code, _, err = run("send", "4", bench=shared)
    assert code == 0
    assert "bench: holds for 1.2 s, then ramps to 0 V at 1000 V/s; --for S or --stay" in err
    client = shared.client()
    wait_until("it holds", lambda: State.HOLDING in shared.loop.samples(begun)["state"])
    wait_until("it is down", lambda: client.status().volts == 0.0)
    assert "holds the output for 0.2 s" in run("send", "--stop", bench=shared)[2]
    assert "ramps to 0 V at 1000 V/s now" in run("send", "--release", bench=shared)[2]


def test_to_stay_is_refused_where_the_configuration_does_not_allow_it(
    shared: Bench, tmp_path: Path
) -> None:
    shared.client()
    trajectory(tmp_path / "way.csv", 2.0, 4.0, 0.5)
    for command in (["send", "4", "--stay"], ["play", str(tmp_path / "way.csv"), "--stay"]):
        code, _, err = run(*command, bench=shared)
        assert code == 2
        assert "setpoint.stay is false" in err
    assert shared.client().status().state == "ready"


def test_a_place_is_kept_with_the_client_gone_until_another_command(
    staying: Bench, tmp_path: Path
) -> None:
    client = staying.client()
    code, _, err = run("send", "4", "--stay", bench=staying)
    assert (code, "stays there until another command" in err) == (0, True)
    time.sleep(2.0 * (STALE_S + HOLD_S))
    status = client.status()
    assert (status.state, status.stays, status.gateway.target) == ("running", True, 4.0)
    assert status.gateway.lease_client == 0
    assert "stays until another command" in run("status", bench=staying)[1]
    trajectory(tmp_path / "way.csv", 2.0, 6.0, 1.0)
    code, _, err = run("play", str(tmp_path / "way.csv"), "--stay", bench=staying)
    assert (code, "stays there until another command" in err) == (0, True)
    time.sleep(2.0 * (STALE_S + HOLD_S))
    last = float((tmp_path / "way.csv").read_text().splitlines()[-1].split(",")[2])
    assert client.status().gateway.target == pytest.approx(last)
    code, _, err = run("send", "--hold", "--stay", bench=staying)
    assert (code, "holds the output until another command" in err) == (0, True)
    volts = client.status().volts
    time.sleep(2.0 * (STALE_S + HOLD_S))
    assert client.status().volts == pytest.approx(volts, abs=1e-9)
    assert volts > 5.0
    assert run("send", "--release", bench=staying)[0] == 0
    wait_until("it is down", lambda: client.status().volts == 0.0)
