"""An effect that begins, or grows, within a recording is reported with its time; an effect that is
present all the time has none."""

import numpy as np
import pytest
from scipy import signal
from tests.models.diagnosis.test_diagnosed_model import DT, NOISE_UM, N, drive, plain, recordings
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.cascade.history import replay_recording
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.effects import Effect, Span
from dehyst.models.diagnosis.findings.growth import growth
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Floats

AT = 5.0  # s, in the second recording
LAG_S = 4e-3


def ramp(k: int) -> Floats:
    """Return 0, and in the second recording 1 after AT, with a rise of 10 ms."""
    t = np.arange(N) * DT
    return np.clip((t - AT) / 0.01, 0.0, 1.0) * (k == 1)


def delayed_from_then_on(k: int) -> Floats:
    """Return a delayed reading: of all of the first recording, and of the second one after AT."""
    t, u = np.arange(N) * DT, drive(k)
    y, late = plain(u), plain(np.interp(t - 5e-3, t, u))
    return np.asarray(y + (late - y) * (ramp(k) if k else 1.0))


def coupled_more_from_then_on(k: int) -> Floats:
    return np.asarray(plain(drive(k)) + 0.02 * neighbour(k) * (0.3 + 0.7 * ramp(k)))


def neighbour(k: int) -> Floats:
    return np.asarray(5 + 3 * np.sin(2 * np.pi * (1.7 + k) * np.arange(N) * DT))


@pytest.mark.parametrize(
    ("stage", "name", "words"),
    [
        (delayed_from_then_on, "delay", "It is present from"),
        (coupled_more_from_then_on, "coupling", "It grows at"),
    ],
)
def test_what_grows_is_reported_with_its_time(stage: object, name: str, words: str) -> None:
    given = []
    for k in range(2):
        noise = NOISE_UM * np.random.default_rng(k).standard_normal(N)
        y = stage(k) + noise  # type: ignore[operator]
        channels = {"u2_v": neighbour(k)}
        given.append(Recording(np.arange(N) * DT, drive(k), y, channels=channels, name=f"r{k}.csv"))
    d = diagnose_without_limits(given)
    found = {n: f for f in d.findings for n in (f.name, *f.ambiguous_with)}
    first = found[name]
    assert words in first.says
    assert first.where["recording"] == "r1.csv"
    assert first.where["from_s"] == pytest.approx(AT, abs=0.3)


def begun(after: Floats) -> list[Recording]:
    """Return one recording whose reading is `after` (N,) from AT on."""
    t = np.arange(N) * DT
    y = np.where(t < AT, plain(drive(0)), after)
    noise = NOISE_UM * np.random.default_rng(6).standard_normal(N)
    return [Recording(t, drive(0), y + noise, name="r0.csv")]


@pytest.mark.parametrize(("name", "within_s"), [("lag", 0.03), ("clip", 0.3)])
def test_what_begins_in_the_only_recording_is_named_with_its_time(
    name: str, within_s: float
) -> None:
    """Fitted as if it were there all the time, it would be half as large, and a loop of another
    shape beside it. A limit shows where the drive reaches it."""
    low = np.exp(-DT / 4e-3)
    lagged = signal.lfilter([1.0 - low], [1.0, -low], plain(drive(0)))
    limited = plain(np.minimum(drive(0), 7.0))
    d = diagnose_without_limits(begun(lagged if name == "lag" else limited))
    first = d.findings[0]
    assert name in (first.name, *first.ambiguous_with)
    assert first.where["from_s"] == pytest.approx(AT, abs=within_s)
    assert "It is present from" in first.says
    assert name in {block.kind for block in d.model.blocks}  # it is there now
    assert d.rms["heldout_augmented"] < 1.3 * NOISE_UM


def lagging(x: Floats) -> Floats:
    """Return x (N,) behind a lag of LAG_S, with straight lines between the samples."""
    low = np.exp(-DT / LAG_S)
    mean = LAG_S / DT * (1.0 - low)
    return np.asarray(signal.lfilter([1.0 - mean, mean - low], [1.0, -low], x))


