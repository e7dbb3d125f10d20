"""A positioner for experiments, against the real loop and gateway: by itself, under bluesky's
RunEngine and in PyMeasure's worker."""

import csv
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from tests.rigs.gateway_bench import (
    ROOT,
    Bench,
    environment,
    kept_targets,
    may_lack,
    renewed,
    started_bench,
    wait_until,
)

from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.positioner import Positioner, _Going
from dehyst.daemon.client.staying import Stops
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.models.errors import BadInput, DehystError, NotNow

TRIM_ON = {"trim = {enabled = false}": "trim = {enabled = true}"}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("bench"), **TRIM_ON) as bench:
        yield bench


@pytest.fixture
def stage(rig: Bench) -> Iterator[Positioner]:
    positioner = Positioner(lambda: Client("bench", rig.address, label="scan"), timeout_s=20.0)
    with positioner:
        yield positioner


def test_it_is_there_when_it_says_so_and_stays(rig: Bench, stage: Positioner) -> None:
    for place in (3.0, 7.0, 5.0):
        there = stage.go(place).result(30)
        assert there.target == place
        newest = rig.loop.samples(rig.loop.seq - 1)[-1]
        assert newest["target"] == place
    stage.by = "gauge"
    stage.go(6.0).result(30)
    seen = stage.read(0.2).result(30)
    assert abs(seen.measured - 6.0) <= stage.tolerance + 3 * seen.spread
    begun = rig.loop.seq
    # 0.2 s at 200 Hz: as many samples as the loop took in some interval of 0.2 s; a late loop skips
    # some
    taken = rig.loop.samples(begun - 400)["scheduled_ns"]
    counts = np.searchsorted(taken, taken + 200_000_000, side="right") - np.arange(taken.size)
    assert seen.samples in counts
    assert seen.samples <= 42
    # unless it is repeated, the set-point is stale after 1 s and the output back at 0 V 0.2 s later
    assert (kept_targets(rig.loop, 6.0, 600) == 6.0).all()


def refuse(monkeypatch: pytest.MonkeyPatch, times: int, code: str) -> list[float]:
    """Let the daemon seem to refuse the next set-points; return those that were not sent."""
    send, refused = Client.send, list[float]()

    def refusing(client: Client, value: float, **more: bool) -> None:
        if len(refused) < times:
            refused.append(value)
            raise Refusal(code, "made up")
        send(client, value, **more)

    monkeypatch.setattr(Client, "send", refusing)
    return refused


