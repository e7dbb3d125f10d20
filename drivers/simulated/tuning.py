"""The constants with which the simulated stage is computed; what it is, its settings say."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Sub-steps and thresholds. tests/benchmarks/drivers/simulated_stage.py shows what they cost,
    tests/drivers/simulated/test_stage_linear.py that they leave no error that a reading shows."""

    longest_substep_s: float = 3600.0  # of a stage at rest
    shortest_substep_s: float = 2e-6
    substeps_per_tau: float = 4.0  # of the RC corner and of the amplifier's lag
    substeps_per_sensor_tau: float = 2.0
    substeps_per_oscillation: float = 20.0  # of the mode
    substeps_per_hum: float = 40.0
    settled: float = 1e-10  # share of full scale at which the capacitor counts as charged
    still: float = 1e-6  # share of the stroke below which the mode counts as still
    together_s: float = 2.5e-4  # of axes that feel each other, while one moves
    rate_tau_s: float = 0.005  # the walls' inertia: how fast rate dependence follows the rate


TUNING = Tuning()
