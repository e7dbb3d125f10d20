"""The walls that keep the output safe: states, slew, life of the processes, locks, neighbours."""

from tests.mutations.change import Change, room

LIFE, STATES = "daemon/service/life.py", "daemon/loop/states.py"
HEARTBEAT, SUPERVISOR = "daemon/service/heartbeat.py", "daemon/service/supervisor.py"
STEP = "daemon/loop/step_kernel.py"
FOLDER, SAMPLE = "daemon/rings/run_folder.py", "daemon/loop/sample.py"
GATE = "daemon/gateway/admission.py"
NUMPY_FILE = "daemon/files/foreign/containers/numpy_file.py"
SESSION, RECORDINGS = "daemon/bus/session.py", "daemon/files/loading.py"
RUNS, HOSTILE = "tests/daemon/service/test_supervisor.py", "tests/daemon/bus/test_hostile.py"
TWO, BOUNDS = "tests/daemon/service/test_two_daemons.py", "tests/daemon/files/test_bounds.py"

CHANGES = [
    *room(
        ("tests/daemon/files/test_trusted_cases.py",),
        Change(
            "planted-case", "daemon/files/cases.py",
            "    if reason := why_not_trusted(directory):", "    if reason := \"\":",
            "a case that another user placed in the watch directory is processed",
        ),
    ),
    *room(
        ("tests/daemon/service/test_safe_state.py",),
        Change(
            "safe-notes-nothing", "daemon/service/safe_state.py",
            "        note_output(self.config, self.volts)\n", "        pass\n",
            "after `dehyst safe` an output without readback jumps back to where the loop died",
        ),
        Change(
            "safe-notes-only-the-end", "daemon/service/safe_state.py",
            "                self.note()\n", "                pass\n",
            "after a `dehyst safe` that was killed an output without readback jumps",
        ),
        Change(
            "a-failed-write-counts", "daemon/service/safe_state.py",
            "volts = self.volts + math.copysign(",
            "volts = self.volts = self.volts + math.copysign(",
            "after a write that failed `dehyst safe` makes two steps at once",
        ),
        Change(
            "pin-keeps-the-note", "daemon/service/pin.py", "for name in (LAST, LEFT):",
            "for name in (LAST,):", "the output of one unit is taken for that of another",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_past_output.py",),
        Change(
            "old-note-wins", "daemon/loop/checks.py",
            "newest = head == 0 or place == (run, head)", "newest = True",
            "an output without readback jumps to where an earlier `dehyst safe` left it",
        ),
    ),
    *room(
        ("tests/daemon/loop/axes/test_interrupted_start.py",),
        Change(
            "start-forgets-the-output", "daemon/loop/axes/core.py",
            "        note_output(config, float(self._past[-1]))",
            "        pass",
            "a start that is interrupted as it compiles lets the next one jump",
        ),
    ),
    *room(
        ("tests/daemon/service/test_exchanged_units.py",),
        Change(
            "safe-moves-anyone", "daemon/service/safe_state.py",
            "            expect_known(config, ACTUATOR, actuator)\n", "            pass\n",
            "`dehyst safe` ramps another user's stage",
        ),
        Change(
            "start-takes-anyone", "daemon/files/known_units.py",
            "        device.expect(known)\n", "        pass\n",
            "the first start drives whatever unit is at the port",
        ),
        Change(
            "blank-is-anyone", "drivers/interface.py",
            "return self != known if not (self.serial and known.serial) else ",
            "return ", "a unit without a serial number passes for any other without one",
        ),
    ),
    *room(
        ("tests/daemon/rings/test_damage.py",),
        Change(
            "any-count-believed", "daemon/rings/layout.py",
            "return int(word) if 0 <= word <= MOST_WRITTEN else 0", "return int(word)",
            "a head of 2^63 - 1 ends the supervisor",
        ),
    ),
    *room(
        ("tests/daemon/service/test_lost_folder.py",),
        Change(
            "lost-folder-kills", "daemon/rings/ring_file.py",
            "        except OSError:\n            return False",
            "        except OSError:\n            return True",
            "a healthy loop is killed because its run folder was deleted",
        ),
    ),
    *room(
        ("tests/daemon/service/test_bad_logs.py",),
        Change(
            "supervisor-writes-its-log-itself", "daemon/main.py",
            "        log_lines.keep_going(command)\n", "",
            "a suspended terminal stops supervisor, loop and safe state",
        ),
    ),
    *room(
        ("tests/daemon/service/test_damaged_rings.py",),
        Change(
            "damaged-ring-stays", "daemon/loop/status.py",
            "                    self.stepper.events.append(f\"{name}.ring was damaged;",
            "                    [].append(f\"{name}.ring was damaged;",
            "an overwritten ring is repaired without a message",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_random_life.py",),
        Change(
            "give-up-by-anybody", GATE,
            "        self._check_lease(now_ns, client, command.lease)\n"
            "        lease.keep_alive(now_ns)\n",
            "",
            "anybody who may command can end the lease of the client that moves the stage",
        ),
    ),
    *room(
        ("tests/daemon/test_log_lines.py",),
        Change(
            "log-waits", "daemon/log_lines.py", "if self._bytes + len(data) > MOST_BYTES:",
            "while self._bytes + len(data) > MOST_BYTES:\n                self._change.wait()\n"
            "            if False:",
            "a log that nobody reads stops supervisor and safe state",
        ),
        Change(
            "log-counts-nothing", "daemon/log_lines.py", "        self._unsaid += lines\n", "",
            "lines are missing from the log without a notice",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_states.py",),
        Change(
            "end-taken-back", STATES,
            "stopping  x        x        x        x        x        x        x        x        -",
            "stopping  running  x        x        x        x        x        x        x        -",
            "a set-point that arrives while the daemon ends keeps the output high",
        ),
        Change(
            "fault-takes-targets", STATES,
            "fault     x        -        x        x        x        -        holding  ready",
            "fault     running  -        x        x        x        -        holding  ready",
            "set-points are followed although the amplifier contradicts them",
        ),
        Change(
            "stop-not-taken", STATES,
            "running   -        holding  holding  holding  x        fault    x",
            "running   -        -        holding  holding  x        fault    x",
            "a stop does not stop the stage",
        ),
        Change(
            "stale-not-taken", STATES,
            "running   -        holding  holding  holding  x        fault    x",
            "running   -        holding  holding  -        x        fault    x",
            "a stage whose client has gone stays at a high voltage forever",
        ),
        Change(
            "release-in-ready", STATES, "ready     running  -        holding",
            "ready     running  -        -      ",
            "a stage that was released stays at a high voltage",
        ),
        Change(
            "suspended-time-counts", STEP,
            "c.stop_left_ns -= min(max(now_ns - c.stop_seen_ns, 0), PAUSE_NS)",
            "c.stop_left_ns -= now_ns - c.stop_seen_ns",
            "a loop that was suspended as the daemon ended leaves the output high",
        ),
        Change(
            "stop-in-fault-forgotten", "daemon/loop/command_kernels.py",
            "        c.stop_kept = 1\n", "",
            "a stop during a fault leaves the output high when the device is back",
        ),
        Change(
            "stop-kept-for-the-next-fault", STEP, "    c.stop_kept = 0\n", "",
            "after a later fault the output ramps although safe.on_fault = hold",
        ),
        Change(
            "end-without-a-voltage", STEP, "        add_note(table, c, ENDED, c.volts)\n", "",
            "the log does not say at which voltage the daemon has left the output",
        ),
        Change(
            "hold-on-fault-ramps", STATES,
            "fault     x        -        x        x        x        -        holding  ready",
            "fault     x        -        x        x        x        -        holding  holding",
            "a fault ramps the output although safe.on_fault = hold",
        ),
    ),
    *room(
        ("tests/daemon/service/test_stops.py",),
        Change(
            "stop-in-fault-promises", "daemon/commands/send.py",
            '    if status.state == "fault":\n', "    if False:\n",
            "`send --stop` promises a ramp while nothing can be written",
        ),
        Change(
            "stop-at-rest-promises", "daemon/commands/send.py",
            'if status.state == "ready" and', "if False and",
            "`send --stop` promises a ramp of an output that stays where it is",
        ),
        Change(
            "end-names-no-voltage", SUPERVISOR,
            'f"ending: {self._of_axes(at_the_end)}"', '"ending"',
            "the log does not say what the output does as the daemon ends",
        ),
        Change(
            "death-promises-a-ramp", "daemon/terminal/what_follows.py",
            'if config.safe.on_fault == "hold":', "if False:",
            "the log promises a safe output that `dehyst safe` leaves high",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_silent_loop.py",),
        Change(
            "a-dead-loop-runs-on", "daemon/gateway/publisher.py",
            "(silent_ns < SILENT_NS and not self._rings.is_stopped)", "silent_ns < SILENT_NS",
            "for seconds `dehyst status` reports a loop that was killed as running",
        ),
        Change(
            "suspended-is-running", "daemon/gateway/core_rings.py",
            "return has_ended(pid) or is_suspended(pid)", "return has_ended(pid)",
            "for seconds `dehyst status` reports a loop that was suspended as running",
        ),
        Change(
            "no-reading-for-a-second", "daemon/gateway/publisher.py",
            'if not math.isfinite(record["differs"]):', "if False:",
            "after a start a gauge that works is reported to give no reading",
        ),
    ),
    *room(
        ("tests/daemon/commands/test_words.py",),
        Change(
            "an-early-end-is-a-failure", SUPERVISOR,
            "elif self.life is Life.ENDING and code == -signal.SIGTERM:", "elif False:",
            "Ctrl-C a second after the start ends with exit status 1",
        ),
    ),
    *room(
        ("tests/daemon/service/test_requests.py",),
        Change(
            "a-lost-exit-stays-lost", "daemon/service/requests.py",
            "            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)\n", "            pass\n",
            "a compiling loop continues for a minute after SIGTERM",
        ),
        Change(
            "one-bad-reload-is-the-last", "daemon/service/requests.py",
            "            except Exception:  # the next request is served all the same\n",
            "            except SystemExit:\n",
            "after a reload that failed unexpectedly SIGHUP is ignored without a message",
        ),
        Change(
            "swallowed-end-runs-on", "daemon/service/requests.py",
            "        if self._ended:\n            raise SystemExit(NOT_MOVED)\n        thread",
            "        thread", "a core that was asked to end while compiling drives the stage",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_device_link.py",),
        Change(
            "odd-error-ends-reconnection", "daemon/loop/devices.py", "except Exception as error:",
            "except DriverError as error:",
            "a device whose driver raises an unusual error never reconnects",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_ramp.py",),
        Change(
            "safe-three-times", "daemon/loop/devices.py", "    step = rate_v_per_s * period_s\n",
            "    step = 3.0 * rate_v_per_s * period_s\n", "`safe` ramps three times too fast",
        ),
        Change(
            "safe-stops-short", "daemon/loop/devices.py", "while volts != goal:",
            "while abs(volts - goal) > 1.0:",
            "`dehyst safe` ends a volt away from the safe voltage",
        ),
    ),
    *room(
        ("tests/daemon/loop/test_slew_by_the_clock.py",),
        Change(
            "slew-by-the-grid", SAMPLE, "c.move_ns = min(max(since_ns, 0), p.period_ns)",
            "c.move_ns = p.period_ns", "late samples are caught up by steps above the slew limit",
        ),
        Change(
            "slew-from-the-begin", SAMPLE,
            "c.wrote_ns = written_ns - (_least_delay_ns(c.least_ns) if c.writes > ENOUGH else 0)",
            "c.wrote_ns = written_ns - call_ns",
            "a long call before a short one allows two steps within a few milliseconds",
        ),
        Change(
            "slew-over-a-fault", SAMPLE, "        c.wrote_ns, c.move_ns = clock_ns, 0\n", "",
            "a late command of a unit is followed at once by another step",
        ),
    ),
    *room(
        ("tests/daemon/service/test_life.py",),
        Change(
            "dead-core-left-high", LIFE, "beating   -        saving   saving   saving   saving",
            "beating   -        saving   waiting  saving   saving",
            "a killed core is restarted from any output voltage",
        ),
        Change(
            "hang-left-high", LIFE, "beating   -        saving   saving   saving   saving",
            "beating   -        waiting  saving   saving   saving",
            "a hung core is restarted from any output voltage",
        ),
        Change(
            "unsafe-starts", LIFE,
            "unsafe    -        -        -        -        -        -        -        saving ",
            "unsafe    -        -        -        -        -        -        -        starting",
            "a core is started although the output could not be made safe",
        ),
        Change(
            "killed-end-is-the-end", LIFE, "ending    -        last     last     last     over",
            "ending    -        over     last     last     over",
            "a shutdown that hangs leaves the output high",
        ),
        Change(
            "end-forgotten", LIFE,
            "-        -        -        -        -        -        starting  over",
            "-        -        -        -        -        -        starting  -",
            "a daemon that was asked to end starts again",
        ),
    ),
    *room(
        ("tests/daemon/service/test_heartbeat.py",),
        Change(
            "hang-not-seen", HEARTBEAT,
            "return self.still_s > (self.limit_s if self.moves else START_S)",
            "return self.still_s > START_S", "a hanging core keeps the output high for minutes",
        ),
        Change(
            "start-is-a-hang", HEARTBEAT,
            "return self.still_s > (self.limit_s if self.moves else START_S)",
            "return self.still_s > self.limit_s", "a core is killed while it compiles its kernels",
        ),
        Change(
            "another-ones-ring", HEARTBEAT, "if self._ring.pid != self._pid:", "if False:",
            "the new core is judged by the ring of the previous run",
        ),
        Change(
            "machine-stood-still", HEARTBEAT,
            "passed_s = min((now_ns - self._looked_ns) * 1e-9, LONGEST_LOOK_S)",
            "passed_s = (now_ns - self._looked_ns) * 1e-9",
            "a suspend of the machine kills all its cores",
        ),
        Change(
            "nothing-to-take", HEARTBEAT, "passed_s if wrote and tail != head else 0.0",
            "passed_s", "a gateway without a core is killed as hanging",
        ),
    ),
    *room(
        (RUNS,),
        Change(
            "no-back-off", SUPERVISOR, "min(2 * self.pause_s, LONGEST_PAUSE_S)", "FIRST_PAUSE_S",
            "a process that cannot start is restarted twice a second forever",
            tests=(f"{RUNS}::test_a_gateway_without_its_port_is_said_and_the_daemon_is_not_ready",),
        ),
        Change(
            "ready-without-clients", SUPERVISOR,
            "if not self._ready and self._heartbeat.gateway_moves and", "if not self._ready and",
            "the daemon reports ready although no client can connect",
            tests=(f"{RUNS}::test_a_gateway_without_its_port_is_said_and_the_daemon_is_not_ready",),
        ),
        Change(
            "full-disk-leaves-its-rest", "daemon/rings/ring.py",
            "            fresh.unlink(missing_ok=True)\n            raise NotNow(",
            "            raise NotNow(",
            "files left over from a full disk at the start keep the disk full",
            tests=(
                f"{RUNS}::test_a_full_disk_at_the_start_is_said_and_it_comes_when_there_is_room",
            ),
        ),
        Change(
            "ramp-cut", SUPERVISOR, "return self.controller.longest_ramp_s + SPARE_S",
            "return SPARE_S", "a slow ramp is interrupted half-way",
            tests=(f"{RUNS}::test_a_long_ramp_is_waited_for",),
        ),
        Change(
            "forced-end-is-0", SUPERVISOR, "                self.code = 1\n",
            "                self.code = 0\n", "a forced end looks like a requested one",
            tests=(
                f"{RUNS}::test_a_core_that_dies_while_it_ramps_leaves_the_output_safe_and_not_0",
            ),
        ),
        Change(
            "old-events", "daemon/service/event_log.py", "if self._ring.pid != pid or", "if",
            "events of the previous run are reported as those of this one",
            tests=(f"{RUNS}::test_events_carry_their_time_and_belong_to_their_run",),
        ),
        Change(
            "reload-lost-in-a-start", SUPERVISOR,
            "if self._reload_asked and self.life is Life.BEATING:", "if self._reload_asked:",
            "a reload asked for while the core starts is forgotten",
            tests=(f"{RUNS}::test_sighup_while_the_core_starts_reloads_once_it_runs",),
        ),
    ),
    *room(
        ("tests/daemon/rings/test_run_folder.py",),
        Change(
            "folder-of-anybody", FOLDER, "    if found.st_uid != system.user_id():\n        return",
            "    if False:\n        return", "the rings are placed in another user's folder",
        ),
        Change(
            "folder-open", FOLDER, "    if system.others_may(found):",
            "    if False:", "anybody can place files where the loop reads them",
        ),
        Change(
            "folder-link", FOLDER, "    if not stat.S_ISDIR(found.st_mode):", "    if False:",
            "a link instead of the folder redirects the daemon",
        ),
    ),
    *room(
        (TWO,),
        Change(
            "no-run-folder-lock", FOLDER, "fcntl.LOCK_EX | fcntl.LOCK_NB",
            "fcntl.LOCK_SH | fcntl.LOCK_NB", "two daemons with the same name move each "
                                             "other's stages",
        ),
        Change(
            "no-port-lock", "drivers/serial_port.py", "exclusive=True", "exclusive=False",
            "two daemons write to one amplifier",
            tests=(f"{TWO}::test_one_port_two_run_folders",),
        ),
    ),
    *room(
        ("tests/drivers/emulated/test_pty_device.py",),
        Change(
            "late-blames-unit", "drivers/serial_port.py",
            "sent = self._send(left) if self._select_writable(wait_s) else 0",
            "sent = self._send(left) if wait_s and self._select_writable(wait_s) else 0",
            "a process that was held up says that the unit hangs",
        ),
        Change(
            "closed-port-writes", "drivers/serial_port.py", "        self._fd = CLOSED",
            "        pass",
            "a command to a port that was closed goes into the file opened next",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_units_of_the_run.py",),
        Change(
            "unit-of-the-run-before", "daemon/gateway/publisher.py",
            "        self._admission.unit = self.unit\n",
            "        self._admission.unit = self._admission.unit or self.unit\n",
            "set-points in the unit of an earlier model are accepted, off by a factor of 1000",
        ),
    ),
    *room(
        (HOSTILE,),
        Change(
            "slow-subscriber-kept", SESSION, "        end_unread_connections(UNREAD_MS)\n", "",
            "a few subscribers that do not read block everybody",
            tests=("tests/daemon/bus/test_session.py",),
        ),
        Change(
            "slow-subscriber-waited-for", SESSION, "wait_before_drop\": 1000,",
            "wait_before_drop\": 2_000_000,", "each congested link delays all others for seconds",
            tests=(
                f"{HOSTILE}::test_subscribers_that_read_slowly_lose_batches_and_delay_nobody_else",
            ),
        ),
        Change(
            "idle-lock-out", SESSION, "\"transport/unicast/accept_pending\": MOST_UNKNOWN,",
            "\"transport/unicast/accept_pending\": 100,",
            "a few hundred silent connections lock out every new client",
            tests=(f"{HOSTILE}::test_idle_connections_keep_no_new_client_out",),
        ),
    ),
    *room(
        (BOUNDS,),
        Change(
            "npz-bomb", NUMPY_FILE, "        if size > MOST_BYTES:", "        if False:",
            "a file of 3 MB needs 5 GB of memory",
        ),
        Change(
            "pipe-read", RECORDINGS, "    if not path.is_file():", "    if False:",
            "a command waits forever for a pipe",
        ),
        Change(
            "huge-numbers", "models/toml_text.py",
            "    elif isinstance(value, int | float) and abs(value) > LARGEST:", "    elif False:",
            "a model that contains 1e300 causes a traceback",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_foreign_text.py",),
        Change(
            "escapes-pass", "daemon/printable.py", "c if c.isprintable() else", "c if c else",
            "a client's label controls the terminal of anybody who watches",
        ),
        Change(
            "odd-token-locks-out", "daemon/client/finding.py",
            "        except BadInput as error:\n            if key not in known:",
            "        except KeyError as error:\n            if key not in known:",
            "one liveliness token with unusual characters locks every client out",
        ),
    ),
    Change(
        "planted-kernel", "daemon/kernel_cache.py",
        "elif stat.S_ISLNK(found.st_mode) or system.others_may(found):", "elif False:",
        "anybody who can write to the cache can run code in the process that controls the devices",
        tests=("tests/daemon/test_kernel_cache.py",),
    ),
    Change(
        "schema-not-named", "daemon/bus/encoding.py",
        "if isinstance(plain, dict) and not", "if False and not",
        "an empty map is read as a request for the whole history",
        tests=("tests/daemon/bus/test_encoding.py",),
    ),
    Change(
        "interrupt-loses-all", "daemon/commands/acquire.py",
        "return \"it was interrupted\" if stopped else \"\"", "return \"\"",
        "Ctrl-C during a recording of an hour has no effect",
        tests=("tests/daemon/commands/test_interrupted.py",),
    ),
    Change(
        "input-by-another-name", "daemon/files/outputs.py", "            if _same(path, other):\n",
        "            if path == other:\n", "an input file is replaced by its own output",
        tests=("tests/daemon/commands/test_outputs.py",),
    ),
    *room(
        ("tests/daemon/terminal/test_compiling.py",),
        Change(
            "idle-thread-wakes", "daemon/terminal/compiling.py",
            "        while self._of.began.wait() and not self._stop.wait(TICK_S):\n",
            "        while not self._stop.wait(TICK_S):\n",
            "a thread of ordinary priority takes the interpreter from the loop every second",
        ),
    ),
]  # fmt: skip
