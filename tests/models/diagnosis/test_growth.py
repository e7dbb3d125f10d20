"""An effect that begins, or grows, within a recording is reported with its time; an effect that is
present all the time has none."""

import numpy as np
import pytest
from tests.models.diagnosis.test_diagnosed_model import DT, NOISE_UM, N, drive, plain, recordings
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.findings.growth import growth
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Floats

AT = 5.0  # s, in the second recording


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
        (delayed_from_then_on, "delay", "It is there from"),
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
