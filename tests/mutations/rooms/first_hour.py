"""What somebody new meets: a start, a place, one late reply, a file from another editor."""

from tests.mutations.change import Change, room

CHANGES = [
    *room(
        ("tests/daemon/commands/test_unknown_arguments.py",),
        Change(
            "the-program-speaks-for-the-command",
            "daemon/main.py",
            "        if unknown:\n",
            "        if False:\n",
            "a misspelt option refers the user to the help of all commands",
        ),
        Change(
            "an-empty-folder-is-this-one",
            "daemon/main.py",
            "if empty := _find_empty(args):",
            'if empty := "":',
            "an unset variable of a script sets up the working directory",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_compiled_apart.py",),
        Change(
            "halves-of-other-types",
            "models/inverse/compiling.py",
            "preview.propose.compile((INVERSE, types.boolean))",
            "preview.propose.compile((INVERSE, types.int64))",
            "kernels that another process compiled are compiled again, which slows the first start",
        ),
        Change(
            "kernels-are-not-looked-for",
            "daemon/loop/compiled_apart.py",
            "if is_plan_cached():",
            "if False:",
            "every start of a loop starts a process for kernels that are already on disk",
        ),
    ),
    *room(
        ("tests/daemon/terminal/test_view.py",),
        Change(
            "a-start-is-no-state",
            "daemon/rings/status.py",
            's.period_ns <= 0 or (s.state == "start" and (s.core_alive or not s.samples))',
            "False",
            "status and watch divide by a period of 0 while the daemon starts",
        ),
        Change(
            "more-missed-than-due",
            "daemon/terminal/overview.py",
            "100.0 * min(1.0, part / max(1, whole))",
            "100.0 * part / max(1, whole)",
            "the status says that 170 % of the deadlines were missed",
        ),
    ),
    *room(
        ("tests/daemon/commands/test_starting.py",),
        Change(
            "the-place-is-not-in-the-status",
            "daemon/gateway/publisher.py",
            'measured=mean_reading(newest["measured"]),',
            "measured=math.nan,",
            "the status does not show the position of the stage",
        ),
        Change(
            "a-start-is-not-waited-for",
            "daemon/commands/send.py",
            "        stage.wait_until_started(on_wait=say)\n",
            "",
            "send is refused while the daemon starts",
        ),
        Change(
            "a-loop-that-compiles-has-ended",
            "daemon/gateway/publisher.py",
            "(alive or not core.starting)",
            "True",
            "a loop that compiles its kernels is reported to have ended",
        ),
    ),
    *room(
        ("tests/daemon/commands/test_first_hour.py",),
        Change(
            "one-late-reply-ends-the-start",
            "daemon/loop/process.py",
            "        for _ in range(ATTEMPTS - 1):\n",
            "        for _ in range(0):\n",
            "one late reply at the start ends the daemon",
        ),
        Change(
            "a-byte-order-mark-is-an-error",
            "daemon/input_file.py",
            'path.read_text("utf-8-sig")',
            'path.read_text("utf-8")',
            "a configuration saved by a Windows editor is refused at line 1",
        ),
    ),
    *room(
        ("tests/packaging/test_service_lines.py",),
        Change(
            "the-service-needs-folders",
            "README.md",
            "install -D -m 0644 systemd/dehyst.sysusers.conf /etc",
            "cp systemd/dehyst.sysusers.conf /etc",
            "the service has no user if /etc/sysusers.d does not exist",
        ),
        Change(
            "the-configuration-is-everybodys",
            "README.md",
            "install -D -m 0640 stage-1/stage.toml",
            "install -D -m 0644 stage-1/stage.toml",
            "every user of the machine can read the service's passwords",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_trim.py",),
        Change(
            "an-unknown-history-each-second",
            "daemon/loop/status.py",
            "        self._placed = True\n",
            "",
            "after a start the same event repeats every second and displaces all others",
        ),
    ),
    *room(
        ("tests/daemon/terminal/test_dumb.py",),
        Change(
            "a-dumb-terminal-is-drawn",
            "daemon/commands/watch.py",
            "    return console.is_terminal and known and not console.is_dumb_terminal\n",
            "    return console.is_terminal\n",
            "`dehyst watch` shows nothing with TERM=dumb",
        ),
    ),
    *room(
        ("tests/daemon/commands/test_check.py",),
        Change(
            "another-stages-model",
            "daemon/config/drives.py",
            "    if part >= SMALL_PART:\n",
            "    if True:\n",
            "a model of another stage is accepted without a warning",
        ),
        Change(
            "missing-somewhere",
            "daemon/config/file.py",
            "if model.exists() or not (Path(name).exists() or name in SHIPPED):",
            "if model.exists():",
            "a missing model is reported without the folder that was searched",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_process.py",),
        Change(
            "another-stages-reload",
            "daemon/loop/axes/core.py",
            "        said = [narrow] if narrow else []\n",
            "        said: list[str] = []\n",
            "a reload takes the model of another stage without a warning",
        ),
    ),
    *room(
        ("tests/daemon/commands/test_words_of_motion.py",),
        Change(
            "any-shift-is-usual",
            "daemon/commands/zero.py",
            "    if part <= USUAL_SHIFT:\n",
            "    if True:\n",
            "`dehyst zero` calls the shift that hides another stage's model usual",
        ),
        Change(
            "interrupted-exercise",
            "daemon/commands/zero.py",
            '            say(f"{of}stopped early, so the zero was not set; '
            'the stage {after_a_stop(config)}")\n',
            "",
            "Ctrl-C in `zero --exercise` says neither what was done nor what the stage does",
        ),
        Change(
            "interrupted-stay",
            "daemon/commands/send.py",
            "            say_end(stage, end_of(args, after_the_last))\n",
            "",
            "Ctrl-C in `send --for` does not say what the stage does",
        ),
        Change(
            "interrupted-play",
            "daemon/commands/play.py",
            "        with saying_when_interrupted(clients):\n",
            "        if True:\n",
            "Ctrl-C in `play` does not say what the stage does",
        ),
    ),
    *room(
        ("tests/daemon/client/test_repeated.py",),
        Change(
            "far-apart-as-given",
            "daemon/client/repeated.py",
            "if not np.any(parts > 1):",
            "if True:",
            "a trajectory with points far apart is refused by the daemon",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_trim.py",),
        Change(
            "a-number-without-a-unit",
            "daemon/loop/records_in_memory.py",
            'zero was moved by {:.6g} {unit}"',
            'zero was moved by {:.6g}"',
            "a line of the log leaves the unit of its number open",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_what_ends_a_trajectory.py",),
        Change(
            "a-chunk-is-all",
            "daemon/gateway/admission.py",
            "a chunk is refused, the trajectory in play goes on: {refused}",
            "the trajectory in play is refused: {refused}",
            "a refused chunk is reported as the end of a trajectory that goes on",
        ),
        Change(
            "taken-and-no-way-out",
            "daemon/client/client.py",
            '" with take_over() or --take-over"',
            '""',
            "a refusal does not say how to take over",
        ),
    ),
    *room(
        ("tests/daemon/test_native_words.py",),
        Change(
            "a-message-tells",
            "daemon/terminal/what_follows.py",
            'STAYS = "stays there until',
            'STAYS = "is told to stay there for so long until',
            "messages use words that are not used in the field",
        ),
    ),
]
