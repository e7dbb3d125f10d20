"""The step's promises for any sequence of commands, faults and reloads; and its state machine.

The reference for reached displacements is a plain numpy loop over the play operators.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.config import parse_config
from dehyst.daemon.records import COMMAND, Command, Flag, State
from dehyst.daemon.step import Plan, Stepper
from dehyst.models.compensator import Compensator
from dehyst.models.model import Hysteresis, Model, Validity

PERIOD_NS = 1_000_000
SLEW, MIN_V, MAX_V, GAIN = 2000.0, 0.0, 75.0, 7.5
CONFIG = """
name = "bench"
[model]
file = "none"
[actuator]
driver = "simulated"
gain = 7.5
[sensor]
driver = "simulated"
[limits]
min_v = 0
max_v = 75
slew_v_per_s = 2000
[safe]
voltage_v = 3.0
ramp_v_per_s = 40.0
"""


def model(scale: float = 1.0) -> Model:
    r = 10 * (np.arange(8) / 8) ** 2 / 2
    b = np.r_[0.8, np.full(7, 0.05)] * scale
    return Model(Hysteresis(r=r, b=b, c=[0.0, 1.0]), Validity(0.0, 10.0))


def compensator(of: Model) -> Compensator:
    return Compensator(of, PERIOD_NS * 1e-9, MIN_V / GAIN, MAX_V / GAIN, SLEW / GAIN)


class Bench:
    """A stepper, its clock, and every voltage that it wrote."""

    def __init__(self, volts: float = 0.0) -> None:
        self.plan = Plan.from_config(parse_config(CONFIG), 0.0, MIN_V, MAX_V)
        self.stepper = Stepper(self.plan, compensator(model()), volts)
        self.now = 0
        self.volts = [volts]

    def tick(self, *commands: tuple[Command, float], n: int = 1) -> np.void:
        batch = np.zeros(len(commands), COMMAND)
        for row, (kind, value) in zip(batch, commands, strict=True):
            row["kind"], row["value"] = kind, value
        return self.send(batch, n)

    def send(self, batch: np.ndarray, n: int = 1) -> np.void:
        for i in range(n):
            self.now += PERIOD_NS
            record = self.stepper.step(self.now, 1.0, batch if i == 0 else batch[:0])[0]
            if self.stepper.state is not State.FAULT:
                self.stepper.written(float(record["volts"]))
            self.volts.append(self.stepper.volts)
        return self.stepper.record[0].copy()


def points(trajectory: int, values: list[float], first: int, last: bool) -> np.ndarray:
    batch = np.zeros(len(values), COMMAND)
    batch["kind"], batch["trajectory"] = Command.POINT, trajectory
    batch["offset_ns"] = (first + np.arange(len(values))) * PERIOD_NS
    batch["value"] = values
    batch["last"][-1:] = last
    return batch


def brute_force(drives: list[float]) -> np.ndarray:
    h, out, of = np.zeros(8), [], model().hysteresis
    for u in drives:
        for i, r in enumerate(of.r):
            h[i] = max(u - r, min(u + r, h[i]))
        out.append(float(np.dot(of.b, h)))
    return np.array(out)


actions = st.lists(
    st.one_of(
        st.tuples(st.just("set"), st.floats(-20, 20) | st.sampled_from([np.nan, np.inf, -np.inf])),
        st.tuples(st.just("play"), st.lists(st.floats(-3, 15), min_size=1, max_size=30)),
        st.tuples(st.sampled_from(["stop", "release", "fault", "back", "reload"]), st.just(0)),
        st.tuples(st.just("wait"), st.integers(1, 400)),
    ),
    max_size=12,
)


@settings(deadline=None, max_examples=80)
@given(actions, st.booleans())
def test_volts_stay_in_range_and_slew_whatever_happens(todo: list, end: bool) -> None:
    bench = Bench()
    bench.tick()
    for number, (what, value) in enumerate(todo):
        if what == "set":
            bench.tick((Command.SETPOINT, value))
        elif what == "play":
            bench.send(points(number + 1, value, 0, True))
        elif what == "stop":
            bench.tick((Command.STOP_MOTION, 0.0))
        elif what == "release":
            bench.tick((Command.RELEASE, 0.0))
        elif what == "fault":
            bench.stepper.fault(bench.now, "pulled")
        elif what == "back":
            bench.stepper.recovered(bench.now, bench.stepper.volts)
        elif what == "reload":
            fresh = compensator(model(1.3))
            bench.stepper.reload(fresh, fresh.init(bench.stepper.volts / GAIN), 0.0)
        else:
            bench.tick(n=value)
        bench.tick(n=5)
    if end:
        bench.stepper.stop(bench.now)
        bench.tick(n=2000)
        assert bench.stepper.stopped
        assert bench.stepper.volts == bench.plan.safe_v
    volts = np.array(bench.volts)
    assert np.isfinite(volts).all()
    assert volts.min() >= MIN_V
    assert volts.max() <= MAX_V
    assert np.abs(np.diff(volts)).max() <= SLEW * 1e-3 * (1 + 1e-12)


def test_a_set_point_is_approached_slowly_and_then_held_exactly() -> None:
    bench = Bench()
    bench.tick((Command.SETPOINT, 4.0))
    assert bench.stepper.state is State.RUNNING
    record = bench.tick(n=100)
    assert record["target"] == pytest.approx(20.0 * 0.1, abs=0.05)  # approach_um_per_s = 20
    assert record["flags"] & Flag.APPROACH
    record = bench.tick(n=201)
    assert record["target"] == 4.0
    assert not record["flags"] & Flag.APPROACH
    drives = np.array(bench.volts) / GAIN
    assert brute_force(drives.tolist())[-1] == pytest.approx(4.0, abs=1e-9)
    assert record["predicted"] == pytest.approx(4.0, abs=1e-9)


def test_stale_set_point_holds_then_ramps_to_the_safe_voltage() -> None:
    bench = Bench()
    bench.tick((Command.SETPOINT, 4.0))
    bench.tick(n=1990)
    assert bench.stepper.state is State.RUNNING
    held = bench.volts[-1]
    bench.tick(n=300)  # the age counts from the end of the approach, 0.2 s
    assert bench.stepper.state is State.HOLDING
    bench.tick(n=4000)
    assert bench.volts[-1] == held
    bench.tick(n=4000)
    assert bench.stepper.state is State.READY
    assert bench.volts[-1] == bench.plan.safe_v
    ramp = np.abs(np.diff(bench.volts[-8000:]))
    assert ramp.max() <= 40.0 * 1e-3 * (1 + 1e-9)


def test_a_trajectory_is_followed_point_by_point_and_marked_done() -> None:
    bench = Bench()
    wave = (4 - 3.5 * np.cos(np.arange(1500) * 0.01)).tolist()
    for start in range(0, 1500, 100):
        bench.send(points(9, wave[start : start + 100], start, start == 1400), n=20)
    bench.tick(n=400)
    seen = [bench.tick()["target"] for _ in range(400)]
    offsets = [int(np.argmin(np.abs(np.array(wave) - t))) for t in seen[:2]]
    assert abs(offsets[1] - offsets[0]) <= 1
    bench.tick(n=1000)
    assert bench.stepper.trajectory_done
    assert bench.stepper.trajectory == 9
    assert bench.stepper.record[0]["target"] == pytest.approx(wave[-1])


def test_a_client_that_dies_in_mid_trajectory_leaves_hold_then_ramp() -> None:
    bench = Bench()
    bench.send(points(3, np.linspace(0, 6, 500).tolist(), 0, False), n=600)
    assert any("run dry" in e for e in bench.stepper.events)
    assert bench.stepper.record[0]["flags"] & Flag.FALLBACK
    bench.tick(n=2100)
    assert bench.stepper.state is State.HOLDING
    bench.tick(n=8000)
    assert bench.stepper.volts == bench.plan.safe_v


def test_unreachable_targets_are_flagged_not_hidden() -> None:
    bench = Bench()
    bench.tick((Command.SETPOINT, 40.0))
    record = bench.tick(n=2100)  # the approach takes 2 s
    assert record["flags"] & Flag.UNREACHABLE
    assert record["target"] == 40.0
    assert record["volts"] == MAX_V


def test_reload_does_not_jump_and_arrives_at_the_target_of_the_new_model() -> None:
    bench = Bench()
    bench.tick((Command.SETPOINT, 4.0))
    bench.tick(n=500)
    fresh = compensator(model(1.25))
    state = fresh.init(0.0)
    for volts in bench.volts:
        fresh.applied(state, volts / GAIN)
    before = bench.stepper.volts
    bench.stepper.reload(fresh, state, 0.0)
    bench.tick((Command.SETPOINT, 4.0))
    assert abs(bench.stepper.volts - before) <= 40.0 * 1e-3 * (1 + 1e-9)
    for _ in range(6):
        bench.tick((Command.SETPOINT, 4.0), n=300)
    assert bench.stepper.record[0]["predicted"] == pytest.approx(4.0, abs=1e-6)
    assert bench.stepper.volts < before


def test_fault_stops_all_voltage_until_the_device_is_back() -> None:
    bench = Bench()
    bench.tick((Command.SETPOINT, 4.0))
    bench.tick(n=500)
    bench.stepper.fault(bench.now, "unplugged")
    held = bench.stepper.volts
    bench.tick((Command.SETPOINT, 1.0), n=50)
    assert bench.stepper.volts == held
    bench.stepper.recovered(bench.now, held)
    assert bench.stepper.state is State.READY  # on_fault = "hold"
    bench.tick((Command.SETPOINT, 4.0), n=400)
    assert bench.stepper.state is State.RUNNING


@pytest.fixture
def recorded() -> list[tuple[int, float, bytes]]:
    rng = np.random.default_rng(3)
    return [
        (i * PERIOD_NS, float(rng.normal()), points(1, [0.01 * i], i, False).tobytes())
        for i in range(300)
    ]


def test_the_same_inputs_give_the_same_records(recorded: list[tuple[int, float, bytes]]) -> None:
    outputs = []
    for _ in range(2):
        stepper, out = Bench().stepper, []
        for now, measured, raw in recorded:
            record = stepper.step(now, measured, np.frombuffer(raw, COMMAND))
            stepper.written(float(record["volts"][0]))
            out.append(stepper.record.tobytes())
        outputs.append(b"".join(out))
    assert outputs[0] == outputs[1]
