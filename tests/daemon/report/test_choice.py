"""The report explains in a paragraph what was chosen and why, with the figures of the hold-out."""

import numpy as np
import pytest
from tests.rigs.outside import lagged, plays

from dehyst.daemon.report.choice import explain_choice
from dehyst.daemon.report.identification import report_identification
from dehyst.daemon.report.verdict import verdict
from dehyst.models.drive_design.coverage import measure_coverage
from dehyst.models.identify import Identification, identify
from dehyst.models.recording import Recording


@pytest.fixture(scope="module")
def late() -> tuple[Identification, list[Recording]]:
    recordings = lagged(1, (0.5, 4.0), 0.02)
    return identify(recordings), recordings


def test_what_each_part_gains_in_prediction_is_given(
    late: tuple[Identification, list[Recording]],
) -> None:
    found, _ = late
    (block,) = found.model.blocks
    assert block.kind in ("lag", "delay")
    text = explain_choice(found)
    assert not found.shape.rate
    without = min(c.held_rms for c in found.tried if c.lag is None and not c.shape.rate)
    assert without > 2.0 * found.chosen.held_rms
    assert f"{found.chosen.held_rms:.3g} um" in text
    assert f"{without:.3g} um without the {block.kind}" in text
    assert f"{found.model.hysteresis.n} operators" in text
    assert f"Of {len(found.tried)} structures" in text


def test_what_was_not_taken_is_given_with_its_reason() -> None:
    found = identify(lagged(2, (0.5, 4.0), 0.0))
    assert not found.shape.rate
    rich = [c.held_rms for c in found.tried if c.shape.rate]
    text = explain_choice(found)
    assert f"Rate-dependent weights leave {min(rich):.3g} um: " in text
    assert found.static_because
    assert found.static_because in text


def test_what_was_tried_is_shown_on_request(
    late: tuple[Identification, list[Recording]],
) -> None:
    found, recordings = late
    page = report_identification(found, recordings, measure_coverage(recordings), "stage.toml")
    folded = page.split("<details>")[1].split("</details>")[0]
    assert folded.count("<tr") == 1 + len(found.tried)
    assert folded.count('class="chosen"') == 1
    assert page.count("Held-out error of the best structure of each kind") == 1


def test_the_choice_is_one_of_those_that_were_tried(
    late: tuple[Identification, list[Recording]],
) -> None:
    found, _ = late
    kinds = {(c.shape, c.offset, c.lag) for c in found.tried}
    assert (found.chosen.shape, found.chosen.offset, found.chosen.lag) in kinds
    assert np.isfinite(found.chosen.held_rms)


def test_an_error_without_the_drift_is_called_so() -> None:
    """The error of the fit includes the drift, and the figure beside the noise does not."""
    t = 0.02 * np.arange(2000)
    u = 50.0 - 50.0 * np.cos(2 * np.pi * t) * np.abs(np.sin(0.4 * np.pi * t))
    y = plays(u, np.array([0.0, 5.0, 15.0]), np.array([0.06, 0.03, 0.02])) + 0.01 * t
    noise = 0.01 * np.random.default_rng(2).standard_normal(t.size)
    found = identify([Recording(t, u, y + noise, name="a.csv")])
    assert found.model.fit.steady_rms is not None
    assert " rms apart from the drift, " in verdict(found)
