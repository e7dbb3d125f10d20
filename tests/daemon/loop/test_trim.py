"""The trim in the loop: nothing makes it jump, both engines agree, and the feed-forward is
unchanged."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rigs.stepper import GAIN, PERIOD_NS, SLEW, Bench, compensator, model, points
from tests.rigs.two_loops import Rig, setpoint

from dehyst.daemon.config import parse_config
from dehyst.daemon.loop.records_in_memory import TEXTS, Note, describe_note
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.trim import trim_setting
from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, State
from dehyst.models.errors import BadInput
from dehyst.models.learning import trim
from dehyst.models.model import Block, Model

CONFIG = """
name = "bench"
model = {file = "none"}
actuator = {driver = "simulated", gain = 7.5}
sensor = {driver = "simulated"}
limits = {min_v = 0, max_v = 75, slew_v_per_s = 2000}
safe = {voltage_v = 3.0, ramp_v_per_s = 40.0}
"""
names = (f"trimmed-{i}" for i in itertools.count())


class Trimmed(Bench):
    """A bench whose gauge differs from the model by `off`, with a ripple of 1 nm."""

    def __init__(self, on: bool = True) -> None:
        super().__init__()
        setting = trim.make_trim_setting(PERIOD_NS * 1e-9, 10.0, 0.01, on)
        self.stepper = Stepper(self.settings, compensator(model()), 0.0, setting)
        self.off = 0.3
        self.reading: float | None = None
        self.records: list[np.void] = []

    def send(self, batch: np.ndarray, n: int = 1) -> np.void:
        for i in range(n):
            self.now += PERIOD_NS
            stands = float(self.stepper.control["predicted"][0]) + self.stepper.origin
            reading = stands + self.off + 1e-3 * (-1) ** len(self.records)
            record = self.stepper.step(
                self.now,
                reading if self.reading is None else self.reading,
                batch if i == 0 else batch[:0],
            )[0].copy()
            if self.stepper.state is not State.FAULT:
                self.stepper.follow_output(float(record["volts"]))
            self.volts.append(self.stepper.volts)
            self.records.append(record)
        return self.records[-1]


def test_a_set_point_is_reached_by_the_gauge() -> None:
    bench = Trimmed()
    bench.tick((LoopCommand.SETPOINT, 4.0))
    for _ in range(30):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=100)
    record = bench.records[-1]
    assert record["target"] == 4.0
    assert record["measured"] == pytest.approx(4.0, abs=2e-3)
    assert record["trim"] == pytest.approx(-0.3, abs=2e-3)
    assert record["predicted"] == pytest.approx(3.7, abs=3e-3)


def test_without_trim_nothing_is_added() -> None:
    """The voltages are bit by bit those of a stepper without any trim."""
    off, none = Trimmed(on=False), Trimmed(on=False)
    none.stepper = Stepper(none.settings, compensator(model()), 0.0)
    for bench in (off, none):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=300)
        bench.send(points(3, [4.0, 5.0, 6.0, 2.0], 0, True), n=300)
    assert off.volts == none.volts
    assert not np.any([r["trim"] for r in off.records])


def test_a_trimmed_stage_that_held_goes_on_from_where_it_stands() -> None:
    """After a stop, a hold and a new set-point at the same position, the output hardly moves."""
    bench = Trimmed()
    for _ in range(30):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=100)
    bench.tick((LoopCommand.STOP_MOTION, 0.0), n=200)
    before = bench.volts[-1]
    bench.tick((LoopCommand.SETPOINT, 4.0), n=50)
    moved = np.abs(np.array(bench.volts[-50:]) - before)
    assert moved.max() < 0.01 * GAIN / 0.8
    assert np.abs(np.diff(bench.volts[-50:])).max() < 0.02 * GAIN


def test_another_model_lets_go_of_the_trim_in_a_glide() -> None:
    bench = Trimmed()
    for _ in range(30):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=100)
    fresh = compensator(model(1.05))
    bench.stepper.reload(fresh, fresh.init(bench.stepper.volts / GAIN), 0.0)
    bench.off = 0.0
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    steps = np.abs(np.diff(bench.volts[-501:]))
    assert steps.max() < 0.1 * SLEW * 1e-3
    assert abs(bench.records[-1]["trim"]) < 0.01


@pytest.mark.parametrize("bad", [math.nan, 500.0])
def test_a_bad_reading_freezes_is_flagged_and_reported(bad: float) -> None:
    bench = Trimmed()
    for _ in range(20):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=100)
    assert not bench.records[-1]["flags"] & Flag.TRIM_FROZEN
    before = bench.records[-1]["trim"]
    bench.reading = bad
    bench.tick((LoopCommand.SETPOINT, 4.0), n=300)
    assert bench.records[-1]["flags"] & Flag.TRIM_FROZEN
    assert bench.records[-1]["trim"] == before
    assert any("trim frozen" in text for text in bench.stepper.events)
    bench.reading = None
    bench.tick((LoopCommand.SETPOINT, 4.0), n=300)
    assert any("trim resumes" in text for text in bench.stepper.events)


def test_the_gateway_may_distrust_the_gauge_in_any_state() -> None:
    bench = Trimmed()
    bench.tick((LoopCommand.TRUST, 0.0))
    for _ in range(10):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=100)
    assert bench.records[-1]["trim"] == 0.0
    bench.tick((LoopCommand.TRUST, 1.0), n=3000)
    assert bench.records[-1]["trim"] == pytest.approx(-0.3, abs=2e-3)


def test_a_moved_zero_shifts_every_reading() -> None:
    bench = Trimmed(on=False)
    before = bench.tick((LoopCommand.SETPOINT, 4.0), n=300)
    after = bench.tick((LoopCommand.ZERO, -0.3), n=2)
    assert after["measured"] - before["measured"] == pytest.approx(-0.3, abs=3e-3)
    assert after["measured"] == pytest.approx(after["predicted"], abs=2e-3)


def learned(batch: np.ndarray, correction: float) -> np.ndarray:
    batch["correction"] = correction
    return batch


def test_a_learned_correction_moves_the_stage_and_not_the_target() -> None:
    bench = Trimmed(on=False)
    values = [4.0] * 400
    bench.send(learned(points(5, values, 0, False), 0.25), n=600)
    record = bench.records[-1]
    assert (record["target"], record["learned"]) == (4.0, 0.25)
    assert record["predicted"] == pytest.approx(4.25, abs=1e-6)
    assert record["trim"] == 0.0


@pytest.mark.parametrize(("asked", "taken"), [(1.5, 1.0), (-7e9, -1.0), (math.nan, 0.0)])
def test_a_learned_correction_beyond_its_bound_is_held_there_and_reported_once(
    asked: float, taken: float
) -> None:
    bench = Trimmed(on=False)
    bench.send(learned(points(5, [4.0] * 300, 0, False), asked), n=600)
    assert max(abs(float(r["learned"])) for r in bench.records) <= 1.0
    assert bench.records[-1]["learned"] == taken
    reports = [text for text in bench.stepper.events if "largest allowed" in text]
    assert len(reports) == 1  # one for each of the points displaces all other events
    bench.send(learned(points(6, [4.0] * 300, 0, False), asked), n=600)
    reports = [text for text in bench.stepper.events if "largest allowed" in text]
    assert len(reports) == 2


def test_what_was_learned_fades_after_its_trajectory() -> None:
    bench = Trimmed(on=False)
    bench.send(learned(points(5, [4.0] * 300, 0, True), 0.25), n=700)
    path = np.array([r["learned"] for r in bench.records])
    assert path.max() == 0.25
    bench.tick((LoopCommand.SETPOINT, 4.0), n=1500)
    path = np.array([r["learned"] for r in bench.records])
    assert path[-1] == 0.0
    assert np.abs(np.diff(path[400:])).max() <= 0.02 * 10.0 * 1e-3 * (1 + 1e-9)


actions = st.lists(
    st.one_of(
        st.tuples(st.just("set"), st.floats(-2, 12)),
        st.tuples(st.just("play"), st.lists(st.floats(0, 10), min_size=1, max_size=30)),
        st.tuples(st.sampled_from(["stop", "release", "fault", "back", "reload"]), st.just(0.0)),
        st.tuples(st.sampled_from(["trust", "zero"]), st.floats(-1, 1)),
        st.tuples(st.just("off"), st.floats(-2, 2)),
        st.tuples(st.just("reading"), st.just(None) | st.just(math.nan) | st.floats(-99, 99)),
        st.tuples(st.just("wait"), st.integers(1, 400)),
    ),
    max_size=12,
)


@settings(max_examples=60)
@given(actions)
def test_volts_keep_range_and_slew_whatever_the_gauge_says(todo: list) -> None:
    bench = Trimmed()
    for number, (what, value) in enumerate(todo):
        if what == "set":
            bench.tick((LoopCommand.SETPOINT, value))
        elif what == "play":
            bench.send(learned(points(number + 1, value, 0, True), 0.5))
        elif what in ("stop", "release"):
            bench.tick((LoopCommand.STOP_MOTION if what == "stop" else LoopCommand.RELEASE, 0.0))
        elif what == "fault":
            bench.stepper.fault(bench.now, "pulled")
        elif what == "back":
            bench.stepper.recover(bench.now, bench.stepper.volts)
        elif what == "reload":
            fresh = compensator(model(1.3))
            bench.stepper.reload(fresh, fresh.init(bench.stepper.volts / GAIN), 0.0)
        elif what in ("trust", "zero"):
            bench.tick((LoopCommand.TRUST if what == "trust" else LoopCommand.ZERO, value))
        elif what == "off":
            bench.off = value
        elif what == "reading":
            bench.reading = value
        else:
            bench.tick(n=value)
        bench.tick(n=20)
    volts = np.array(bench.volts)
    assert np.isfinite(volts).all()
    assert volts.min() >= 0.0
    assert volts.max() <= 75.0
    assert np.abs(np.diff(volts)).max(initial=0.0) <= SLEW * 1e-3 * (1 + 1e-12)


def test_a_moved_zero_is_in_the_status_at_once() -> None:
    """A moved zero is in the status at the sample where it takes effect, for clients that compare
    readings with earlier ones."""
    rig = Rig(next(names))
    shift = setpoint(-0.25)
    shift["kind"] = LoopCommand.ZERO
    rig.play([setpoint(4.0)], 30, compiled=False)
    rig.play([shift], 3, compiled=False)
    status, _, _ = rig.rings["status"].read(0)
    assert status["gauge_zero"].tolist()[-1] == -0.25
    at = int(status["samples"][np.flatnonzero(status["gauge_zero"])[0]])
    assert at == 31


@settings(max_examples=8)
@given(
    st.lists(st.floats(0, 12), min_size=1, max_size=4),
    st.lists(st.integers(0, 900_000), min_size=1, max_size=5),
)
def test_both_engines_trim_alike(levels: list[float], late: list[int]) -> None:
    records = []
    for compiled in (False, True):
        rig = Rig(next(names), "static", late)
        rig.stepper.trim_setting[:] = trim.make_trim_setting(1e-3, 12.0, 0.02, True)
        record = rig.play([setpoint(um) for um in levels], 150, compiled)
        record["cause"] = 0  # why this machine was late is not part of the step
        records.append(record)
    assert records[0].tobytes() == records[1].tobytes()
    assert np.any(records[0]["trim"])


def test_a_time_constant_that_the_gauge_is_too_slow_for_is_refused() -> None:
    slow = Block("lag", "sensor", {"tau_s": 0.2})
    of = model()
    late = Model(of.hysteresis, of.validity, blocks=(slow,))
    config = parse_config(CONFIG + "trim = {time_constant_s = 0.1}\n")
    with pytest.raises(BadInput, match=r"0\.1: the gauge is 0\.20\d s late.* 0\.81 s or more"):
        trim_setting(config, late, 10.0)
    assert trim_setting(config, of, 10.0)["time_constant_s"][0] == 0.1
    by_itself = trim_setting(parse_config(CONFIG), late, 10.0)
    assert by_itself["time_constant_s"][0] == pytest.approx(0.806)
    off = parse_config(CONFIG + "trim = {time_constant_s = 0.1, enabled = false}\n")
    assert trim_setting(off, late, 10.0)["on"][0] == 0


def test_the_defaults_are_a_share_of_the_reach() -> None:
    setting = trim_setting(parse_config(CONFIG), model(), 20.0)
    assert (setting["limit"][0], setting["rate"][0]) == (2.0, 0.4)
    own = parse_config(CONFIG + "trim = {limit_um = 0.5, rate_um_per_s = 0.1}\n")
    assert tuple(trim_setting(own, model(), 20.0)[["limit", "rate"]][0]) == (0.5, 0.1)
    assert LoopSettings.from_config(own, 0.0, 0.0, 75.0, 1.0).period_ns == 1_000_000
    assert COMMAND["correction"] == np.float64


def test_an_unknown_history_is_reported_once() -> None:
    rig = Rig("unknown-history")
    rig.play([np.zeros(0, COMMAND)], 4500, compiled=False)
    texts = [bytes(text).decode() for text in rig.rings["event"].read(0)[0]["text"]]
    assert len([text for text in texts if "`dehyst zero --exercise`" in text]) == 1


def test_messages_with_a_displacement_have_its_unit() -> None:
    others = {
        Note.BAD_VALUE, Note.POINT_FULL, Note.POINT_LATE, Note.NO_SETPOINT, Note.COMMANDS_LOST,
        Note.STOP_FAILED, Note.STOOD_STILL, Note.COMMANDS_DAMAGED, Note.ENDED,
    }  # fmt: skip
    for note in Note:
        said = describe_note(note, 0.5, "nm")
        assert ("0.5 nm" in said) == ("{:" in TEXTS[note] and note not in others), said


def test_a_moved_zero_is_reported_in_the_models_unit() -> None:
    bench = Bench()
    bench.tick((LoopCommand.ZERO, 0.25))
    assert bench.stepper.events[-1] == "the gauge's zero was moved by 0.25 um"
