"""The model of the simulated stage is shipped, so that a start need not identify it."""

import subprocess
import sys

import numpy as np
from tests.rigs.stage_model import kept_model

from dehyst.daemon.bench.simulated import SHIPPED_MODEL, exploring_drive
from dehyst.daemon.files.models import load_model
from dehyst.models.hysteresis.forward import simulate_hysteresis

WITHOUT = """
import sys
from dehyst.daemon.bench.emulated import started_for
from dehyst.daemon.bench.simulated import write_bench
from dehyst.daemon.commands.run import models_of_bench
from dehyst.daemon.service.supervisor import Supervisor

models_of_bench(None, ("x",))
print("numba" in sys.modules)
"""


def test_it_is_the_one_that_the_stage_gives() -> None:
    shipped, fresh = load_model(SHIPPED_MODEL), kept_model()
    _, volts = exploring_drive()
    pair = [simulate_hysteresis(model.hysteresis, volts, 1e9) for model in (shipped, fresh)]
    assert np.abs(pair[0] - pair[1]).max() < 1e-3
    assert shipped.validity == fresh.validity
    assert shipped.provenance.recordings == fresh.provenance.recordings


def test_a_start_on_it_waits_for_no_compiler() -> None:
    """A start with the shipped model does not import numba, which would take half a second."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stdout == "False\n", done.stderr
