"""The slow check of the amplifier's own report of its output against what was written.

An MDT693B reports through an ADC with an offset of some 0.2 V that is up to 0.25 s late, so no
loop is ever closed on it. What it is good for is to notice that the output is not where the
daemon believes: a knob was turned, the external input adds a voltage, the unit takes set-points
and does not carry them out. Then nobody can say by how much the next set-point would make the
output jump, and no further voltage is written until the two agree again.

Pure: times come in. The loop asks `due`, reads back in the place of one sensor reading, and
gives the result to `judge`.
"""

SPAN_NS = 1_000_000_000  # the report is compared with what was written in the last 1 to 2 s
RESTING_NS, MOVING_NS, DOUBT_NS = 1_000_000_000, 5_000_000_000, 250_000_000
IN_A_ROW = 3


class ReadbackCheck:
    """tolerance_v: difference that is still agreement; volts: the output as it begins.

    doubtful: True while the report disagrees for certain."""

    def __init__(self, tolerance_v: float, volts: float) -> None:
        self.tolerance_v = tolerance_v
        self._begun_ns = self._asked_ns = 0
        self.begin(volts)

    def begin(self, volts: float) -> None:
        """The link was made (again) and the output is known to stand at `volts`."""
        self.doubtful = False
        self.reported_v = volts
        self._low = self._high = self._old_low = self._old_high = volts
        self._against = self._for = 0

    def wrote(self, now_ns: int, volts: float) -> None:
        """The output was set to `volts`; call it in every sample."""
        if now_ns - self._begun_ns > SPAN_NS:
            self._old_low, self._old_high = self._low, self._high
            self._low = self._high = volts
            self._begun_ns = now_ns
        elif volts < self._low:
            self._low = volts
        elif volts > self._high:
            self._high = volts

    def due(self, now_ns: int, moving: bool) -> bool:
        """True when the unit should be asked now."""
        every_ns = MOVING_NS if moving else RESTING_NS
        if self._against or self.doubtful:
            every_ns = DOUBT_NS
        if now_ns - self._asked_ns < every_ns:
            return False
        self._asked_ns = now_ns
        return True

    def judge(self, reported_v: float) -> str:
        """Take one report: "" as before, "disagrees" when doubt begins, "agrees" when it ends."""
        self.reported_v = reported_v
        low = min(self._low, self._old_low) - self.tolerance_v
        high = max(self._high, self._old_high) + self.tolerance_v
        if low <= reported_v <= high:
            self._against, self._for = 0, self._for + 1
            if self.doubtful and self._for >= IN_A_ROW:
                self.doubtful = False
                return "agrees"
        else:  # NaN included
            self._for, self._against = 0, self._against + 1
            if not self.doubtful and self._against >= IN_A_ROW:
                self.doubtful = True
                return "disagrees"
        return ""
