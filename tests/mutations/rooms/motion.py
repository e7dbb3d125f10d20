"""What moves the stage: the loop's step, its targets, and the supervisor."""

from tests.mutations.change import Change, room

STEP, COMMANDS = "daemon/loop/step_kernel.py", "daemon/loop/command_kernels.py"
TARGETS = "daemon/loop/targets.py"
MOTION = ("tests/daemon/loop/test_motion.py",)

STAYING = ("tests/daemon/loop/test_staying.py",)

CHANGES = [
    *room(
        MOTION,
        Change(
            "outside-is-driven-inside",
            STEP,
            "min(max(wanted, min(p.min_v, c.volts)), max(p.max_v, c.volts))",
            "min(max(wanted, p.min_v), p.max_v)",
            "an output that stands outside the limits moves at the slew limit without a command",
        ),
        Change(
            "glide-unflagged",
            STEP,
            "        _glide(c, p, result.predicted, window)\n        flags |= APPROACH\n",
            "        _glide(c, p, result.predicted, window)\n",
            "a model is withdrawn because of the approach after the loop had stalled",
        ),
    ),
    *room(
        STAYING,
        Change(
            "what-lasts-outlives-another-command",
            "daemon/loop/records_in_memory.py",
            "    c.glide, c.stays = 0.0, 0\n",
            "    c.glide = 0.0\n",
            "a lasting set-point survives a stop or fault",
        ),
        Change(
            "a-set-point-lasts-like-the-one-before",
            COMMANDS,
            "        c.stays = 1 if command.last != 0 else 0\n",
            "        c.stays = 1 if command.last != 0 else c.stays\n",
            "after one lasting set-point, every other one lasts too",
        ),
        Change(
            "a-hold-does-not-stop-the-ramp",
            COMMANDS,
            "c.since_ns, c.hold_ns, c.stays = now_ns, p.hold_ns, 1 if stays else 0",
            "c.hold_ns, c.stays = p.hold_ns, 0",
            "a hold during the ramp down is ignored",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_admission.py",),
        Change(
            "anybody-may-stay",
            "daemon/gateway/admission.py",
            "if stay and not self.may_stay:",
            "if False:",
            "a position is held without a client although the configuration forbids it",
        ),
    ),
    *room(
        MOTION,
        Change(
            "approach-from-zero",
            COMMANDS,
            "start = c.target + c.learned if known else _position(table, c, p)",
            "start = c.target + c.learned if known else 0.0",
            "the first set-point of a stage at a high voltage begins with a jump down",
        ),
        Change(
            "trajectory-from-zero",
            COMMANDS,
            "start = c.target + c.learned if moving else _position(table, c, p)",
            "start = c.target + c.learned if moving else 0.0",
            "the first trajectory of a stage at a high voltage begins with a jump down",
        ),
        Change(
            "no-approach",
            COMMANDS,
            "way_s = abs(value + correction - start)",
            "way_s = 0.0 * abs(value + correction - start)",
            "a set-point is approached at the slew limit",
        ),
        Change(
            "no-glide-after-a-stand-still",
            STEP,
            "        add_note(table, c, STOOD_STILL, still_ns * 1e-9)\n        c.glide = NAN\n",
            "        add_note(table, c, STOOD_STILL, still_ns * 1e-9)\n",
            "after a pause the stage jumps to the current target",
        ),
        Change(
            "no-glide-of-a-starved-stream",
            COMMANDS,
            "        c.glide = NAN  # time went on meanwhile; a group's time paused\n",
            "        pass\n",
            "a stream that resumes makes the stage jump",
        ),
        Change(
            "glide-that-gathers-speed",
            STEP,
            "samples = MOST_STEEP * abs(window[1] - stands) / p.glide_um",
            "samples = 0.1 * abs(window[1] - stands) / p.glide_um",
            "a long approach exceeds the ramp rate",
        ),
        Change(
            "no-glide-to-a-new-model",
            STEP,
            "    trim.forget_trim(trim_of(table))\n    c.glide = NAN\n",
            "    trim.forget_trim(trim_of(table))\n",
            "a new model makes the stage jump",
            tests=("tests/daemon/loop/test_step.py",),
        ),
        Change(
            "old-origin",
            STEP,
            "    p.origin = origin\n",
            "",
            "after a reload set-points count from the old model's origin",
        ),
        Change(
            "clear-of-any",
            COMMANDS,
            "if command.trajectory == queue_of(table).id:",
            "if True:",
            "a late clear of another trajectory stops the stage",
        ),
        Change(
            "clear-of-none",
            COMMANDS,
            "if command.trajectory == queue_of(table).id:",
            "if False:",
            "a withdrawn trajectory is played to its end",
        ),
        Change(
            "model-not-led",
            STEP,
            "    follow_output(table, volts)\n    ramps",
            "    c.volts = volts\n    ramps",
            "after a fault the model's state no longer matches the stage",
        ),
        Change(
            "first-step-whole",
            STEP,
            "* (FIRST_STEP if c.found != 0 else 1.0)",
            "* 1.0",
            "an error of the report is corrected faster than the slew limit",
        ),
        Change(
            "found-for-granted",
            STEP,
            "    c.found = 1\n",
            "",
            "after a fault an error of the report is corrected faster than the slew limit",
        ),
        Change(
            "report-written-back",
            "daemon/loop/sample.py",
            "(c.state == READY or c.found != 0)",
            "c.state == READY",
            "an axis that nobody commands is moved by the error of the amplifier's report",
            tests=(
                "tests/daemon/loop/test_slew_by_the_clock.py"
                "::test_a_reported_voltage_is_not_written_back",
            ),
        ),
        Change(
            "fault-keeps-targets",
            STEP,
            "    if happens(c, FAULT, now_ns):\n        drop_targets(c, queue_of(table))\n",
            "    happens(c, FAULT, now_ns)\n",
            "after a fault the old trajectory moves the stage",
        ),
        Change(
            "hold-before-ramp",
            STEP,
            "c.hold_ns = 0 if p.ramp_on_fault != 0 else p.hold_ns",
            "c.hold_ns = p.hold_ns",
            "after a fault the output stays high for the hold time",
        ),
        Change(
            "starved-clock",
            COMMANDS,
            "    if starved and c.starved == 0:\n        c.target_ns = now_ns\n",
            "    if starved and c.starved == 0:\n",
            "a stream that runs dry is abandoned at once",
        ),
        Change(
            "wild-values",
            COMMANDS,
            "if not abs(value) <= LARGEST_TARGET or not",
            "if False or not",
            "a wild value that passed the gate moves the stage",
        ),
        Change(
            "nan-to-the-output",
            STEP,
            "    if not math.isfinite(wanted):\n",
            "    if False:\n",
            "NaN goes to the amplifier",
        ),
        Change(
            "range-open",
            STEP,
            "volts = min(max(wanted, min(p.min_v, c.volts)), max(p.max_v, c.volts))",
            "volts = wanted",
            "a voltage beyond the limits is written",
        ),
        Change(
            "range-not-flagged",
            STEP,
            "    if volts != wanted or not p.min_v <= volts <= p.max_v:\n        flags |= RANGE\n",
            "",
            "a voltage is clipped silently",
        ),
        Change(
            "ramp-three-times",
            STEP,
            "return c.volts + min(max(p.safe_v - c.volts, -p.ramp_v), p.ramp_v)",
            "return c.volts + min(max(p.safe_v - c.volts, -3 * p.ramp_v), 3 * p.ramp_v)",
            "the ramp to the safe voltage is three times too fast",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_targets.py",),
        Change(
            "points-out-of-order",
            TARGETS,
            "if queue.count > 0 and at <= end_ns(queue, times):",
            "if False:",
            "targets jump back in time",
        ),
        Change(
            "behind-the-last",
            TARGETS,
            "if queue.count == times.size or queue.complete != 0:",
            "if queue.count == times.size:",
            "points are appended to a complete trajectory",
        ),
        Change(
            "queue-overrun",
            TARGETS,
            "if queue.count == times.size or queue.complete != 0:",
            "if queue.complete != 0:",
            "new points overwrite those being played",
        ),
        Change(
            "no-interpolation",
            TARGETS,
            "value += share * (points.values[after] - value)",
            "value += 0.0 * share",
            "the stage moves in steps",
        ),
        Change(
            "future-invented",
            TARGETS,
            "+ points.corrections[slot]\n            return i, target",
            "+ points.corrections[slot]\n            return out.size, target",
            "a stream that ends is treated like one at rest",
        ),
    ),
]
