"""Several axes on one amplifier: what they do together, and the unit that they share."""

from tests.mutations.change import Change, room

GROUPS, KERNELS = "daemon/loop/axes/groups.py", "daemon/loop/axes/kernels.py"
UNIT, TOGETHER = "drivers/mdt693b/unit.py", "drivers/mdt693b/together.py"
CONTROLLER, CHECKS = "daemon/config/controller.py", "daemon/loop/checks.py"

CHANGES = [
    *room(
        ("tests/daemon/loop/axes/test_groups.py",),
        Change(
            "others-go-on",
            GROUPS,
            "        if _is_left(axes, q.group):\n",
            "        if False:\n",
            "after one axis has faulted the others continue along the path",
        ),
        Change(
            "fault-is-no-leaving",
            GROUPS,
            "playing = c.state == RUNNING and q.group == c.group",
            "playing = True",
            "an axis that was released or faulted counts as playing",
        ),
        Change(
            "started-before-all-are-there",
            GROUPS,
            "if there >= wanted and arrived == there:",
            "if arrived > 0:",
            "one axis starts while the others are still approaching",
        ),
        Change(
            "time-goes-on-for-the-others",
            GROUPS,
            "            q.shift_ns += beyond_ns\n",
            "            q.shift_ns += beyond_ns if q.complete == 0 else 0\n",
            "while one axis has no points another one continues along its path",
        ),
        Change(
            "waits-for-ever",
            GROUPS,
            "            q.dry = targets.OTHER if there < wanted else 0\n",
            "            q.dry = 0\n",
            "an axis whose group never arrives waits forever",
        ),
        Change(
            "late-points-start-again",
            "daemon/loop/command_kernels.py",
            "if group != 0 and group == c.left:",
            "if False:",
            "late points of a broken trajectory move the stage again",
        ),
    ),
    *room(
        ("tests/daemon/loop/axes/test_coupling.py",),
        Change(
            "target-of-now",
            KERNELS,
            "return targets.queued_target(q, points_of(table), now_ns + p.period_ns)",
            "return targets.queued_target(q, points_of(table), now_ns)",
            "the other axis' displacement is compensated one sample late",
        ),
        Change(
            "zero-of-the-other-axis",
            KERNELS,
            "    return c.target + p.origin\n",
            "    return c.target\n",
            "the other axis' displacement lacks its origin, so the coupling has an offset",
        ),
        Change(
            "drives-in-the-files-order",
            KERNELS,
            "        if not waits:\n",
            "        if True:\n",
            "the other axis' drive is compensated one sample late",
        ),
        Change(
            "target-that-nobody-follows",
            KERNELS,
            "if c.state != RUNNING or held_back != 0 or c.glide != 0.0:",
            "if False:",
            "an axis that ramps to its safe voltage acts on the others at its former target",
        ),
    ),
    *room(
        ("tests/drivers/mdt693b/test_together.py",),
        Change(
            "lost-for-one",
            UNIT,
            "        if self.shared and not self.lost:\n",
            "        if False:\n",
            "after an unanswered set the next axis' set is sent over the same link",
        ),
        Change(
            "output-driven-twice",
            UNIT,
            "if self._outputs.setdefault(config.axis, output) is not output:",
            "if False:",
            "two axes drive the same output",
        ),
        Change(
            "all-three-in-the-order-of-the-loop",
            TOGETHER,
            "self._order = [outputs.index(output) for output in self._outputs]",
            "self._order = list(range(len(outputs)))",
            "the voltages of one command go to the wrong axes",
        ),
        Change(
            "rate-of-one-for-all",
            TOGETHER,
            "self._measure(reads[:n], clock) for n in",
            "self._measure(reads[:1], clock) for n in",
            "the unit is asked for more sets than it can sustain",
        ),
    ),
    *room(
        ("tests/daemon/config/test_controller.py",),
        Change(
            "same-output-twice",
            CONTROLLER,
            "if (mine.driver, mine.settings) == (theirs.driver, theirs.settings):",
            "if False:",
            "two axes with the same amplifier output are accepted",
        ),
    ),
    *room(
        ("tests/daemon/loop/axes/test_rates.py",),
        Change(
            "rate-of-fewest",
            CHECKS,
            "return min(range(1, len(places) + 1), key=joint.rate_hz)",
            "return 1",
            "the loop runs faster than the amplifier with all its axes driven",
        ),
        Change(
            "typical-calls-fill-the-period",
            "drivers/interface.py",
            "return max(self.late_s, self.latency_s)",
            "return self.latency_s",
            "the loop is offered a rate at which every late reply misses a deadline",
        ),
        Change(
            "report-always-fits",
            CHECKS,
            "if io_s - sensor.call_s + actuator.call_s > REPORT_SPARE * period_s",
            "if False",
            "every query of the amplifier's report costs a deadline",
        ),
    ),
    *room(
        ("tests/daemon/loop/axes/test_reports.py",),
        Change(
            "report-beside-sets",
            "daemon/loop/python_loop.py",
            "numbers[DOUBTFUL] |= ASKED",
            "numbers[DOUBTFUL] |= 0",
            "every query of the amplifier's report costs a deadline",
        ),
    ),
    *room(
        ("tests/daemon/loop/axes/test_reported_model.py",),
        Change(
            "reach-before-its-model",
            "daemon/loop/axes/core.py",
            "        digest = self._reported.digest\n        try:",
            "        digest = self._reported.digest\n"
            "        self._reported = self._reported_model(model, digest)\n        try:",
            "a client briefly reads the reach of the new model together with the old model",
        ),
        Change(
            "runs-a-recordings-past",
            "daemon/loop/axes/core.py",
            "self.model, self._left_out = split_off_one_recording(model)",
            "self.model, self._left_out = model, ()",
            "the stage is expected to creep from a move before some recording at every start",
        ),
        Change(
            "reloads-a-recordings-past",
            "daemon/loop/axes/core.py",
            "model, left_out = split_off_one_recording(chosen)",
            "model, left_out = chosen, ()",
            "after a reload the stage is expected to creep from a move before some recording",
        ),
    ),
    *room(
        ("tests/drivers/test_call_times.py",),
        Change(
            "late-replies-do-not-count",
            "drivers/call_times.py",
            "late: float = 95.0",
            "late: float = 50.0",
            "a rate is offered that the unit does not sustain",
        ),
    ),
]
