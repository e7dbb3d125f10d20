"""Compare the amplifier's reported output with what was written, at long intervals.

An MDT693B reports through an ADC with an offset of some 0.2 V that is up to 0.25 s late, so no loop
is ever closed on it. The report serves to detect that the output differs from what the daemon
assumes: a knob was turned, the external input adds a voltage, or the unit accepts set-points
without executing them. The jump caused by the next set-point would then be unknown, so no further
voltage is written until the two agree again.

Pure: takes times as arguments. The loop asks `due`, reads back instead of one sensor reading, and
passes the result to `judge`.
"""

SPAN_NS = 1_000_000_000  # the report is compared with what was written in the last 1 to 2 s
# intervals of the queries: in motion they are rare, as each replaces a reading; DOUBT_NS is the
# longest lag of a report
RESTING_NS, MOVING_NS, DOUBT_NS = 1_000_000_000, 5_000_000_000, 250_000_000
IN_A_ROW = 3  # reports needed for a verdict, since one may be late or noisy


class ReadbackCheck:
    """The check of one amplifier. tolerance_v: largest difference that counts as agreement; volts:
    the initial output.

    `doubtful`: True while the report certainly disagrees."""

    def __init__(self, tolerance_v: float, volts: float) -> None:
        self.tolerance_v = tolerance_v
        self._begun_ns = self._asked_ns = 0
        self.begin(volts)

    def begin(self, volts: float) -> None:
        """Start (again) after a connection, with the output known to be `volts`."""
        self.doubtful = False
        self.reported_v = volts
        self._low = self._high = self._old_low = self._old_high = volts
        self._against = self._for = 0

    def wrote(self, now_ns: int, volts: float) -> None:
        """Record that the output is set to `volts`; call this in every sample."""
        if now_ns - self._begun_ns > SPAN_NS:
            self._old_low, self._old_high = self._low, self._high
            self._low = self._high = volts
            self._begun_ns = now_ns
        elif volts < self._low:
            self._low = volts
        elif volts > self._high:
            self._high = volts

    def due(self, now_ns: int, moving: bool) -> bool:
        """Return True when the unit should be queried now."""
        every_ns = MOVING_NS if moving else RESTING_NS
        if self._against or self.doubtful:
            every_ns = DOUBT_NS
        if now_ns - self._asked_ns < every_ns:
            return False
        self._asked_ns = now_ns
        return True

    def judge(self, reported_v: float) -> str:
        """Take one report; return "disagrees" when doubt begins, "agrees" when it ends, else ""."""
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
