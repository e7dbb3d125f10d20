"""Whether a model is better than the one in use, on telemetry that it was not fitted to."""

from dataclasses import replace

import numpy as np
from tests.models.mismatch.test_trial import NOISE, recording, stage

from dehyst.models.change.replay import ReplayComparison, keep_zero, replay_both
from dehyst.models.identify.validation import validate
from dehyst.models.model import Block
from dehyst.models.physics import with_blocks


def test_an_offer_must_improve_by_more_than_the_noise() -> None:
    assert ReplayComparison(0.10, 0.02, 0.02, 10.0).improves
    assert not ReplayComparison(0.028, 0.020, 0.02, 10.0).improves  # removes 0.0196 rms
    assert ReplayComparison(0.029, 0.020, 0.02, 10.0).improves  # removes 0.0210 rms
    assert not ReplayComparison(0.02, 0.10, 0.02, 10.0).improves


def test_both_are_replayed_on_what_came_later() -> None:
    both = replay_both(stage(), stage(0.9), recording(0.9), NOISE, 10.0)
    assert both.offered < 1.2 * NOISE
    assert both.in_use > 10 * NOISE
    assert both.improves
    assert not replay_both(stage(), stage(0.9), recording(1.0), NOISE, 10.0).improves


def test_blocks_stand_in_the_order_of_what_they_are() -> None:
    """Findings are placed around the model: nearer to the amplifier, and nearer to the gauge."""
    own = with_blocks(stage(), [Block("lag", "drive", {"tau_s": 1.0}), Block("creep", "stage", {})])
    added = [Block("lag", place, {"tau_s": 2.0}) for place in ("sensor", "drive", "stage")]
    found = with_blocks(own, added).blocks
    assert [(b.kind, b.place, b.params.get("tau_s")) for b in found] == [
        ("lag", "drive", 2.0), ("lag", "drive", 1.0), ("creep", "stage", None),
        ("lag", "stage", 2.0), ("lag", "sensor", 2.0),
    ]  # fmt: skip


def test_a_target_means_the_same_place_under_the_offered_model() -> None:
    """Creep of 4 % per decade over four decades moves a model's zero by a tenth of its position."""
    seen = recording()
    creep = {"gain_per_decade": 0.04, "tau_min_s": 0.05, "tau_max_s": 500.0}
    offered = with_blocks(stage(), [Block("creep", "stage", creep)])
    assert abs(validate(offered, seen).offset - validate(stage(), seen).offset) > 0.3
    for trim in (0.0, 0.25):
        trimmed = replace(seen, channels={"trim_um": np.full(seen.size, trim)})
        kept = keep_zero(stage(), offered, trimmed)
        moved = validate(kept, seen).offset - validate(stage(), seen).offset
        assert abs(moved - trim) < 0.01
