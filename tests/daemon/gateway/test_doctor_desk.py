"""The way of a doctor's offer to the loop and back, with a real loop, gateway and client.

The cases are written by hand, so that offers can be right or wrong: the configured model moves a
fifth too far, one offer is worse still, the other one is the stage's own model.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import Bench, wait_until, wait_until_heard
from tests.rigs.stage_model import kept_model

from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined, OfferTest
from dehyst.daemon.files.chosen import read_accepted
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.rings.records import Flag
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps

SLEW_V = 10_000.0
SETTINGS = "[watch]\nlearn_s = 3600.0\n[doctor]\ntrial_s = 2.0\n"


def scaled(by: float) -> Model:
    """Return the stage's own model with another gain."""
    model = kept_model()
    return replace(model, hysteresis=replace(model.hysteresis, c=model.hysteresis.c * by))


def lay_case(bench: Bench, name: str, number: int, offered: Model, promise: float) -> Path:
    """Write a case as gateway and doctor would leave it; return its folder."""
    folder = bench.config.watch_directory / f"mismatch-{name}.case"
    (folder / cases.FOUND).mkdir(parents=True)
    save_model(load_model(bench.config.model.file), folder / cases.IN_USE)
    save_model(offered, folder / cases.OFFERED)
    (folder / cases.REPORT).write_text(f"<p>{name}</p>")
    case = Case(
        number=number, name=f"mismatch-{name}", time_ns=1, wall_ns=1, figure="whole", low=0.0,
        high=95.0, slew=SLEW_V, rate_hz=200.0, later_s=1.0,
    )  # fmt: skip
    examined = Examined(
        verdict="explained", says="Found: shape.", unit="um", noise=0.02, rms_in_use=1.0,
        rms_augmented=promise,
        tested=OfferTest(in_use=1.0, offered=promise, noise=0.02, seconds=10.0),
    )  # fmt: skip
    cases.put_record(folder, cases.EXAMINED, examined)
    cases.put_record(folder, cases.CASE, case)
    return folder


@pytest.fixture
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("doctor")  # a new folder for every attempt
    bench = Bench(folder, start=False)
    save_model(scaled(1.2), folder / "model.toml")
    bench.path.write_text(bench.path.read_text() + SETTINGS)
    bench.has_loop = True
    bench.start_loop()
    bench.start_gateway()
    yield bench
    bench.close()


def state(client: Client, number: int) -> str:
    reports = [r for r in client.doctor() if r.offer is not None and r.offer.number == number]
    return reports[-1].state if reports else ""


def move_until(client: Client, number: int, wanted: tuple[str, ...]) -> str:
    """Move the stage back and forth until the offer is in one of the wanted states; return that
    state."""
    for k in range(1200):
        client.send(6.5 + 2.5 * np.sin(2 * np.pi * 0.5 * k * 0.05))
        time.sleep(0.05)
        if k % 10 == 0 and (now := state(client, number)) in wanted:
            return now
    pytest.fail(f"the offer is still {state(client, number)}")


def largest_step(samples: np.ndarray) -> float:
    return float(np.abs(np.diff(samples["volts"])).max())


def test_an_offer_is_put_to_work_on_trial_and_goes_back_or_stays(bench: Bench) -> None:
    client, hears = bench.client(), bench.client()
    before = dumps(client.model())
    feed = hears.feed()
    wait_until_heard(feed)
    lay_case(bench, "1", 11, scaled(1.6), promise=0.05)
    wait_until("the offer is there", lambda: state(client, 11) == "found")
    wait_until("and was published", lambda: len(feed.doctor) > 0)
    assert client.doctor_page("mismatch-1") == b"<p>1</p>"
    with pytest.raises(Refusal, match="no such offer"):
        client.decide_offer("accept", 12)

    for k in range(60):  # gives the error of the model before the trial
        client.send(6.5 + 2.5 * np.sin(2 * np.pi * 0.5 * k * 0.05))
        time.sleep(0.05)
    first = bench.loop.seq
    hears.decide_offer("accept", 11)  # another client accepts while `client` commands
    assert move_until(client, 11, ("trial",)) == "trial"
    with pytest.raises(Refusal, match="already on trial"):
        hears.decide_offer("accept", 11)
    for number in (12, 13):  # the newest offer waits; it was made for the model before the trial
        lay_case(bench, str(number), number, scaled(1.0), promise=0.05)
        wait_until("another offer", lambda n=number: state(client, n) == "found")
        hears.decide_offer("accept", number)
        wait_until("it waits", lambda n=number: state(client, n) == "waiting")
    assert state(client, 12) == "found"
    assert move_until(client, 11, ("accepted", "returned")) == "returned"
    wait_until("what waited goes to work", lambda: state(client, 13) == "trial")
    wait_until("the loop has it", lambda: dumps(client.model()) == dumps(scaled(1.0)))
    hears.decide_offer("reject", 13)
    wait_until("it makes way", lambda: state(client, 13) == "rejected")
    wait_until("the model before is back", lambda: dumps(client.model()) == before)
    assert read_accepted(bench.config.directory) is None

    folder = lay_case(bench, "2", 22, scaled(1.0), promise=0.05)
    wait_until("the second offer is there", lambda: state(client, 22) == "found")
    hears.decide_offer("accept", 22)
    assert move_until(client, 22, ("accepted", "returned")) == "accepted"
    samples = bench.loop.samples(first)
    # no step exceeds the slew limit times its duration, ramps to the set-points included
    steps = np.abs(np.diff(samples["volts"]))
    times = np.diff(samples["actual_ns"]) * 1e-9
    assert np.all(steps <= SLEW_V * np.maximum(times, 0.005) * 1.5 + 1e-9)
    assert samples["volts"].max() <= 95.0
    assert samples["volts"].min() >= 0.0
    assert not np.any(samples["flags"] & int(Flag.WRITE_FAILED))
    wait_until("it is said", lambda: bool([e for e in feed.events if "confirmed" in e.text]))
    assert [e.text for e in feed.events if "previous model is restored" in e.text]

    client.send(6.5)
    hears.decide_offer("reject", 22)  # rejecting the model in use restores the previous one
    wait_until("rejected", lambda: state(client, 22) == "rejected")
    wait_until("the configured model is back", lambda: dumps(client.model()) == before)
    assert (folder / cases.DECIDED).exists()
    bench.kill_gateway()
    bench.start_gateway()
    again = bench.client()
    wait_until("all are read", lambda: len(again.doctor()) == 4)
    assert [r.state for r in again.doctor()] == ["returned", "found", "rejected", "rejected"]
    with pytest.raises(Refusal, match="already rejected"):
        again.decide_offer("accept", 22)
