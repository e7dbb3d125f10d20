"""The numerical constants of the simulated stage; its physical parameters are its settings."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Sub-steps and thresholds. tests/benchmarks/drivers/simulated_stage.py measures their cost,
    and tests/drivers/simulated/test_stage_linear.py shows that no reading reveals their error."""

    longest_substep_s: float = 3600.0  # for a stage at rest
    shortest_substep_s: float = 2e-6
    substeps_per_tau: float = 4.0  # for the RC corner and the amplifier's lag
    substeps_per_sensor_tau: float = 2.0
    substeps_per_oscillation: float = 20.0  # for the mode
    substeps_per_hum: float = 40.0
    settled: float = 1e-10  # share of full scale within which the capacitor counts as charged
    still: float = 1e-6  # share of the stroke below which the mode counts as at rest
    together_s: float = 2.5e-4  # for coupled axes, while one moves
    rate_tau_s: float = 0.005  # inertia of the domain walls, which rate dependence follows


TUNING = Tuning()
