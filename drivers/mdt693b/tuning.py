"""The MDT693B driver's constants and where each of them comes from."""

from dataclasses import dataclass, field

from dehyst.drivers.call_times import Batches


@dataclass(frozen=True)
class Tuning:
    """Rates are set by tests/benchmarks/drivers/mdt693b_link.py, which prints the declared rate
    beside the one that was reached; readback figures by what captures of real units show: an
    offset of 0.2 V, a lag of 0.05 to 0.25 s, a display of one decimal."""

    expected_rate_hz: float = 300.0  # declared until the unit has been measured at open()
    batches: Batches = field(default_factory=Batches)  # how the rate is measured
    measured_after: int = 256  # sets between two updates of the declared rate

    # readback: believed instead of the set-point when farther from it than the tolerance; it
    # counts once it changes less than settled_v in settle_s
    readback_tolerance_v: float = 2.0
    settle_s: float = 0.2
    settled_v: float = 0.15
    longest_settle_s: float = 3.0

    # line: more unasked bytes than this are no MDT693B
    most_drained: int = 65536


@dataclass(frozen=True)
class ProbeTuning:
    """Waits of `dehyst probe`, generous because a reply that is cut off would make a false
    recording: a unit is never in a hurry there. No benchmark sets them."""

    first_byte_s: float = 0.5
    quiet_s: float = 0.15  # silence that ends a reply
    same_v: float = 1.0  # how far the readback may be from the voltage at which sets are timed


TUNING = Tuning()
PROBE_TUNING = ProbeTuning()
