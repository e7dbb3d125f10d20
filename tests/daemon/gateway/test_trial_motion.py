"""A model on trial is compared with the previous one on the same samples, however little the stage
is moved and however its motion differs from that before the switch."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.trials import (
    LAG_S,
    Motion,
    TrialRig,
    holds,
    raster,
    reloads,
    rest,
    scaled,
    setpoints,
    small_steps,
)
from tests.rigs.trials import steps as large_steps

from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.gateway.previous_model import PreviousModel
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.models.model import Block


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[TrialRig]:
    with reloads(TrialRig(tmp_path, scaled(1.2))) as rig:
        yield rig


@pytest.mark.parametrize(("gain", "became"), [(1.0, "accepted"), (1.5, "returned")])
@pytest.mark.parametrize(
    ("first", "motion"),
    [(holds, holds), (small_steps, small_steps), (large_steps, small_steps), (holds, large_steps)],
)
def test_it_is_judged_rightly_by_motion_of_another_size(
    tmp_path: Path, first: Motion, motion: Motion, gain: float, became: str
) -> None:
    with reloads(TrialRig(tmp_path, scaled(1.2), lag_s=0.0)) as rig:
        rig.go(first, 8.0)
        rig.offer(scaled(gain))
        over = rig.until_over(motion, False, 40.0)
        assert over is not None
        assert over[1] == became, over


def test_the_tracking_of_steps_is_not_compared_with_that_of_a_raster(tmp_path: Path) -> None:
    with reloads(TrialRig(tmp_path, scaled(1.2), lag_s=LAG_S)) as rig:
        rig.go(raster, 8.0, played=True)
        rig.offer(scaled(1.0, lag=True))
        over = rig.until_over(large_steps, False, 40.0)
        assert over is not None
        assert over[1] == "accepted", over


CREEP = Block("earlier_creep", "stage", {"amount_um": -1.3, "since_s": 0.1})


@pytest.mark.parametrize("blocks", [(), (CREEP,)], ids=["plain", "with one recording's past"])
def test_the_model_before_expects_what_the_loop_expected_of_it(
    rig: TrialRig, blocks: tuple[Block, ...]
) -> None:
    """Simulated along the written voltage, the previous model predicts what the telemetry contains,
    except for a constant: it does not know the time before the samples that are kept."""
    rig.go(setpoints, 20.0)
    samples = np.array(rig.rig.records, TELEMETRY)[2000:]
    before = PreviousModel(rig.config, replace(scaled(1.2), blocks=blocks), rig.history.get)
    found = np.concatenate([before.expect(samples[k : k + 50]) for k in range(0, 1000, 50)])
    off = found - samples["predicted"][:1000]
    assert np.ptp(off) < 1e-6
    again = before.expect(samples[1400:1500])  # where samples were lost, it starts again
    assert np.ptp(np.r_[off, again - samples["predicted"][1400:1500]]) < 1e-6


def test_a_model_that_follows_further_channels_is_not_led(rig: TrialRig) -> None:
    rig.go(setpoints, 1.0)
    block = Block("coupling", "stage", {"gain_um_per_unit": 0.1}, "temp_c")
    found = PreviousModel(rig.config, replace(scaled(1.2), blocks=(block,)), rig.history.get)
    assert np.isnan(found.expect(np.array(rig.rig.records, TELEMETRY))).all()


def test_a_loop_that_runs_another_model_ends_the_trial_and_it_is_not_judged(rig: TrialRig) -> None:
    rig.go(setpoints, 8.0)
    rig.offer(scaled(1.0, lag=True))
    rig.go_on(setpoints)
    assert rig.trial.check_outcome(rig.clock_ns) is None
    save_model(scaled(1.1), rig.folder / "model.toml")  # replaced by its owner
    rig.reload_asked = True
    over = rig.until_over(setpoints, False, 30.0)
    assert over is not None
    assert over[1] == "returned"
    assert "the loop runs another model" in over[2]
    assert load_model(rig.folder / "model.toml").hysteresis.c == pytest.approx(
        scaled(1.1).hysteresis.c
    )


def test_how_far_it_is_is_said(rig: TrialRig) -> None:
    rig.go(rest, 8.0)
    assert rig.trial.progress(0) == ""
    rig.offer(scaled(1.0, lag=True))
    assert "the loop does not run it now" in rig.trial.progress(rig.clock_ns)
    rig.go_on(rest)
    rig.trial.check_outcome(rig.clock_ns)
    rig.go(rest, 5.0)
    assert "waiting for the stage to move; it ends in 85 s" in rig.trial.progress(rig.clock_ns)