@pytest.mark.parametrize("code", ["late", "flood"])
def test_a_repetition_that_was_late_is_sent_again(
    rig: Bench, stage: Positioner, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    stage.go(6.0).result(30)
    refused = refuse(monkeypatch, 3, code)
    wait_until("it was refused three times", lambda: len(refused) == 3)
    assert (kept_targets(rig.loop, 6.0, 500) == 6.0).all()
    assert refused == [6.0, 6.0, 6.0]


def test_it_says_how_it_knows_and_that_the_gauge_disagrees(
    rig: Bench, stage: Positioner, caplog: pytest.LogCaptureFixture
) -> None:
    stage.by, stage.tolerance = "gauge", 0.1
    there = stage.go(6.0).result(30)
    assert (there.by, there.finite, there.agrees) == ("gauge", True, True)
    stage.by, stage.tolerance = "model", 0.02
    with Client("bench", rig.address, label="zero") as asking:
        zero = asking.status().gauge_zero
    stage._do(lambda client: client.move_zero(0.4), stage.read())  # from now on the gauge is off
    try:
        there = stage.go(4.0).result(30)
        assert there.by == "model"
        assert not there.agrees
        assert abs(there.error) > 0.1
        assert "the gauge reads +0." in caplog.text
        assert stage.read(0.1).result(30).by == ""
    finally:
        with Client("bench", rig.address, label="zero") as asking:
            shift = zero - asking.status().gauge_zero
            stage._do(lambda client: client.move_zero(shift), stage.read())
        stage.stop()


@pytest.mark.parametrize("by", ["model", "gauge", "model-alone"])
def test_a_stage_that_gives_no_reading_is_not_there(by: Literal["model", "gauge"]) -> None:
    """If the gauge reads NaN, a positioner that judges by the gauge, or by the model with the gauge
    as a check, does not report arrival: the stage may be anywhere. The telemetry is as the loop
    writes it."""
    samples = np.zeros(200, TELEMETRY)
    samples["seq"], samples["scheduled_ns"] = np.arange(200), 5_000_000 * np.arange(1, 201)
    samples["target"] = samples["predicted"] = 4.0
    samples["measured"] = np.nan
    stage = Positioner.__new__(Positioner)
    stage.by, stage.tolerance, stage.settle_s, stage.unit, stage.name = by, 0.03, 0.05, "um", "s"
    stage.timeout_s, stage._wall_offset_ns, stage._collecting = 1.0, 0, []
    going = _Going(4.0, Future(), end_ns=1)
    stage._going = going
    stage._judge(samples)
    assert going.future.done() == (by == "model-alone")
    stage._look_at_the_clock()
    if by == "model-alone":
        there = going.future.result()
        assert (there.by, there.finite, there.agrees) == (by, False, False)
    else:
        words = "the gauge gives no valid reading" if by == "model" else "according to the gauge"
        with pytest.raises(NotNow, match=words):
            going.future.result()


def test_one_that_another_process_made_says_so_and_waits_for_nothing() -> None:
    """A positioner that a forked child inherits refuses every call at once, because none of its
    threads run there."""
    stage = Positioner.__new__(Positioner)
    stage._process, stage._stops = os.getppid(), Stops()
    for ask in (lambda: stage.go(4.0), stage.read, stage.stop):
        with pytest.raises(NotNow, match=r"before the process was forked.*make a new Positioner"):
            ask()
    stage.close()


def test_what_cannot_be_is_said_in_the_daemons_words(rig: Bench, stage: Positioner) -> None:
    with pytest.raises(Refusal, match="cannot be reached"):
        stage.go(44.0).result(30)
    stage.tolerance, stage.by, stage.timeout_s = 1e-9, "gauge", 1.0
    with pytest.raises(NotNow, match=r"not within 1e-09 um of 4 after 1 s, according to the gauge"):
        stage.go(4.0).result(30)
    stage.timeout_s = 20.0
    first = stage.go(4.0)
    second = stage.go(5.0)
    with pytest.raises(NotNow, match="another position was requested"):
        first.result(30)
    stage.stop()
    with pytest.raises(NotNow, match="it was stopped"):
        second.result(30)
    with Client("bench", rig.address, label="another") as other:
        other.take_over()
        with renewed(other), pytest.raises(Refusal, match="another commands this daemon"):
            stage.go(4.0).result(30)


@pytest.mark.processes
def test_nobody_there_is_an_error_at_once() -> None:
    with pytest.raises(DehystError, match="no daemon reached"):
        Positioner(lambda: Client(connect="tcp/127.0.0.1:9"))


def test_a_flight_brings_every_sample_and_a_stop_ends_it(rig: Bench, stage: Positioner) -> None:
    t_s = np.arange(0.0, 1.0, 0.005)
    flight = stage.fly(t_s, 5.0 + np.sin(2 * np.pi * t_s)).result(60)
    assert flight.played.completed
    assert 200 - may_lack(flight.samples) <= flight.samples.size <= 200
    assert (np.diff(flight.samples["seq"]) == 1).all()
    periods = np.diff(flight.wall_s) / 0.005
    assert np.allclose(periods, np.round(periods), atol=2e-4)
    # otherwise the loop has missed a deadline, or points arrived late
    if periods.max() < 1.5 and not flight.played.tracking.dry:
        asked = 5.0 + np.sin(2 * np.pi * t_s)
        assert np.abs(flight.samples["target"] - asked).max() < 2 * np.pi * 0.0051
    long = stage.fly(np.linspace(0.0, 30.0, 301), np.linspace(5.0, 6.0, 301))
    begun = rig.loop.seq
    wait_until("it flies", lambda: rig.loop.seq > begun + 100)
    stage.stop()
    with pytest.raises(NotNow, match="stopped"):
        long.result(30)


def test_a_future_that_its_owner_cancelled_ends_nothing(rig: Bench, stage: Positioner) -> None:
    assert stage.go(6.0).cancel()
    wait_until("it is on its way", lambda: rig.loop.samples(rig.loop.seq - 1)[-1]["target"] == 6.0)
    stage.stop()
    wait_until("it is stopped", lambda: np.isnan(rig.loop.samples(rig.loop.seq - 1)[-1]["target"]))
    going = stage.go(5.0)
    going.cancel()
    assert stage.read(1.0).result(30).finite
    assert stage.go(5.25).result(30).target == 5.25  # its thread lives


def test_a_stop_ends_a_flight_that_waits_for_its_turn(stage: Positioner) -> None:
    t_s = np.linspace(0.0, 30.0, 301)
    long = stage.fly(t_s, np.linspace(5.0, 6.0, 301))  # the positioner's thread is in a turn
    stage.stop()
    with pytest.raises(NotNow, match="stopped"):
        long.result(0)


def test_bluesky_runs_a_scan_and_a_flight(rig: Bench, stage: Positioner) -> None:
    pytest.importorskip("bluesky")
    import bluesky.plan_stubs as do
    import bluesky.plans as plans
    from bluesky import RunEngine
    from bluesky.preprocessors import run_decorator
    from bluesky.protocols import Flyable, Movable, Readable, Stoppable, Triggerable

    from dehyst.bluesky import Stage

    device = Stage("stage", stage, average_s=0.05)
    for protocol in (Readable, Movable, Triggerable, Flyable, Stoppable):
        assert isinstance(device, protocol), protocol
    engine, reported = RunEngine({}), []
    engine.subscribe(lambda name, document: reported.append((name, document)))
    engine(plans.scan([device], device, 3.0, 7.0, 5))
    events = [document["data"] for name, document in reported if name == "event"]
    assert [event["stage_setpoint"] for event in events] == [3.0, 4.0, 5.0, 6.0, 7.0]
    # feed-forward and a trim that has just started: near the targets, and in order
    assert np.allclose([event["stage"] for event in events], [3, 4, 5, 6, 7], atol=0.5)
    described = next(document for name, document in reported if name == "descriptor")
    assert described["data_keys"]["stage"]["units"] == "um"
    assert described["hints"]["stage"] == {"fields": ["stage"]}
    assert described["configuration"]["stage"]["data"]["stage_period_s"] == pytest.approx(0.005)

    t_s = np.arange(0.0, 1.0, 0.005)

    @run_decorator()
    def fly():
        yield from do.prepare(device, (t_s, 5.0 + np.sin(2 * np.pi * t_s)), wait=True)
        yield from do.kickoff(device, wait=True)
        yield from do.complete(device, wait=True)
        yield from do.collect(device)

    reported.clear()
    begun = rig.loop.seq
    engine(fly())
    (page,) = [document for name, document in reported if name == "event_page"]
    assert {"stage", "stage_setpoint", "stage_drive", "stage_predicted"} == set(page["data"])
    (size,) = {len(column) for column in page["data"].values()}
    assert 200 - may_lack(rig.loop.samples(begun)) <= size <= 200
    at_s = np.array(page["timestamps"]["stage"])
    periods = np.diff(at_s) / 0.005  # a late sample leaves a gap of whole periods
    assert np.allclose(periods, np.rint(periods), atol=2e-4)
    assert periods.min() > 0.5
    assert next(d for n, d in reported if n == "stop")["exit_status"] == "success"

    reported.clear()
    with pytest.raises(Exception, match=r"failed: the daemon refuses: .* cannot be reached"):
        engine(plans.scan([device], device, 3.0, 90.0, 3))
    with pytest.raises(BadInput, match="prepare"):
        Stage("other", stage).kickoff()


@pytest.mark.parametrize(
    ("program", "package", "says"),
    [
        ("bluesky_scan.py", "bluesky", "200 samples of the flight, rms error 0."),
        ("pymeasure_scan.py", "pymeasure", ""),
    ],
)
def test_the_examples_run(
    rig: Bench, tmp_path: Path, program: str, package: str, says: str
) -> None:
    pytest.importorskip(package)
    output = tmp_path / "loop.csv"
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "examples" / program), str(output)],
        env={**environment(), "DEHYST_CONNECT": rig.address},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert says in done.stdout
    if program == "pymeasure_scan.py":
        lines = [line for line in output.read_text().splitlines() if line[:1] != "#"]
        rows = list(csv.DictReader(lines))
        assert len(rows) == 11
        for row in rows:
            assert abs(float(row["measured"]) - float(row["target"])) < 1.0
