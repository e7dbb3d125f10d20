"""The mismatch watch reports to the loop whether stage and gauge can be trusted."""

from pathlib import Path

import numpy as np
from tests.rigs.stepper import CONFIG, PERIOD_NS, model

from dehyst.daemon.config import parse_config
from dehyst.daemon.files.models import save_model
from dehyst.daemon.gateway.history import TelemetryHistory
from dehyst.daemon.gateway.loop_records import trust
from dehyst.daemon.gateway.mismatch import MismatchWatch
from dehyst.daemon.rings.records import TELEMETRY, LoopCommand, State
from dehyst.models.hysteresis.forward import simulate_hysteresis


class Endless:
    """A stop event whose wait ends the watch once no batch is left to judge."""

    def __init__(self, watch: MismatchWatch) -> None:
        self.watch = watch

    def wait(self, _seconds: float) -> bool:
        return not self.watch._batches

    def is_set(self) -> bool:
        return False


def telemetry(first: int, seconds: float, stuck: bool) -> np.ndarray:
    """Return telemetry of a stage that moves as its model; the gauge follows it, or is stuck."""
    k = first + np.arange(round(seconds * 1e9 / PERIOD_NS))
    drive = 5.0 + 4.0 * np.sin(2 * np.pi * 0.7 * k * PERIOD_NS * 1e-9)
    records = np.zeros(k.size, TELEMETRY)
    records["seq"], records["state"] = k, State.RUNNING
    records["volts"] = 7.5 * drive
    records["predicted"] = simulate_hysteresis(
        model().hysteresis, np.r_[drive[0], drive[:-1]], 1e-3
    )
    records["measured"] = records["predicted"] + np.random.default_rng(1).normal(0, 0.01, k.size)
    if stuck:
        records["measured"] = 3.0
    return records


def test_a_stuck_gauge_is_distrusted_and_trusted_again(tmp_path: Path) -> None:
    save_model(model(), tmp_path / "model.toml")
    config, reported = parse_config(CONFIG), []
    watch = MismatchWatch(config, TelemetryHistory(10_000), lambda *_: None)
    watch.model_path = tmp_path / "model.toml"
    watch.trust = reported.append
    at = 0
    for seconds, stuck in ((6.0, False), (6.0, True), (30.0, False)):
        records = telemetry(at, seconds, stuck)
        at += records.size
        for part in np.array_split(records, 20):
            watch.add(1, part, 0.0)
        watch.run(Endless(watch))  # type: ignore[arg-type]
    assert reported == [True, False, True]


def test_a_zero_that_was_moved_on_purpose_is_no_mismatch(tmp_path: Path) -> None:
    """A shift of the gauge's zero changes neither what was learned nor what is judged: the watch's
    figures agree with those without a shift."""
    save_model(model(), tmp_path / "model.toml")
    health = []
    for shift in (0.0, 3.0):
        watch = MismatchWatch(parse_config(CONFIG), TelemetryHistory(10_000), lambda *_: None)
        watch.model_path = tmp_path / "model.toml"
        records = telemetry(0, 12.0, False)
        for number, part in enumerate(np.array_split(records, 40)):
            zero = shift * (number >= 20)
            part["measured"] += zero
            watch.add(1, part, 0.0, zero)
        watch.run(Endless(watch))  # type: ignore[arg-type]
        assert watch._watch is not None
        health.append(list(watch._watch.figures.values()))
    np.testing.assert_allclose(health[0], health[1], rtol=1e-6)


def test_another_run_of_the_loop_begins_with_trust(tmp_path: Path) -> None:
    save_model(model(), tmp_path / "model.toml")
    reported: list[bool] = []
    watch = MismatchWatch(parse_config(CONFIG), TelemetryHistory(10_000), lambda *_: None)
    watch.model_path, watch.trust = tmp_path / "model.toml", reported.append
    for number in (1, 2):
        watch.add(number, telemetry(0, 1.0, False), 0.0)
        watch.run(Endless(watch))  # type: ignore[arg-type]
    assert reported == [True, True]


def test_the_record_for_the_loop() -> None:
    for trusted in (True, False):
        record = trust(trusted)
        assert record.size == 1
        assert (record["kind"][0], record["value"][0]) == (LoopCommand.TRUST, float(trusted))
