"""The MDT693B driver's constants and the source of each."""

from dataclasses import dataclass, field

from dehyst.drivers.call_times import Batches


@dataclass(frozen=True)
class Tuning:
    """Rates come from tests/benchmarks/drivers/mdt693b_link.py, which prints the declared rate next
    to the one that was reached. Readback figures come from captures of real units, which show an
    offset of 0.2 V, a lag of 0.05 to 0.25 s and a display of one decimal."""

    expected_rate_hz: float = 300.0  # declared until the unit has been measured at open()
    batches: Batches = field(default_factory=Batches)  # how the rate is measured
    measured_after: int = 256  # sets between two updates of the declared rate

    # readback: used instead of the set-point if it differs by more than the tolerance; it is
    # settled once it changes by less than settled_v in settle_s
    readback_tolerance_v: float = 2.0
    settle_s: float = 0.2
    settled_v: float = 0.15
    longest_settle_s: float = 3.0

    # line: a device that sends more unsolicited bytes than this is not an MDT693B
    most_drained: int = 65536


@dataclass(frozen=True)
class ProbeTuning:
    """Waits of `dehyst probe`. They are generous because a truncated reply would make a false
    recording, and a probe is never urgent. No benchmark sets them."""

    first_byte_s: float = 0.5
    quiet_s: float = 0.15  # silence that ends a reply
    same_v: float = 1.0  # how far the readback may be from the voltage at which sets are timed


TUNING = Tuning()
PROBE_TUNING = ProbeTuning()