def lagged_in(there: tuple[float, ...], k: int) -> Recording:
    """Return a recording of a stage that lags in part of each: after the time, until it where that
    is negative."""
    t, y = np.arange(N) * DT, plain(drive(k))
    after = t >= abs(there[k])
    y = np.where(after == (there[k] >= 0.0), lagging(y), y)
    noise = NOISE_UM * np.random.default_rng(10 + k).standard_normal(N)
    return Recording(t, drive(k), y + noise, name=f"r{k}.csv")


def test_what_began_and_has_stayed_is_named_once_and_is_how_the_stage_is_written() -> None:
    """It is in all of the recordings made after it, and in none of those before."""
    there = (np.inf, AT, 0.0, 0.0)
    given = [lagged_in(there, k) for k in range(3)]
    d = diagnose_without_limits(given)
    (lag,) = (f for f in d.findings if f.name == "lag")
    assert lag.where["recording"] == "r1.csv"
    assert lag.where["from_s"] == pytest.approx(AT, abs=0.03)
    assert lag.parameters["tau_s"].value == pytest.approx(LAG_S, rel=0.02)
    assert "does not contain it" not in lag.says
    new = lagged_in(there, 3)
    assert new.displacement is not None
    before, now = (
        np.std(new.displacement - replay_recording(model, new).predicted)
        for model in (d.base_model, d.model)
    )
    assert before > 3.0 * NOISE_UM
    assert now < 1.2 * NOISE_UM


def test_what_has_ended_is_named_and_not_written() -> None:
    """As the recordings are in the order in which they were made, the stage is without it."""
    given = [lagged_in((0.0, -AT, np.inf), k) for k in range(3)]
    d = diagnose_without_limits(given)
    (lag,) = (f for f in d.findings if f.name == "lag")
    assert lag.where["recording"] == "r1.csv"
    assert lag.where["until_s"] == pytest.approx(AT, abs=0.05)
    assert "The written model does not contain it" in lag.says
    assert "lag" not in {block.kind for block in d.model.blocks}


def test_an_effect_of_part_of_the_time_is_no_block_and_acts_then_alone() -> None:
    data = prepare(begun(plain(drive(0))))
    (lag,) = (c for c in list_candidates(data) if c.key == "lag-sensor")
    always, later = Effect(lag, (4e-3,)), Effect(lag, (4e-3,), Span(0, AT, True, False))
    assert len(always.blocks(np.zeros(0), data)) == 1
    assert later.blocks(np.zeros(0), data) == ()
    x = data.u[:, None]
    assert np.array_equal(later.output(data, x)[data.t < AT], x[data.t < AT])
    after = data.t >= AT
    assert np.array_equal(later.output(data, x)[after], always.output(data, x)[after])


def test_a_gain_that_steps_is_no_effect_that_begins() -> None:
    d = diagnose_without_limits(begun(1.04 * plain(drive(0))))
    assert not [f.name for f in d.findings if "from_s" in f.where and f.name != "unknown"]


def test_what_is_there_all_the_time_has_no_time() -> None:
    d = diagnose_without_limits(recordings(plain, late_s=2e-3))
    assert d.findings[0].name in ("delay", "lag")
    assert {"from_s", "until_s"}.isdisjoint(d.findings[0].where)


def test_two_amplitudes_are_reported_and_many_are_not() -> None:
    data = prepare(recordings(plain))
    rng = np.random.default_rng(3)
    x = np.where(data.rec == 1, 0.05, 0.0) * np.sin(2 * np.pi * 3.0 * data.t)
    noise = NOISE_UM * rng.standard_normal(data.n)
    assert growth(data, NOISE_UM, x, x + noise) is None
    wandering = x * (1.0 + 0.9 * np.sin(2 * np.pi * 0.9 * data.t))
    assert growth(data, NOISE_UM, x, wandering + noise) is None
    fades = growth(data, NOISE_UM, x, x * np.where(data.t < 3.0, 1.6, 0.4) + noise)
    assert fades is not None
    assert fades.where == {"recording": "r1.csv", "until_s": pytest.approx(3.0, abs=0.3)}
    assert fades.before == pytest.approx(1.6, abs=0.1)
    assert fades.behind == pytest.approx(0.4, abs=0.1)
    assert "falls" in fades.says
