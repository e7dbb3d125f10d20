"""The next experiment, as arguments of `dehyst excite` within the stage's limits."""

import math

from dehyst.daemon.files.cases import Case
from dehyst.models.drive_design.excitation import design
from dehyst.models.drive_design.separation import EFFECTS
from dehyst.models.errors import BadInput
from dehyst.models.model import Model

# durations to try; top of the band over the sampling rate: 20 samples of the fastest period
SECONDS, SHARE = (20.0, 60.0, 180.0, 600.0), 0.05
UNITS = ("v", "um", "nm", "counts")


def excite_arguments(case: Case, model: Model, pair: tuple[str, str] | None) -> tuple[str, ...]:
    """Return ("excite", ...), ready to run; () if the limits allow no experiment. pair: two effects
    that the recording cannot distinguish; None: design a drive that covers range and rates."""
    low = max(case.low, model.validity.drive_min)
    high = min(case.high, model.validity.drive_max)
    if not high > low or model.drive_unit not in UNITS:
        return ()
    common = [
        "--range",
        f"{low:.6g}",
        f"{high:.6g}",
        "--unit",
        model.drive_unit,
        "--sampling",
        f"{case.rate_hz:g}",
        "--slew",
        f"{case.slew:.6g}",
        "-o",
        "next.csv",
    ]
    if pair is not None and all(name in EFFECTS for name in pair):
        return ("excite", "--separate", *pair, *common, "--duration", f"{SECONDS[0]:g}")
    band = min(SHARE * case.rate_hz, case.slew / (math.pi * (high - low)))
    for seconds in SECONDS:  # a low band needs a longer drive
        for part in (1.0, 0.5, 0.25):
            try:  # propose only what can be run
                design(low, high, part * band, seconds, case.rate_hz, slew_per_s=case.slew)
            except BadInput:
                continue
            return ("excite", "--band", f"{part * band:.6g}", *common, "--duration", f"{seconds:g}")
    return ()
