"""Where a gauge is used: the trim's walls, and what is learned from a pass."""

from tests.mutations.change import Change, room

TRIM, PASSES = "models/learning/trim.py", "models/learning/passes.py"
TUNING, GAPS = "models/learning/tuning.py", "models/learning/gaps.py"
STEP, COMMANDS = "daemon/loop/step_kernel.py", "daemon/loop/command_kernels.py"
GATE = "daemon/gateway/admission.py"
IN_THE_LOOP = ("tests/daemon/loop/test_trim.py",)
ALONE = ("tests/models/learning/test_trim.py",)
LEARNED = ("tests/models/learning/test_passes.py",)
PLAYED = ("tests/daemon/client/test_repeated.py",)

CHANGES = [
    *room(
        ALONE,
        Change(
            "trim-without-limit",
            TRIM,
            "goal = min(max(predicted - reading, -p.limit), p.limit)",
            "goal = predicted - reading",
            "a wrong gauge moves the stage as far as it likes",
        ),
        Change(
            "trim-without-rate",
            TRIM,
            "s.trim += min(max(s.aim - s.trim, -most), most)",
            "s.trim = s.aim",
            "the trim jumps",
        ),
        Change(
            "trim-of-the-wrong-sign",
            TRIM,
            "min(max(predicted - reading,",
            "min(max(reading - predicted,",
            "the trim runs to its limit",
        ),
        Change(
            "trim-while-nobody-commands",
            TRIM,
            "elif not running and why == NOTHING:",
            "elif False:",
            "the trim moves while nobody commands, and the next motion begins with a jump",
        ),
        Change(
            "trim-by-a-stuck-gauge",
            TRIM,
            "        s.stuck = 1\n",
            "        s.stuck = 0\n",
            "a dead gauge moves the stage to the trim's limit",
        ),
        Change(
            "stuck-is-not-taken-back",
            TRIM,
            "s.aim = s.aim_then  #",
            "s.aim = s.trim  #",
            "what a dead gauge has moved stays",
        ),
        Change(
            "trim-follows-a-jump",
            TRIM,
            "            s.jumped = 1\n",
            "            s.jumped = 0\n",
            "a gauge that jumps takes the stage with it",
        ),
        Change(
            "a-jump-for-ever",
            TRIM,
            "        if s.in_s >= TUNING.back_s:\n            s.jumped = 0",
            "        if s.in_s >= TUNING.back_s:\n            s.jumped = s.jumped",
            "after one jump the stage is never trimmed again",
        ),
        Change(
            "glitches-count",
            TRIM,
            "if why == NOTHING and s.out_s == 0.0:",
            "if why == NOTHING:",
            "wild readings move the stage before they are known for what they are",
        ),
        Change(
            "trim-beyond-belief",
            TRIM,
            "beyond = abs(difference) > p.belief",
            "beyond = False",
            "a gauge that is somewhere else altogether is followed",
        ),
        Change(
            "distrust-is-ignored",
            TRIM,
            "elif s.distrusted != 0 and why == NOTHING:",
            "elif False:",
            "the watch's word on the gauge changes nothing",
        ),
        Change(
            "lag-of-the-stage-counts",
            TRIM,
            'if block.place != "sensor":',
            'if block.place == "nowhere":',
            "a stage with a lag cannot be trimmed",
        ),
        Change(
            "no-motion-allowance",
            TRIM,
            "jump_share: float = 0.15",
            "jump_share: float = 0.0",
            "a model with a wrong gain freezes the trim whenever the stage moves",
        ),
    ),
    *room(
        IN_THE_LOOP,
        Change(
            "trim-forgotten-in-the-position",
            COMMANDS,
            "predicted - p.origin - trim_of(table).trim",
            "predicted - p.origin",
            "a stage that held begins its next motion with a jump by the trim",
        ),
        Change(
            "old-trim-with-a-new-model",
            STEP,
            "    trim.forget(trim_of(table))\n",
            "",
            "another model is trimmed by what was wrong with the old one",
        ),
        Change(
            "correction-without-bound",
            COMMANDS,
            "if not abs(correction) <= most:",
            "if False:",
            "a client's correction moves the stage anywhere",
        ),
        Change(
            "correction-in-the-target",
            "daemon/loop/targets.py",
            "            target, correction = value, more",
            "            target, correction = value + more, more",
            "tracking errors are those of another target",
        ),
        Change(
            "correction-stays",
            STEP,
            "        c.learned -= min(max(c.learned, -fade), fade)",
            "        c.learned -= 0.0 * fade",
            "what was learned for one trajectory moves the set-points after it",
        ),
        Change(
            "correction-drops-at-once",
            STEP,
            "        c.learned -= min(max(c.learned, -fade), fade)",
            "        c.learned = 0.0 * fade",
            "the stage jumps when a learned trajectory is over",
        ),
        Change(
            "trust-only-while-commanded",
            COMMANDS,
            "    if kind == TRUST:",
            "    if kind == TRUST and takes(c, TARGET):",
            "a gauge is trusted again, or not, only in some states",
            survives="states that take no target take no trim; after them it is told anew",
        ),
        Change(
            "frozen-without-a-flag",
            STEP,
            "return TRIM_FROZEN if frozen else 0",
            "return 0",
            "nobody sees in the telemetry that the trim stands still",
        ),
        Change(
            "too-fast-for-the-gauge",
            "daemon/loop/trim.py",
            "chosen_s < least_s:",
            "chosen_s < 0.0:",
            "a time constant is taken with which the stage oscillates",
        ),
    ),
    *room(
        LEARNED,
        Change(
            "learned-with-the-wrong-sign",
            PASSES,
            "self._back(-self.weights * self._repeats)",
            "self._back(self.weights * self._repeats)",
            "every pass makes it worse",
        ),
        Change(
            "correction-unbounded",
            PASSES,
            "return x if most <= self.bound else x * (self.bound / most)",
            "return x",
            "a wild pass is learned in full",
        ),
        Change(
            "noise-is-learned",
            TUNING,
            "subtract: float = 3.0",
            "subtract: float = 0.0",
            "the gauge's noise comes into the motion",
        ),
        Change(
            "knocks-are-learned",
            PASSES,
            "if abs(smooth[at]) <= allowed:",
            "if True:",
            "somebody who touches the table is part of the motion for many passes",
        ),
        Change(
            "gaps-are-learned",
            GAPS,
            "    if lost <= max(1.0, TUNING.missing * valid.size)",
            "    if lost < valid.size or lost <= max(1.0, TUNING.missing * valid.size)",
            "what is missing in a pass is invented",
        ),
        Change(
            "first-pass-counts",
            PASSES,
            "        if self.passes == 1:\n",
            "        if self.passes == 0:\n",
            "the way to a scan is learned as a part of it",
        ),
        Change(
            "growth-is-not-noticed",
            PASSES,
            "        self._grown += 1\n",
            "        self._grown += 0\n        at_once = False\n",
            "an error that grows goes on growing",
        ),
        Change(
            "gain-never-falls",
            TUNING,
            "falls: float = 0.35",
            "falls: float = 0.0",
            "the last pass' noise is in every correction",
        ),
        Change(
            "changed-stage-is-a-knock",
            TUNING,
            "same: float = 0.5",
            "same: float = 0.0",
            "a stage that has changed is never learned again",
        ),
    ),
    *room(
        PLAYED,
        Change(
            "no-fade",
            PASSES,
            "return np.asarray(share * share * (3.0 - 2.0 * share), np.float64)",
            "return np.asarray(share > 0.0, np.float64)",
            "a new correction comes with a step",
        ),
        Change(
            "missed-samples-count",
            "daemon/client/learning.py",
            "UNUSABLE = Flag.SENSOR_INVALID | Flag.MISSED",
            "UNUSABLE = Flag.SENSOR_INVALID",
            "readings that came late are learned from",
        ),
        Change(
            "any-model-will-do",
            "daemon/files/learned.py",
            '("another model", model, found.model),',
            '("another model", model, model),',
            "what was learned with another model is taken up",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_admission.py",),
        Change(
            "zero-anywhere",
            GATE,
            "if abs(command.value) > high - low:",
            "if False:",
            "the gauge's zero is moved by more than the stage's whole reach",
        ),
        Change(
            "nan-correction-passes",
            GATE,
            "if not np.all(np.isfinite(learned)):",
            "if False:",
            "a correction that is no number reaches the loop",
        ),
    ),
]
