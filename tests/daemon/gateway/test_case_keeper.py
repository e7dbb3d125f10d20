"""The case that the mismatch watch keeps for the doctor when the stage changes: the real watch, on
simulated telemetry."""

from pathlib import Path

import numpy as np
from tests.rigs.stepper import CONFIG, PERIOD_NS, model

from dehyst.daemon.config import parse_config
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.gateway.case_keeper import CaseKeeper
from dehyst.daemon.gateway.history import TelemetryHistory
from dehyst.daemon.gateway.mismatch import MismatchWatch
from dehyst.daemon.rings.records import TELEMETRY, State
from dehyst.models.change.lead import drop_lead
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.recording import Recording

MORE = """
[watch]
learn_s = 30.0
before_s = 4.0
after_s = 2.0
[doctor]
test_s = 3.0
"""
RATE_HZ = 1e9 / PERIOD_NS
CHANGED_S, SECONDS = 90.0, 110.0
NOISE = 0.01


class Once:
    """A stop event whose wait ends the watch once no batch is left to judge."""

    def __init__(self, watch: MismatchWatch) -> None:
        self.watch = watch

    def wait(self, _seconds: float) -> bool:
        return not self.watch._batches

    def is_set(self) -> bool:
        return False


def telemetry() -> np.ndarray:
    """Return telemetry of a stage that follows its model and from CHANGED_S on moves 5 %
    further."""
    k = np.arange(round(SECONDS * RATE_HZ))
    t = k / RATE_HZ
    drive = 5.0 + 3.0 * np.sin(2 * np.pi * 0.7 * t) + 1.5 * np.sin(2 * np.pi * 0.31 * t)
    records = np.zeros(k.size, TELEMETRY)
    records["seq"], records["state"], records["scheduled_ns"] = k, State.RUNNING, k * PERIOD_NS
    records["volts"] = 7.5 * drive
    records["predicted"] = simulate_hysteresis(
        model().hysteresis, np.r_[drive[0], drive[:-1]], 1e-3
    )
    noise = np.random.default_rng(2).normal(0.0, NOISE, k.size)
    records["measured"] = records["predicted"] * np.where(t < CHANGED_S, 1.0, 1.05) + noise
    records["target"] = records["predicted"]
    return records


def test_a_change_becomes_a_case_with_the_last_good_recording_and_what_came_later(
    tmp_path: Path,
) -> None:
    save_model(model(), tmp_path / "model.toml")
    config = parse_config(f'run_dir = "{tmp_path}"\n{CONFIG}{MORE}')
    history, reported = TelemetryHistory(60_000), []
    watch = MismatchWatch(config, history, lambda level, code, text: reported.append(text))
    watch.model_path = tmp_path / "model.toml"
    records = telemetry()
    for part in np.array_split(records, 1100):
        watch.add(1, part, 0.0)
        history.add(part)
        watch.run(Once(watch))  # type: ignore[arg-type]
    (folder,) = cases.case_folders(config.watch_directory)
    case = cases.get_record(folder, cases.CASE, Case)
    assert case is not None
    assert case.high == 10.0  # 75 V divided by the gain of 7.5
    assert load_model(folder / cases.IN_USE).displacement_unit == "um"
    good, flagged, later = (
        read_recording(folder / name, need_displacement=True)
        for name in (cases.GOOD, cases.FLAGGED, cases.LATER)
    )

    assert {k: round(v, 1) for k, v in case.leads.items()} == {
        cases.GOOD: 25.0, cases.FLAGGED: 25.0, cases.LATER: 27.0,
    }  # fmt: skip
    good, flagged, later = (
        drop_lead(one, case.leads[name])
        for one, name in ((good, cases.GOOD), (flagged, cases.FLAGGED), (later, cases.LATER))
    )

    def gain(recording: Recording) -> float:
        assert recording.displacement is not None
        return float(np.polyfit(recording.channels["target_um"], recording.displacement, 1)[0])

    assert abs(gain(good) - 1.0) < 0.002
    assert abs(gain(flagged) - 1.05) < 0.002
    assert abs(gain(later) - 1.05) < 0.002
    assert np.ptp(flagged.t_s) <= 2.1
    assert 2.9 <= np.ptp(later.t_s) <= 3.1
    assert folder.with_suffix(".csv").exists()
    assert any("recording kept" in text for text in reported)
    cases.drop_case(folder.with_suffix(".csv"))
    assert not folder.exists()


def test_nothing_is_good_while_the_stage_is_flagged_and_shortly_before(tmp_path: Path) -> None:
    """The flag comes and goes with the motion, and the cause stays."""
    save_model(model(), tmp_path / "model.toml")
    config = parse_config(f'run_dir = "{tmp_path}"\n{CONFIG}{MORE}')
    history = TelemetryHistory(200_000)
    records = np.zeros(round(150.0 * RATE_HZ), TELEMETRY)
    records["seq"] = np.arange(records.size)
    records["scheduled_ns"] = records["seq"] * PERIOD_NS
    records["state"] = State.RUNNING
    records["measured"] = records["seq"] / RATE_HZ  # the time
    keeper = CaseKeeper(config, history)

    def at(seconds: float) -> int:
        return round(seconds * RATE_HZ)

    history.add(records)
    for seconds in (40.0, 55.0, 64.0):  # the last of them within SPARE_S of the flag
        keeper.keep_good_stretch(at(seconds), round(seconds))
    keeper.note_mismatch(at(70.0), wrong=True)
    keeper.note_mismatch(at(80.0), wrong=False)
    keeper.keep_good_stretch(at(90.0), 90)  # 20 s, half of which was flagged
    keeper.note_mismatch(at(110.0), wrong=True)
    case = Case(
        number=1, name="mismatch-1", time_ns=1, wall_ns=1, figure="gain", low=0.0, high=10.0,
        slew=100.0, rate_hz=RATE_HZ, later_s=3.0,
    )  # fmt: skip
    keeper.begin(
        config.watch_directory / "mismatch-1.csv", at(110.0), at(112.0), 0.0, case,
        tmp_path / "model.toml",
    )  # fmt: skip
    (folder,) = cases.case_folders(config.watch_directory)
    good = read_recording(folder / cases.GOOD, need_displacement=True)
    assert good.displacement is not None
    assert abs(good.displacement[-1] - 55.0) < 0.1
