"""What is offered, and what becomes of an accepted model."""

from tests.mutations.change import Change, room

TRIAL, GAUGE = (f"models/mismatch/{name}.py" for name in ("trial", "gauge"))
REPLAY, LEAD, NAMING = (f"models/change/{name}.py" for name in ("replay", "lead", "naming"))
PURE = ("tests/models/mismatch/test_trial.py", "tests/models/change")
DESK, WORK = "daemon/gateway/doctor_desk.py", "daemon/gateway/model_trial.py"
CHOSEN, EXAMINATION = "daemon/files/chosen.py", "daemon/doctor/examination.py"

CHANGES = [
    *room(
        PURE,
        Change(
            "offer-within-noise", REPLAY,
            "return self.in_use**2 - self.offered**2 > self.noise**2",
            "return self.in_use > self.offered",
            "a model is offered that is only better by chance",
        ),
        Change(
            "lead-counts", LEAD, "np.where(_before(recording, first), np.nan, y)", "np.array(y)",
            "behaviour from before a change is attributed to the change",
        ),
        Change(
            "blocks-in-any-order", "models/physics/registry.py",
            "tuple(sorted([*before, *model.blocks, *behind], key=rank))",
            "(*model.blocks, *before, *behind)",
            "a lag of the amplifier is compensated as a lag after the stage",
        ),
        Change(
            "trial-any-error", TRIAL, "if not after.model <= most:", "if False:",
            "a model whose error has not fallen remains in use",
        ),
        Change(
            "trial-nan-stays", TRIAL, "    if not math.isfinite(after.model):\n",
            "    if False:\n", "a model without any evidence is judged",
        ),
        Change(
            "trial-any-tracking", TRIAL,
            "after.tracking > TRIAL.grown * other * before.tracking + noise\n", "False\n",
            "a model that worsens tracking remains in use",
        ),
        Change(
            "trial-no-help", TRIAL,
            "after.tracking > TRIAL.fallen * other * before.tracking\n", "False\n",
            "a model that does not help remains in use",
        ),
        Change(
            "trial-little-motion", TRIAL, "    if known < least:\n", "    if False:\n",
            "a motion without information decides a trial",
        ),
        Change(
            "trial-other-motion", TRIAL,
            "or other > TRIAL.alike:", "or False:",
            "a good model is withdrawn because the stage has moved in steps since",
        ),
        Change(
            "trial-settled-against", TRIAL, "if after.seconds >= TRIAL.least_s:", "if False:",
            "a model with evidence against it stays when its time is up",
        ),
        Change(
            "trial-held-readings", TRIAL, "np.count_nonzero(s.good | s.held)",
            "np.count_nonzero(s.good)",
            "with a slow gauge a trial takes many times the motion it needs",
        ),
        Change(
            "zero-jumps", REPLAY, "        c[0] += shift / gain\n", "        c[0] += 0.0\n",
            "an accepted model moves the stage by micrometres",
        ),
        Change(
            "chance-ranks", NAMING, "if of_it >= best - noise2 else -of_it",
            "if False else -of_it",
            "the one of two equally good causes that was better by chance is named",
        ),
        Change(
            "gauge-compensated", NAMING,
            'if o.new > 0.0 and o.cause.place != "sensor"]', "if o.new > 0.0]",
            "a slow gauge is compensated by moving the stage",
        ),
        Change(
            "gauge-at-once", NAMING,
            "return not elsewhere or max(elsewhere) < max(here, default=0.0) - noise2",
            "return True",
            "a lag of the amplifier is blamed on the gauge",
        ),
        Change(
            "tie-by-chance", NAMING,
            "least = max((o.new + noise2 for o in named), default=0.0)", "least = 0.0",
            "a model of another name is offered because it was better by chance",
        ),
        Change(
            "gauge-by-its-name", NAMING,
            "elsewhere = [one.new for one in _of_names(first, causes) if",
            "elsewhere = [one.new for one in causes if one.cause.name == first.name and",
            "a delay that cannot be distinguished from a lag of the gauge gets no model",
        ),
        Change(
            "one-change-any", NAMING,
            "return best if _explains_most(best, left) else None", "return best",
            "a partial explanation is named as the only cause",
        ),
        Change(
            "little-is-first", NAMING,
            "least = max(least, WEAK * max(new.values(), default=0.0))", "least = least",
            "a lag that was always there is reported as the change, together with friction",
        ),
        Change(
            "left-at-the-gauge", NAMING,
            "if one.place != \"sensor\" or not elsewhere:", "if True:",
            "a lag that may be the amplifier's is placed at the gauge and not compensated",
        ),
        Change(
            "left-at-the-gauge-beside-another", NAMING,
            "or not elsewhere:", "or not elsewhere or is_of_sensor(one, causes, noise2):",
            "with a delay, a lag is left at the gauge, and the stage stays behind by it",
        ),
        Change(
            "moved-from-the-model-in-use", NAMING,
            "[b for b in model.blocks if b not in in_use.blocks]", "model.blocks",
            "a lag that the owner's model has at the gauge moves the stage after an offer",
        ),
        Change(
            "moved-to-what-looks-like-it", NAMING,
            "(c.place for c in causes if any(b.kind == kind for b in c.model.blocks))",
            "(c.place for c in causes)",
            "the amplifier's lag acts at the stage, as it looks like a rate-dependence",
        ),
        Change(
            "richer-than-needed", NAMING,
            "if leaves_nothing_new(first, causes, left):", "if False:",
            "a lag that explains all that is new is reported as a rate-dependence",
        ),
        Change(
            "looks-alike-unnamed", NAMING,
            "cause.name in first.ambiguous_with or first.name in cause.confused_with",
            "cause.name in first.ambiguous_with",
            "friction is reported as the asymmetry that a refitted loop shows",
        ),
        Change(
            "confusion-one-way", "models/change/causes.py",
            "with_blocks(model, blocks), alike)", "with_blocks(model, blocks), one.confused_with)",
            "friction is reported as loops that change with the rate",
            tests=(
                "tests/models/change/test_causes.py"
                "::test_friction_that_a_diagnosis_takes_for_what_follows_the_rate_is_named",
            ),
        ),
        Change(
            "one-change-over-a-tie", NAMING,
            "if best.new <= _explained_by(first, causes) + noise2:", "if False:",
            "the one of two equally good causes that was better by chance is named",
        ),
        Change(
            "gauge-stuck-unseen", GAUGE, "if share > GAUGE.same:", "if False:",
            "a model is offered for a stuck gauge",
        ),
        Change(
            "gauge-far-unseen", GAUGE, "if share > GAUGE.beyond_rows:", "if False:",
            "a model is offered for a gauge with meaningless readings",
        ),
    ),
    *room(
        ("tests/daemon/doctor/test_story.py",),
        Change(
            "silence-unseen", "daemon/gateway/mismatch.py", "silent = self._silent_s >= SILENT_S",
            "silent = False", "a gauge without readings is reported as healthy",
        ),
        Change(
            "drift-modelled", GAUGE,
            "if straight <= as_good and now.rms > GAUGE.line * straight:", "if False:",
            "a drifting zero is reported as a change of the loop's shape",
        ),
        Change(
            "offset-modelled", GAUGE,
            "if now.rms <= as_good and abs(moved) > GAUGE.zero * as_good:", "if False:",
            "a shifted zero is reported as a change of the loop's shape",
        ),
    ),
    *room(
        ("tests/daemon/report/test_every_picture.py", "tests/daemon/doctor/test_ends.py"),
        Change(
            "picture-kills-report", "daemon/report/plotting.py",
            "    except Exception as error:  # any failure",
            "    except KeyError as error:  # any failure",
            "a picture that cannot be drawn discards the findings of its report",
        ),
        Change(
            "log-of-nothing", "daemon/report/plotting.py",
            "if np.isfinite(data.minposx):", "if True:",
            "a picture with nothing above 0 on a logarithmic axis is not drawn",
        ),
        Change(
            "end-is-memory", "daemon/doctor/child.py",
            "    except MemoryError:", "    except (MemoryError, ValueError, AssertionError):",
            "an examination that crashes is reported as needing more memory",
        ),
        Change(
            "starved-is-slow", "daemon/doctor/process.py",
            "if spent_s > STARVED * time_s:", "if spent_s > time_s:",
            "on a busy machine the doctor abandons every case",
        ),
        Change(
            "report-loses-findings", "daemon/doctor/examination.py",
            "(ArithmeticError, LookupError, TypeError, ValueError, MemoryError)", "KeyError",
            "a report that cannot be written discards the findings",
        ),
    ),
    *room(
        ("tests/daemon/demo/test_busy.py",),
        Change(
            "success-is-busy", "daemon/demo/second_act.py",
            'return "" if self.named_right and self.helped else self.busy.why',
            "return self.busy.why",
            "a success on a busy machine is not judged",
        ),
        Change(
            "busy-is-failure", "daemon/demo/second_act.py",
            "        if self.too_busy:\n", "        if False:\n",
            "a doctor that gets no processor time looks like one that finds nothing",
        ),
        Change(
            "failure-is-busy", "daemon/demo/busy.py",
            "own = max(0, last.own - first.own) / total",
            "own = 0.0",
            "the demo's own work makes the machine too busy to judge it",
        ),
        Change(
            "no-patience", "daemon/demo/busy.py",
            "self._left_s -= seconds / busy.stretch", "self._left_s -= seconds",
            "a doctor on a busy machine is abandoned too early",
        ),
    ),
    *room(
        ("tests/daemon/report/test_every_picture.py",),
        Change(
            "first-seconds-of-all", "daemon/report/tracking.py",
            "xlim=(begin, begin + 2.0)", "xlim=(0, 2)",
            "the picture of the set-up's last step shows an empty frame",
        ),
        Change(
            "line-beyond-data", "daemon/report/story.py",
            "not story.t_s[0] <= at_s <= story.t_s[-1]", "not story.t_s[0] <= at_s",
            "a trial without an effect is drawn as a line outside the data",
        ),
        Change(
            "axis-of-a-jump", "daemon/report/story.py",
            "min(max(least, _size_of_most(error[one.part])), most)",
            "float(np.nanmax(np.abs(error)))",
            "one late sample makes the bands too thin to be seen",
        ),
        Change(
            "axis-by-rms-alone", "daemon/report/story.py",
            "min(max(least, _size_of_most(error[one.part])), most)",
            "least",
            "the largest errors of the changed stage are cut off by the frame",
        ),
        Change(
            "close-look-across-lost-samples", "daemon/report/story.py",
            "story.t_s[k + count - 1] - story.t_s[k] < longest_s", "True",
            "a straight line is shown where samples were lost, and no second before the effect",
        ),
        Change(
            "any-second", "daemon/report/story.py",
            "    if not far[best] <= apart:\n        return None\n", "",
            "before and after are shown at different phases of the pattern",
        ),
    ),
    *room(
        ("tests/daemon/terminal/test_compiling.py",),
        Change(
            "compiles-silently", "daemon/terminal/compiling.py",
            "            if self._of.at_work:\n", "            if not self._of.at_work:\n",
            "a kernel that takes long to compile looks like a start that has hung",
        ),
        Change(
            "compiling-floods", "daemon/terminal/compiling.py",
            'end="\\r", file', "file",
            "a start without kernels prints a line to the terminal every second",
        ),
    ),
    *room(
        ("tests/daemon/files/test_chosen.py",),
        Change(
            "accepted-over-owner", CHOSEN,
            "if accepted.instead_of != model_digest(dumps(configured)):", "if False:",
            "a model that the owner has configured is ignored",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_trial_ends.py",),
        Change(
            "trial-without-preview", WORK,
            "USELESS = Flag.SENSOR_INVALID | Flag.SENSOR_HELD | Flag.WRITE_FAILED",
            "USELESS = Flag.SENSOR_INVALID | Flag.SENSOR_HELD | Flag.WRITE_FAILED | Flag.FALLBACK",
            "a trial under set-points without preview sees no data until its time is over",
        ),
        Change(
            "trial-without-end", WORK, "late = now_ns >= self._end_ns", "late = False",
            "a stage at rest keeps a trial open forever",
        ),
        Change(
            "trial-begins-anew", WORK,
            "        if accepted.begun_wall_ns:", "        if False:",
            "a gateway that restarts prolongs the trial",
        ),
        Change(
            "trial-judged-early", WORK,
            'if verdict.outcome == "goes" and not late and not self._doubt:', "if False:",
            "a good model is withdrawn for an error that is only transient after the switch",
        ),
        Change(
            "trial-blind-end", WORK, "verdict = settle_trial(*judged, self.limit_s)",
            'verdict = Verdict("stays", "unconfirmed")',
            "a model that was seen to be worse stays because few data were seen",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_trial_motion.py",),
        Change(
            "before-with-a-past", "daemon/gateway/previous_model.py",
            "model, _ = split_off_one_recording(model)", "pass",
            "the previous model is judged with a drift that the loop has not run",
        ),
        Change(
            "trial-other-samples", WORK,
            "other = before.expect(samples) if before is not None else",
            "other = before.expect(samples) if False else",
            "a good model is withdrawn because the stage moves less than before the switch",
        ),
        Change(
            "trial-other-model", WORK,
            "        self._taken = False  # what it runs now is not judged\n", "",
            "a model is judged by the errors of another one",
        ),
        Change(
            "before-not-led", "daemon/gateway/previous_model.py",
            "self._past(end - LED_SAMPLES, end)", "self._past(end - 1, end)",
            "the previous model is compared in a state that it never had",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_doctor_desk.py",),
        Change(
            "offer-waits-for-ever", DESK, "        elif name := self._waiting:",
            "        elif name := str():",
            "an offer that waits for the end of a trial is never used",
        ),
        Change(
            "all-wait", DESK, "        if before and before != name and before in self._known:",
            "        if False:", "an offer that a newer one replaced is shown as waiting forever",
        ),
        Change(
            "no-way-back", WORK, 'if verdict.outcome == "goes":\n            return',
            "if False:\n            return",
            "a wrong model remains in use after its acceptance",
        ),
        Change(
            "back-without-reload", WORK,
            "                forget_accepted(self._config.directory)\n            self._reload()",
            "                forget_accepted(self._config.directory)",
            "the loop continues with the wrong model",
        ),
        Change(
            "accept-twice", DESK, "        if state not in OPEN:\n            return",
            "        if False:\n            return", "a rejected offer is used",
        ),
    ),
    *room(
        ("tests/daemon/doctor/test_examination.py",),
        Change(
            "gauge-diagnosed", EXAMINATION, "    if fault:\n", "    if False:\n",
            "a failing gauge becomes a model",
        ),
        Change(
            "a-past-is-offered", EXAMINATION,
            "to_run, blocks = split_off_one_recording(one)", "to_run, blocks = one, ()",
            "the offered model goes on with the creep of a move before the recording",
        ),
        Change(
            "memory-unknown", EXAMINATION, "    flagged, good = blank_lead(whole, lead_s),",
            "    flagged, good = drop_lead(whole, lead_s),",
            "creep is mistaken for a change of the loop's shape, so no model is offered",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_security.py",),
        Change(
            "observers-command", "daemon/bus/security.py",
            'QUESTIONS = ("status", ', 'QUESTIONS = ("command", "status", ',
            "an observer can command the stage and accept models",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_case_keeper.py",),
        Change(
            "flagged-stretch-is-good", "daemon/gateway/case_keeper.py",
            " or 0 < self._good_from > seq + 1 - count:", ":",
            "the doctor says of a new effect that it is not new",
        ),
        Change(
            "just-before-the-flag-is-good", "daemon/gateway/case_keeper.py",
            'return [s for s in self._good if s.size and int(s["seq"][-1]) <= before]',
            "return list(self._good)",
            "what has begun shortly before its flag is taken for good",
        ),
    ),
]  # fmt: skip
