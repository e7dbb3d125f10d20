"""What keeps a guided set-up from moving a stage further than it was reported, and `acquire` from
leaving its output or moving it in one step."""

from tests.mutations.change import Change, room

MOVING, STEPS = "daemon/setup/moving.py", "daemon/setup/steps.py"
BENCH = "daemon/setup/workbench.py"
OUTPUTS = "daemon/acquire/outputs.py"
UNDESIGNED = "test_a_drive_that_cannot_be_designed_is_refused_before_anything_moves"
TESTS = ("tests/daemon/setup/test_moving.py", "tests/daemon/setup/test_journal.py")

CHANGES = [
    *room(
        ("tests/daemon/setup/test_units.py",),
        Change(
            "asked-once",
            "daemon/setup/units.py",
            "ATTEMPTS = 2",
            "ATTEMPTS = 1",
            "a unit that is late for its first answer is said not to be there",
        ),
        Change(
            "a-late-gauge-ends-it",
            "daemon/setup/units.py",
            "        _open_patiently(device)",
            "        device.open()",
            "a set-up ends because the gauge of a controller was late once",
        ),
    ),
    *room(
        TESTS,
        Change(
            "full-range-at-once",
            MOVING,
            "gentle_shares: tuple[float, ...] = (0.1, 1.0)",
            "gentle_shares: tuple[float, ...] = (1.0, 1.0)",
            "a stage with the gauge of another stage is driven through its whole range",
        ),
        Change(
            "one-name-for-all",
            BENCH,
            "return self.wishes.name or usable_name(self.folder.resolve().name) or NAME",
            "return self.wishes.name or NAME",
            "two stages on one machine share the record of their units",
        ),
        Change(
            "any-gauge-will-do",
            MOVING,
            "if follows < TUNING.follows:",
            "if follows < 0.0:",
            "set-up continues with a gauge that is not on the stage",
        ),
        Change(
            "limits-beyond-the-unit",
            STEPS,
            "if not least <= low < high <= most:",
            "if not low < high:",
            "limits beyond the amplifier's own are accepted",
        ),
        Change(
            "voltage-for-granted",
            "daemon/setup/questions.py",
            "            if default is None:\n                what = ",
            "            if default is None:\n                return high\n                what = ",
            "without an answer of the user the amplifier's whole range is used for the stage",
        ),
        Change(
            "moves-unasked",
            "daemon/setup/sequence.py",
            "                bench.ask.go_on(step.name)\n",
            "",
            "a step moves the stage without the user's agreement",
        ),
    ),
    *room(
        ("tests/daemon/setup/test_folder.py",),
        Change(
            "numbers-unchecked",
            "daemon/commands/setup.py",
            "if value is not None and not 0.0 < value < float",
            "if value and not value < float",
            "--band 0 is ignored, and --band -1 is refused only when the stage has moved",
        ),
        Change(
            "ports-of-a-directory",
            "daemon/commands/setup.py",
            "return str(path.parent.resolve() / path.name)",
            "return port",
            "a stage that was set up with a relative path runs from one directory only",
        ),
        Change(
            "folder-shared",
            "daemon/commands/setup.py",
            'held.enter_context(locked(args.folder, "setup", "setup", args.folder, advice))',
            "pass",
            "a second set-up of a folder replaces the record and the bench of the first",
        ),
        Change(
            "bench-of-a-daemon",
            "daemon/commands/setup.py",
            'if is_served(folder / "control"):',
            "if False:",
            "a set-up is not refused clearly while a daemon uses the folder's bench",
        ),
        Change(
            "ports-taken-over",
            "drivers/emulated/control.py",
            "        if is_served(self._path):\n",
            "        if False:\n",
            "a second bench replaces the ports of a running one, and deletes them at its end",
        ),
        Change(
            "name-by-default",
            "daemon/setup/steps.py",
            "filter(None, (words, bench.name_in_words))",
            "(words,)",
            "a folder whose name no controller can have gives stage-1 without a word",
        ),
    ),
    *room(
        (f"tests/daemon/setup/test_moving.py::{UNDESIGNED}",),
        Change(
            "validation-drive-too-late",
            MOVING,
            "for seed in (0, FRESH):",
            "for seed in (0,):",
            "a set-up whose validation cannot be driven moves the stage for a minute first",
        ),
        Change(
            "band-too-late",
            MOVING,
            "    config = bench.config()\n    check_drives(config, bench.wishes)\n    now_v",
            "    config = bench.config()\n    now_v",
            "a band that the rate cannot follow is refused only when the stage has moved",
        ),
        Change(
            "band-of-axes-too-late",
            "daemon/setup/moving_axes.py",
            "        check_drives(config, bench.wishes)\n        now",
            "        now",
            "a band that the rate cannot follow is refused only when the axes have moved",
            (f"tests/daemon/setup/test_axes.py::{UNDESIGNED}",),
        ),
    ),
    *room(
        ("tests/daemon/setup/test_axes.py",),
        Change(
            "gauge-of-another-axis",
            "daemon/setup/moving_axes.py",
            "        owners[axis] = max(moved, key=lambda name: moved[name])\n",
            "        owners[axis] = axis\n",
            "an axis is driven through its whole range using the gauge of another axis",
        ),
        Change(
            "one-gauge-for-two",
            "daemon/setup/moving_axes.py",
            "    if twice:\n",
            "    if False:\n",
            "two axes that move the same gauge are accepted as having a gauge each",
        ),
        Change(
            "small-loops-of-all",
            "daemon/setup/moving_axes.py",
            "        volts[rows[k], k] = blocks[k]\n",
            "        volts[:, k] = np.resize(blocks[k], volts.shape[0])\n",
            "all axes move at once in the step that assigns the gauges",
        ),
    ),
    *room(
        ("tests/daemon/acquire/test_outputs.py",),
        Change(
            "hang-up-kills",
            "daemon/acquire/early_end.py",
            'NAMES = ("SIGINT", "SIGTERM", "SIGHUP")',
            'NAMES = ("SIGINT", "SIGTERM")',
            "a lost ssh during a recording leaves the stage at whatever voltage it has",
        ),
        Change(
            "catches-up-in-one-step",
            "daemon/acquire/one_axis.py",
            "        volts = [toward(*step) for step in zip(at, goals, most, strict=True)]\n",
            "        volts = goals\n",
            "after Ctrl-Z and fg the stage jumps by up to its whole range",
        ),
        Change(
            "late-reply-leaves-it-high",
            OUTPUTS,
            "if not (self.link.ok or self.link.came_back()):",
            "if not self.link.ok:",
            "one late reply of the amplifier leaves the stage at whatever voltage it has",
        ),
        Change(
            "left-without-a-word",
            OUTPUTS,
            '    raise DriverError("; ".join(said))\n',
            "",
            "an output that could not be returned is reported as returned",
        ),
        Change(
            "ramp-from-a-setting",
            OUTPUTS,
            " if device.spec.output_known else self.at_v",
            "",
            "the first write to an amplifier that reports no output is a jump",
        ),
        Change(
            "acquires-beside-a-daemon",
            "daemon/commands/acquire.py",
            'run_folder.OUTPUT, "acquire"',
            'run_folder.DOCTOR, "acquire"',
            "a recording and a running daemon drive the same output in turn",
        ),
    ),
    *room(
        ("tests/daemon/setup/test_moving.py",),
        Change(
            "sets-up-beside-a-daemon",
            BENCH,
            'run_folder.OUTPUT, "setup"',
            'run_folder.DOCTOR, "setup"',
            "a set-up and a running daemon drive the same output in turn",
        ),
    ),
]
