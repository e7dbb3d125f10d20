"""What the recordings lack is reported first, and never becomes physics."""

from dataclasses import replace

import numpy as np
import pytest
from tests.models.diagnosis.test_diagnosed_model import DT, NOISE_UM, N, drive, plain, recordings
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.data.survey import has_reversals_within_sweeps
from dehyst.models.identify import identify
from dehyst.models.physics.registry import list_candidates
from dehyst.models.physics.sensor import NonlinearSensor
from dehyst.models.recording import Recording

PHYSICS = {"shape", "unknown"}


def names(d: object) -> set[str]:
    return {f.name for f in d.findings}  # type: ignore[attr-defined]


def test_readings_that_are_missing_cost_nothing_but_themselves() -> None:
    given = []
    for one in recordings(plain):
        y = np.array(one.displacement)
        y[::3] = np.nan
        given.append(Recording(one.t_s, one.drive, y, name=one.name))
    d = diagnose_without_limits(given)
    assert d.verdict == "clean"
    assert d.noise == pytest.approx(NOISE_UM, rel=0.1)
    assert d.data.missing == 2 * len(range(0, N, 3))
    assert "missing" in d.data.says[0]


def test_rows_that_are_missing_stand_on_the_grid() -> None:
    one = recordings(plain)[0]
    keep = np.arange(N) % 3 != 0
    data = prepare([Recording(one.t_s[keep], one.drive[keep], one.displacement[keep])])
    assert data.n == N - 1  # the first row is missing too
    assert data.missing == (N - 1) // 3
    assert not data.starts[1:].any()
    np.testing.assert_allclose(data.t, one.t_s[1:], atol=1e-9)
    assert not np.any(data.rows & (data.raw_index < 0))


