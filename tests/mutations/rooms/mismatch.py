"""The thresholds of the watch."""

from tests.mutations.change import Change, room

TUNING, MONITOR = "models/mismatch/tuning.py", "models/mismatch/monitor.py"


def _tuning(name: str, old: str, new: str, does: str) -> Change:
    return Change(name, TUNING, old, new, does)


CHANGES = room(
    ("tests/models/mismatch/test_thresholds.py",),
    _tuning("learns-40-s", "learn_s: int = 400", "learn_s: int = 40",
            "false flags are raised in the first minutes"),
    _tuning("scatter-at-once", "settled_s: int = 100", "settled_s: int = 5",
            "thresholds are raised by the misfit of the first seconds"),
    _tuning("delay-1-s", "delay_s: int = 12", "delay_s: int = 1",
            "a slow change raises its own threshold"),
    _tuning("fit-400", "fit: float = 40.0", "fit: float = 400.0",
            "a different stage is not noticed while the monitor learns"),
    _tuning("fit-4", "fit: float = 40.0", "fit: float = 10.0",
            "a model that fits a little worse is flagged at once"),
    _tuning("margin-1", "margin: float = 1.3", "margin: float = 1.0", "false flags are raised"),
    _tuning("margin-3", "margin: float = 1.3", "margin: float = 3.0", "changes are not noticed"),
    _tuning("clear-2", "clear: float = 0.9", "clear: float = 0.2", "the flag does not end"),
    _tuning("blocks-rare", "return_blocks: float = 2e3", "return_blocks: float = 2e1",
            "a false flag is raised every hour"),
    _tuning("block-5-s", "block_s: int = 20", "block_s: int = 5", "thresholds are too low"),
    _tuning("few-0", "few: float = 4.0", "few: float = 0.0",
            "false flags are raised while few blocks were seen"),
    _tuning("spread-0.5", "least_spread: float = 0.05", "least_spread: float = 0.5",
            "thresholds are too high"),
    _tuning("stuck-10-s", "stuck_s: float = 1.0", "stuck_s: float = 10.0",
            "a dead sensor is reported after ten seconds"),
    _tuning("stuck-anywhere", "stuck_move: float = 10.0", "stuck_move: float = 0.1",
            "a stage at rest counts as a dead sensor"),
    _tuning("motion-at-rest", "motion: float = 0.002", "motion: float = 0.0",
            "rest counts as motion, and the monitor learns nothing useful"),
    _tuning("motion-large", "motion: float = 0.002", "motion: float = 0.02",
            "a stage that moves little is never watched"),
    *(
        _tuning(f"least-{name}", f'"{name}": {value}', f'"{name}": {3 * value:g}',
                f"changes of {name} are noticed at three times the size")
        for name, value in (
            ("gain", 0.7), ("offset", 2.1), ("whole", 1.6), ("all", 2.5), ("ringing", 1.6),
            ("short", 1.9),
        )
    ),
    Change("never-a-flag", MONITOR, "if health > 1.0 or newest > TUNING.sudden:", "if False:",
           "no mismatch is ever noticed"),
    Change("flag-at-2", MONITOR, "if health > 1.0 or newest", "if health > 2.0 or newest",
           "changes are noticed at twice the size"),
    Change("flag-while-learning", MONITOR, "(dict.fromkeys(now, math.inf) if self.learning else "
           "now)", "now", "false flags are raised while the monitor learns",
           survives="thresholds are infinite until the first blocks are complete"),
    Change("first-third-counts", MONITOR, "found = found[found.size // 3 :]", "pass",
           "thresholds are raised by the misfit of the first minutes"),
    Change("lifted-by-its-own-flag", MONITOR, "                level.forget_newest()\n",
           "                level.see(self.figures[name])\n",
           "a lasting change becomes the baseline"),
    Change("fit-with-offset", MONITOR, 's["raw2"] / count - (s["raw"] / count) ** 2',
           's["raw2"] / count', "a shifted zero counts as a misfit of the model"),
)  # fmt: skip
CHANGES += room(
    ("tests/models/mismatch/test_monitor.py",),
    _tuning("past-is-misfit", "farther: float = 0.01", "farther: float = 10.0",
            "a stage that was moved before the loop began is reported as a different one"),
    Change("knows-at-once", MONITOR, "if self.learning and not self.mismatch else", "if False else",
           "health is reported for a stage that has not been learned yet"),
)  # fmt: skip
