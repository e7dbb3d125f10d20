"""The diagnosis of real recordings must not contradict what physics says of each.

What each recording contains was established independently of this code, by regression on the raw
columns; see docs/real-recordings.md.
"""

import numpy as np
import pytest
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.daemon.files.recordings import read_recording
from dehyst.models.cascade.history import replay
from dehyst.models.cascade.simulate import channels_of
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.recording import Recording

pytestmark = pytest.mark.recordings


def one(data_dir, name: str, every: int) -> Diagnosis:
    """Diagnose every n-th sample, so that the test stays short."""
    r = read_recording(data_dir / "recordings" / f"{name}.csv")
    thin = Recording(
        r.t_s[::every],
        r.drive[::every],
        r.displacement[::every],
        r.drive_unit,
        r.displacement_unit,
        {k: v[::every] for k, v in r.channels.items()},
        name=r.name,
    )
    return diagnose_without_limits([thin])


def names(diagnosis: Diagnosis) -> list[str]:
    return [f.name for f in diagnosis.findings]


def candidates(diagnosis: Diagnosis) -> set[str]:
    """Return every cause that the diagnosis considers possible."""
    return {n for f in diagnosis.findings for n in (f.name, *f.ambiguous_with)}


@pytest.fixture(scope="module")
def lightsheet(data_dir):
    return one(data_dir, "lightsheet", 5)


@pytest.fixture(scope="module")
def triangle(data_dir):
    return one(data_dir, "afm-triangle-a", 8)


def test_light_sheet_servo_may_be_a_lag(lightsheet):
    """The wide loop is a servo of 10 Hz bandwidth; there is hardly any hysteresis. A single
    waveform cannot distinguish the two: the named finding is ambiguous with the lag."""
    assert {"lag", "delay"} & candidates(lightsheet)
    # with one waveform, no model need predict the blocks that were left out
    assert lightsheet.verdict in ("explained", "partly")


def test_one_slow_triangle_holds_no_missing_physics(triangle):
    """In a single slow loop, any rate-independent memory explains it."""
    assert set(names(triangle)) <= {"shape", "unknown"}


def test_nor_does_one_in_which_the_force_goes_to_and_fro_with_it(data_dir):
    """The force only changes at the turn, where the tip touches: it is a result of the motion."""
    assert set(names(one(data_dir, "afm-triangle-b", 4))) <= {"shape", "unknown"}


@pytest.mark.parametrize("which", ["lightsheet", "triangle"])
def test_held_out_error_does_not_grow(which, request):
    diagnosis = request.getfixturevalue(which)
    before, after = diagnosis.rms["heldout_model"], diagnosis.rms["heldout_augmented"]
    assert after <= 1.02 * before


@pytest.mark.parametrize("which", ["lightsheet", "triangle"])
def test_model_runs_on_the_recording_again(which, request):
    diagnosis = request.getfixturevalue(which)
    view = diagnosis.views[0]
    assert not channels_of(diagnosis.model)  # only the drive moves these two
    y = replay(diagnosis.model, view.t_s, view.drive, {}, view.displacement).predicted
    assert np.all(np.isfinite(y))
    error = view.displacement - y
    assert np.std(error) < 0.2 * np.std(view.displacement)


@pytest.mark.parametrize(("name", "every"), [("stack-1hz", 2), ("stack-am", 1), ("afm-hold", 2)])
def test_what_began_before_the_recording_is_named(data_dir, name, every):
    """The two stacks climb ever more slowly from a start at rest; the AFM's drive climbs by a
    constant amount per decade after a move. A small residual remains unexplained."""
    assert {"creep", "drift"} & set(names(one(data_dir, name, every)))


def test_the_written_model_follows_a_modulated_sine_nearly_as_its_fit_does(data_dir):
    """The recording begins in the middle of the stage's life: of several models, held more or less
    to the one in use, the one that can begin so is written."""
    d = one(data_dir, "stack-am", 1)
    (before,), (after,) = d.rms["model"].values(), d.rms["augmented"].values()
    assert after < 0.4 * before
    assert after < 1.5 * d.rms["heldout_augmented"]