@pytest.mark.parametrize("pause_s", [20.0, 2000.0])
def test_a_pause_lacks_no_readings(pause_s: float) -> None:
    one = recordings(plain)[0]
    later = one.t_s + np.where(np.arange(N) >= N // 2, pause_s, 0.0)
    data = prepare([Recording(later, one.drive, one.displacement)])
    assert data.missing == 0
    assert data.stalls == 1
    assert np.count_nonzero(data.starts) == 2


def test_stalls_of_the_recorder_are_no_physics() -> None:
    """The drive is held for up to 32 ms, nine times, and no row is written."""
    rng, t = np.random.default_rng(3), np.arange(N) * DT
    given = []
    for k in range(2):
        u = drive(k)
        keep = np.ones(N, bool)
        for at in rng.integers(500, N - 500, 9):
            size = int(rng.integers(8, 33))
            u[at : at + size] = u[at - 1]
            keep[at : at + size] = False
        y = plain(u) + NOISE_UM * rng.standard_normal(N)
        given.append(Recording(t[keep], u[keep], y[keep], name=f"r{k}.csv"))
    d = diagnose_without_limits(given)
    assert names(d) <= PHYSICS - {"unknown"}
    assert 15 <= d.data.stalls <= 18
    assert any("the recorder stopped" in s for s in d.data.says)


def test_coarse_steps_of_the_reading_are_noise() -> None:
    given = []
    for one in recordings(plain):
        y = np.round(np.array(one.displacement) / 0.15) * 0.15
        given.append(Recording(one.t_s, one.drive, y, name=one.name))
    d = diagnose_without_limits(given)
    assert d.verdict == "clean"
    assert d.noise == pytest.approx(0.15 / np.sqrt(12), rel=0.15)
    assert any("steps of 150 nm" in s for s in d.data.says)


def test_coloured_noise_is_noise() -> None:
    """Noise through a pole at 8 ms, twice as strong as the white noise."""
    given = []
    for k, one in enumerate(recordings(plain)):
        rng = np.random.default_rng(50 + k)
        slow, keep = np.zeros(N), np.exp(-1 / 8)
        for i, w in enumerate(rng.standard_normal(N)):
            slow[i] = keep * slow[i - 1] + np.sqrt(1 - keep**2) * w
        y = one.displacement + 2 * NOISE_UM * slow
        given.append(Recording(one.t_s, one.drive, y, name=one.name))
    d = diagnose_without_limits(given)
    assert d.verdict == "clean"
    assert d.noise == pytest.approx(np.sqrt(5) * NOISE_UM, rel=0.1)
    assert any("coloured" in s for s in d.data.says)


def test_a_reading_that_is_noise_is_not_clean() -> None:
    rng, t = np.random.default_rng(0), np.arange(N) * DT
    d = diagnose_without_limits([Recording(t, drive(0), rng.standard_normal(N))])
    assert d.verdict == "unknown"
    assert "does not follow the drive" in " ".join(d.data.says)
    assert names(d) == {"unknown"}


def test_a_butterfly_is_reported() -> None:
    """The strain is proportional to the square of a polarisation that switches late."""
    t = np.arange(N) * DT
    u = 10 * np.sin(2 * np.pi * 0.5 * t)
    p = np.zeros(N)
    for i in range(1, N):
        sign = np.sign(u[i] - u[i - 1]) or 1.0
        p[i] = p[i - 1] + (np.tanh((u[i] - 4 * sign) / 2) - p[i - 1]) * min(
            1.0, abs(u[i] - u[i - 1]) / 0.8
        )
    y = p**2 + 0.02 * u * p + 0.002 * np.random.default_rng(1).standard_normal(N)
    d = diagnose_without_limits([Recording(t, u, y)])
    assert d.verdict != "clean"
    assert any("butterfly" in s for s in d.data.says)
    assert not any("does not follow" in s for s in d.data.says)  # the gauge and its cable are fine
    assert names(d) <= PHYSICS
    # nothing that follows such a curve can be inverted: the model in use stays
    assert d.rms["augmented"] == pytest.approx(d.rms["model"])
    assert d.model == d.base_model
    assert "one side" in d.next_experiment
    assert not any("it is compensated" in f.says for f in d.findings)


def test_of_a_ramp_no_sensor_and_no_feedback_is_suspected() -> None:
    """A drive that never turns shows one branch, which is a curve, and no change of direction."""
    t = np.arange(N) * DT
    u = 100.0 * t / t[-1]
    y = 0.1 * u + 0.0003 * u**2 + 0.02 * np.random.default_rng(1).standard_normal(N)
    said = diagnose_without_limits([Recording(t, u, y)]).data.says
    assert any("never reverses" in s for s in said)
    assert not any("does not follow" in s or "closed loop" in s for s in said)


def test_a_stage_that_runs_back_at_its_turns_is_no_butterfly() -> None:
    """Friction that breaks away within 0.1 V of a turn, by more than half of the travel."""
    t = np.arange(N) * DT
    u = 5.0 - 4.0 * np.cos(2 * np.pi * 0.5 * t)
    bent = np.zeros(N)
    for i in range(1, N):
        bent[i] = np.clip(bent[i - 1] + (u[i] - u[i - 1]) / 0.1, -1.0, 1.0)
    assert not has_reversals_within_sweeps(
        prepare([Recording(t, u, u - 2.5 * bent, name="friction.csv")])
    )
    late = 5.0 + 4.0 * np.sin(2 * np.pi * 0.5 * t)  # and a parabola that lags
    curve = (np.roll(late, 100) - 5.0) ** 2
    assert has_reversals_within_sweeps(prepare([Recording(t, late, curve, name="butterfly.csv")]))


def test_a_stage_without_hysteresis_is_reported_and_a_narrow_loop_is_none_of_these() -> None:
    t = np.arange(N) * DT
    u = 5 + 3 * np.sin(2 * np.pi * 0.5 * t) + 2 * np.sin(2 * np.pi * 1.7 * t)
    noise = 0.01 * np.random.default_rng(5).standard_normal(N)
    play = np.zeros(N)
    for i in range(1, N):
        play[i] = min(max(play[i - 1], u[i] - 1.5), u[i] + 1.5)
    for width, reported in ((0.0, True), (0.03, False)):
        y = 0.9 * u + 0.01 * u**2 + width * play + noise
        d = diagnose_without_limits([Recording(t, u, y)])
        assert any("no hysteresis is visible" in s for s in d.data.says) is reported


def rounded(steps_in_range: int) -> list[Recording]:
    given, plainly = [], recordings(plain)
    step = float(np.ptp(plainly[0].displacement)) / steps_in_range
    for one in plainly:
        y = np.round(one.displacement / step) * step
        given.append(Recording(one.t_s, one.drive, y, name=one.name))
    return given


@pytest.mark.parametrize("steps_in_range", [20, 7])
def test_the_steps_of_a_reading_are_no_pattern_of_its_sensor(steps_in_range: int) -> None:
    assert "sensor" not in names(diagnose_without_limits(rounded(steps_in_range)))


@pytest.mark.parametrize("steps_in_range", [200, 20, 7])
def test_no_pattern_is_searched_between_the_steps_of_a_reading(steps_in_range: int) -> None:
    data = prepare(rounded(steps_in_range))
    sensors = [c for c in list_candidates(data) if c.name == "sensor"]
    assert len(sensors) == (steps_in_range > 10)
    for sensor in sensors:
        shortest = 1.9 * float(np.ptp(data.y)) / steps_in_range
        assert sensor.parameters[0].low > shortest
        starts = sensor.starts(data, np.sin(2 * np.pi * data.y))
        assert len(starts) == 3
        assert min(starts)[0] > shortest


def test_no_sensor_errs_by_more_than_its_reading() -> None:
    data = prepare(recordings(plain))
    sensor = NonlinearSensor(data)
    span = float(np.ptp(data.y))
    within, beyond = np.array([0.6 * span, 0.7 * span]), np.array([0.0, 1.1 * span])
    period = (0.1 * span,)
    assert sensor.plausibility_weight(period, within) == 1.0
    assert not sensor.implausible(period, within, data)
    assert sensor.plausibility_weight(period, beyond) == 0.0
    assert "range of the reading" in sensor.implausible(period, beyond, data)


@pytest.mark.parametrize("seed", range(2))
def test_an_open_input_that_wanders_is_no_physics(seed: int) -> None:
    rng = np.random.default_rng(seed)
    given = []
    for one in recordings(plain):
        walk = np.cumsum(rng.standard_normal(N))
        y = 3.0 + 0.8 * walk / np.ptp(walk) + NOISE_UM * rng.standard_normal(N)
        given.append(Recording(one.t_s, one.drive, y, name=one.name))
    d = diagnose_without_limits(given)
    assert d.verdict == "unknown"
    assert names(d) <= {"unknown"}
    assert "does not follow the drive" in " ".join(d.data.says)


@pytest.mark.parametrize("fault", ["stuck", "at its limit"])
def test_a_gauge_that_is_stuck_or_at_its_limit_is_no_physics(fault: str) -> None:
    given = recordings(plain)
    y = np.array(given[0].displacement)
    if fault == "stuck":
        y[N // 2 : N // 2 + 300] = y[N // 2]
    else:
        y = np.minimum(y, np.quantile(y, 0.9))
    given[0] = Recording(given[0].t_s, given[0].drive, y, name=given[0].name)
    d = diagnose_without_limits(given)
    assert d.verdict == "clean"
    assert d.noise == pytest.approx(NOISE_UM, rel=0.1)
    assert "stuck or at its limit" in " ".join(d.data.says)


def test_the_recording_that_a_given_model_misses_alone_is_named() -> None:
    given = [*recordings(plain), recordings(plain, seed=5)[0]]
    model = diagnose_without_limits(given).base_model
    given[1] = replace(given[1], displacement=0.8 * np.array(given[1].displacement))
    given[2] = replace(given[2], name="r2.csv")
    d = diagnose_without_limits(given, model)
    assert d.verdict == "clean"
    assert d.data.says[0].startswith("the recording r1.csv does not match the others")


def test_the_recording_that_alone_shows_an_effect_belongs_to_the_others() -> None:
    """An amplifier follows 800 V/s, which the steps of the last recording alone exceed; its mount
    wanders a little."""
    given = recordings(plain)
    model = identify(given).model
    rng, rows = np.random.default_rng(7), np.arange(N)
    u = rng.uniform(0.0, 10.0, N // 250)[rows // 250]
    behind = np.empty(N)
    behind[0] = u[0]
    for i in range(1, N):
        behind[i] = behind[i - 1] + np.clip(u[i] - behind[i - 1], -800.0 * DT, 800.0 * DT)
    walk = np.cumsum(rng.standard_normal(N))
    y = plain(behind) + 0.3 * walk / np.ptp(walk) + NOISE_UM * rng.standard_normal(N)
    given.append(Recording(rows * DT, u, y, name="steps.csv"))
    d = diagnose_without_limits(given, model)
    assert d.verdict == "partly"
    assert d.findings[0].name == "slew"
    assert d.findings[0].parameters["rate_v_per_s"].value == pytest.approx(800.0, rel=0.02)
    assert d.rms["model"].keys() == {"r0.csv", "r1.csv", "steps.csv"}


def decreasing(seed: int, hz: float) -> Recording:
    """Triangles that shrink, on a stage of relays, which play operators do not contain."""
    t = np.arange(3000) * DT
    size = np.maximum(1.0 - t / t[-1], 0.02)
    u = 5.0 + 5.0 * size * (2.0 * np.abs(2.0 * ((hz * t) % 1.0) - 1.0) - 1.0)
    y = relays(u) + NOISE_UM * np.random.default_rng(seed).standard_normal(t.size)
    return Recording(t, u, y, name="triangles.csv")


def relays(u: np.ndarray) -> np.ndarray:
    up, down = np.meshgrid(np.linspace(0.1, 9.9, 60), np.linspace(0.1, 9.9, 60))
    up, down = up[up > down], down[up > down]
    weight = np.exp(-(((up - down) / 1.5) ** 2) - ((up + down - 9.0) / 9.0) ** 2)
    state, out = -np.ones(up.size), np.empty(u.size)
    for i, x in enumerate(u):
        state = np.where(x >= up, 1.0, np.where(x <= down, -1.0, state))
        out[i] = weight @ state
    return np.asarray(u + 4.0 * out / weight.sum())


@pytest.mark.parametrize("hz", [0.5, 4.0])
def test_a_shape_from_one_waveform_is_not_carried_to_others(hz: float) -> None:
    one = decreasing(0, hz)
    d = diagnose_without_limits([one])
    t = np.arange(4000) * DT
    u = 5.0 - 3.0 * np.cos(2 * np.pi * 0.4 * t) - 1.5 * np.cos(2 * np.pi * 1.7 * t)
    y = relays(u)
    before, after = (np.std(y - simulate(m, t, u)) for m in (d.base_model, d.model))
    assert after < before + NOISE_UM
