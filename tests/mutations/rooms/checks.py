"""The slow check of the amplifier's own report."""

from tests.mutations.change import Change, room

READBACK = "daemon/loop/readback.py"

CHANGES = room(
    ("tests/daemon/loop/test_readback_times.py",),
    Change(
        "doubt-after-thirty", READBACK, "IN_A_ROW = 3", "IN_A_ROW = 30",
        "the loop continues to drive an unknown output for half a minute",
    ),
    Change(
        "doubt-after-one", READBACK, "IN_A_ROW = 3", "IN_A_ROW = 1",
        "a single wrong report stops the stage",
    ),
    Change(
        "span-ten-times", READBACK, "SPAN_NS = 1_000_000_000", "SPAN_NS = 10_000_000_000",
        "a unit that stopped carrying out set-points is believed for 20 s",
    ),
    Change(
        "span-a-tenth", READBACK, "SPAN_NS = 1_000_000_000", "SPAN_NS = 100_000_000",
        "the lag of a healthy unit stops the stage",
    ),
    Change(
        "rest-ten-times", READBACK, "MOVING_NS, DOUBT_NS = 1_000_000_000",
        "MOVING_NS, DOUBT_NS = 10_000_000_000", "the unit at rest is asked every ten seconds",
    ),
    Change(
        "motion-ten-times", READBACK, "1_000_000_000, 5_000_000_000, 250_000_000",
        "1_000_000_000, 50_000_000_000, 250_000_000",
        "a unit in motion is asked only every 50 s",
    ),
    Change(
        "doubt-asks-rarely", READBACK, "5_000_000_000, 250_000_000", "5_000_000_000, 5_000_000_000",
        "it takes fifteen seconds until a report is doubted",
    ),
    Change(
        "doubt-not-quicker", READBACK, "if self._against or self.doubtful:", "if False:",
        "it takes fifteen seconds until a report is doubted",
    ),
    Change(
        "no-old-low", READBACK, "low = min(self._low, self._old_low)", "low = self._low",
        "the lag of a healthy unit stops the stage",
    ),
    Change(
        "no-old-high", READBACK, "high = max(self._high, self._old_high)", "high = self._high",
        "the lag of a healthy unit stops the stage",
    ),
    Change(
        "tolerance-twice", READBACK, "self._old_low) - self.tolerance_v",
        "self._old_low) - 2.25 * self.tolerance_v", "an output 4 V too low counts as agreement",
    ),
    Change(
        "tolerance-twice-above", READBACK, "self._old_high) + self.tolerance_v",
        "self._old_high) + 2.25 * self.tolerance_v", "an output 4 V too high counts as agreement",
    ),
    Change(
        "agreement-adds-up", READBACK, "self._against, self._for = 0, self._for + 1",
        "self._for = self._for + 1", "occasional disagreeing reports accumulate to a doubt",
    ),
    Change(
        "doubt-adds-up", READBACK, "self._for, self._against = 0, self._against + 1",
        "self._against = self._against + 1", "a doubt ends although every third report disagrees",
    ),
    Change(
        "doubt-stays", READBACK, "        self.doubtful = False\n        self.reported_v = volts",
        '        self.doubtful = getattr(self, "doubtful", False)\n        self.reported_v = volts',
        "after a reconnection the stage stays in fault",
    ),
)  # fmt: skip
