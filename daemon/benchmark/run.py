"""Fit each model to each case, predict the held-out rows, and measure the cost.

All figures except the cost are computed from seeds and recordings: two runs give the same.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from dehyst.daemon import clock
from dehyst.daemon.benchmark.cases import Comparison, head
from dehyst.daemon.benchmark.rivals.interface import Predict, Rival, measured
from dehyst.models.errors import DehystError
from dehyst.models.signals.error_size import rms

ROW_SHARES = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)  # of the fitted rows
ENOUGH = 1.25  # as a multiple of the error with all rows
DIGITS = 4  # significant digits: further ones differ between processors
REPEATS = 3  # timed predictions, of which the shortest counts


@dataclass(frozen=True)
class Score:
    """Result of one model on one case. error: rms over the held-out rows, in the displacement unit;
    share: error in percent of their range; rows: number of rows needed, None: not determined;
    cost_ns: per sample; refused: why there is no model, or ""."""

    case: str
    rival: str
    error: float
    share: float
    rows: int | None
    cost_ns: float
    unit: str
    refused: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the figures that are reproducible: all but the cost."""
        return {
            "case": self.case,
            "model": self.rival,
            "error": round_digits(self.error),
            "unit": self.unit,
            "error_percent": round_digits(self.share),
            "rows_needed": self.rows,
            "refused": self.refused,
        }


def round_digits(value: float) -> float | None:
    """Round to DIGITS significant digits; None if not finite."""
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


@threadpool_limits.wrap(limits=1, user_api="blas")  # more threads sum in a different order
def run_comparisons(
    cases: Sequence[Comparison],
    rivals: Sequence[Rival],
    progress: Callable[[float], None] = lambda share: None,
) -> list[Score]:
    """Run every model on every case. progress: called with the fraction done."""
    out = []
    for case in cases:
        for rival in rivals:
            out.append(run_one(case, rival))
            progress(len(out) / (len(cases) * len(rivals)))
    return out


def run_one(case: Comparison, rival: Rival) -> Score:
    """Run one model on one case; for a simulated case also find how many rows it needs."""
    unit = case.held.displacement_unit
    try:
        predict = rival.fit(case.fitted)
        error = held_out_error(case, predict)
    except DehystError as refused:
        why = str(refused).removeprefix(f"{case.fitted.name}: ")
        return Score(case.name, rival.name, math.inf, math.inf, None, math.nan, unit, why)
    span = float(np.ptp(measured(case.held)[case.scored]))
    rows = rows_needed(case, rival, error) if case.made and math.isfinite(error) else None
    cost = _cost_ns(case, predict)
    return Score(case.name, rival.name, error, 100.0 * error / span, rows, cost, unit)


def held_out_error(case: Comparison, predict: Predict) -> float:
    """Return the rms of predicted minus measured over the scored rows."""
    with np.errstate(all="ignore"):
        left = predict(case.held.t_s, case.held.drive) - measured(case.held)
        out = rms(left[case.scored])
    return out if math.isfinite(out) else math.inf


def rows_needed(case: Comparison, rival: Rival, error: float) -> int:
    """Return the smallest tried number of rows with which the held-out error is at most ENOUGH
    times the error with all rows."""
    for share in ROW_SHARES:
        rows = round(share * case.fitted.size)
        try:
            found = held_out_error(case, rival.fit(head(case.fitted, rows)))
        except DehystError:
            continue
        if found <= ENOUGH * error:
            return rows
    return case.fitted.size


def _cost_ns(case: Comparison, predict: Predict) -> float:
    took = []
    for _ in range(REPEATS):
        begun = clock.monotonic_ns()
        predict(case.held.t_s, case.held.drive)
        took.append(clock.monotonic_ns() - begun)
    return min(took) / case.held.size
