"""What the gate lets through to the loop, and who may command."""

from tests.mutations.change import Change, room

GATE, LEASE = "daemon/gateway/admission.py", "daemon/gateway/lease.py"
PROGRESS = "daemon/gateway/trajectory.py"
PLAYER, ACCEPT = "daemon/client/player.py", "daemon/client/offer_change.py"
VIEW, IN_PLAY = "daemon/gateway/core_view.py", "daemon/gateway/in_play.py"
TESTS = (
    "tests/daemon/gateway/test_admission.py",
    "tests/daemon/gateway/test_what_ends_a_trajectory.py",
    "tests/daemon/gateway/test_in_play.py",
)

CHANGES = room(
    TESTS,
    Change(
        "late-chunk-taken", GATE,
        "        self._check_lease(now_ns, command.client, command.lease)\n"
        "        self._check_age(now_ns, command.sent_ns)\n        now = ",
        "        self._check_lease(now_ns, command.client, command.lease)\n        now = ",
        "a chunk that was delayed for seconds moves the stage",
    ),
    Change(
        "any-wrong-time-is-out-of-order", PROGRESS,
        '                "offset",\n', '                "order",\n',
        "a client whose points are in order is refused for their order",
    ),
    Change(
        "a-stream-undoes-a-stop", GATE,
        "        if self._stopped_by_another:", "        if False:",
        "a program that streams moves the stage again after another has stopped it",
    ),
    Change(
        "older-stream-undoes-its-own-stop", GATE,
        "sent_ns < self._stop_sent_ns:", "False:",
        "set-points that were sent before a client's own stop move the stage again after it",
    ),
    Change(
        "retried-zero-moves-twice", GATE,
        "        if again:  # sent", "        if False:  # sent",
        "a zero that is sent again because its answer was lost moves the gauge's zero twice",
    ),
    Change(
        "future-renewal-taken", GATE,
        "self._check_age(now_ns, command.sent_ns, however_old=", "dict(however_old=",
        "after one wrong time stamp every command of the client is refused as late",
    ),
    Change(
        "finished-number-plays-nothing", GATE,
        'now.over in ("", COMPLETE):', "not now.over:",
        "a trajectory under the number of a finished one is acknowledged and not played",
    ),
    Change(
        "release-is-said-in-a-fault", GATE,
        'if action == "release" and self.core.state is State.FAULT:', "if False:",
        "a release while a device has failed is said to ramp, and the voltage stays",
    ),
    Change(
        "late-setpoint-taken", GATE,
        "        self._check_age(now_ns, command.sent_ns)\n        self._check_values(",
        "        self._check_values(",
        "a set-point that was delayed for seconds moves the stage",
    ),
    Change(
        "future-command-taken", GATE, "if age_s < -AHEAD_S:", "if age_s < -1e9:",
        "a command with an absurd time stamp is accepted",
    ),
    Change(
        "setpoint-leaves-trajectory", GATE,
        '        self._end_trajectory("a set-point replaced it")\n', "",
        "chunks of a trajectory that a set-point has ended move the stage again",
    ),
    Change(
        "clear-leaves-trajectory", GATE,
        '                self._end_trajectory("its client withdrew it")', "                pass",
        "a trajectory that its client withdrew continues with the next chunk",
    ),
    Change(
        "clear-of-any-trajectory", GATE,
        "if command.trajectory == self._trajectory.number:", "if True:",
        "a clear of an old trajectory ends the one being played",
    ),
    Change(
        "clear-without-lease", GATE,
        "        self._check_lease(now_ns, client, command.lease)\n        lease.keep",
        "        lease.keep", "anybody can clear the holder's trajectory",
    ),
    Change(
        "loop-says-nothing", GATE,
        "if trajectory == self._trajectory.number and not running:", "if False:",
        "a trajectory that ran dry is resumed in its middle",
    ),
    Change(
        "loop-says-of-any", GATE,
        "if trajectory == self._trajectory.number and not running:", "if not running:",
        "the end of an old trajectory ends the new one",
    ),
    Change(
        "resume-forgets-complete", PROGRESS,
        'over=COMPLETE if point["last"] else "",', 'over="",',
        "a new gateway appends to a trajectory that was complete",
    ),
    Change(
        "resume-forgets-place", PROGRESS, 'end_ns=int(point["offset_ns"]),', "end_ns=-1,",
        "a new gateway sends the same points again",
    ),
    Change(
        "complete-not-over", PROGRESS, 'self.over = COMPLETE if command.last else ""',
        'self.over = ""', "points are appended after the last one",
    ),
    Change(
        "take-over-leaves-trajectory", GATE,
        '            self._end_trajectory("another client took over")', "            pass",
        "after two take-overs an old trajectory continues",
    ),
    Change(
        "stop-leaves-trajectory", GATE, '            self._end_trajectory("it was stopped")\n', "",
        "a stopped stage continues to move with the next chunk",
    ),
    Change(
        "stop-needs-lease", GATE,
        '        if action in ("stop", "release"):  # needs the right to command, but no lease\n',
        '        if action in ("stop", "release"):\n'
        "            self._check_lease(now_ns, client, command.lease)\n",
        "only the holder of the lease can stop the stage",
    ),
    Change(
        "release-is-stop", GATE,
        'LoopCommand.STOP_MOTION if action == "stop" else LoopCommand.RELEASE',
        "LoopCommand.STOP_MOTION",
        "a release has to wait for the hold time",
    ),
    Change(
        "model-ends-a-scan", IN_PLAY, "float(np.fmin(self.low, reach[0]))", "reach[0]",
        "a change of model ends the trajectory being played",
    ),
    Change(
        "admission-forgotten", GATE, "            self.keep(self.begun)\n        self._trajectory",
        "        self._trajectory",
        "a restarted gateway refuses what the previous one had admitted",
    ),
    Change(
        "reach-of-another", GATE, "return (self.begun.trajectory, self.begun.client) ==",
        "return True or (self.begun.trajectory, self.begun.client) ==",
        "a new trajectory is admitted by the reach of the previous one",
    ),
    Change(
        "beyond-not-reported", GATE, 'self.report(2, "trajectory", text)', "pass",
        "a scan is cut off at the new reach without a notice",
    ),
    Change(
        "state-not-looked-at", VIEW,
        "if self.state in (State.FAULT, State.STOPPING):",
        "if self.state in (State.STOPPING,):",
        "set-points are accepted while a device has failed",
    ),
    Change(
        "dead-loop-accepts", VIEW, "if not self.alive:", "if False:",
        "commands are reported as accepted although no loop runs",
    ),
    Change(
        "no-room-for-a-stop", VIEW, "RESERVED * (records > 1)", "0",
        "a full ring keeps a stop away from the loop",
    ),
    Change(
        "lease-not-checked", GATE, "if self.lease.check(now_ns, client, lease):", "if True:",
        "anybody can command the stage",
    ),
    Change(
        "sequence-repeats", GATE, "if command.sequence <= self.lease.sequence:",
        "if command.sequence < self.lease.sequence:", "a replayed set-point is accepted again",
    ),
    Change(
        "sequence-not-kept", GATE, "        self.lease.sequence = command.sequence\n", "",
        "older set-points overtake newer ones",
    ),
    Change(
        "nan-passes", GATE, "if not np.all(np.isfinite(values)):", "if False:",
        "NaN reaches the loop",
    ),
    Change(
        "infinity-passes", GATE, "np.all(np.isfinite(values))", "not np.any(np.isnan(values))",
        "an infinite target reaches the loop if unreachable targets are allowed",
    ),
    Change(
        "any-unit", GATE, "if unit != self.unit:", "if False:",
        "nanometres are driven as micrometres",
    ),
    Change(
        "low-end-open", IN_PLAY, "if not least >= low - REACH_SLACK:",
        "if least != least:", "targets below the range are accepted",
    ),
    Change(
        "high-end-open", IN_PLAY, "if most <= high + REACH_SLACK else most", "",
        "targets above the range are accepted",
    ),
    Change(
        "times-may-stand", PROGRESS, "np.any(offsets[1:] <= offsets[:-1])",
        "np.any(offsets[1:] < offsets[:-1])", "two targets at the same time cause a jump",
    ),
    Change(
        "negative-times", PROGRESS, "if offsets[0] < 0 or ", "if ",
        "a chunk reaches back before its trajectory's start",
    ),
    Change(
        "chunks-overlap", PROGRESS, "elif self.end_ns >= 0 and offsets[0] <= self.end_ns:",
        "elif False:", "a chunk that begins before the last one ended is sent to the loop",
    ),
    Change(
        "chunks-with-a-gap", PROGRESS,
        "if self.next_index >= 0 and command.index != self.next_index:", "if False:",
        "a lost chunk is bridged by a straight line",
    ),
    Change(
        "duplicate-played", PROGRESS, "0 <= command.index < self.next_index", "False",
        "a chunk whose reply was lost causes an error, or is played twice",
    ),
    Change(
        "stopped-duplicate", PROGRESS, 'passed_on and self.over in ("", COMPLETE)', "passed_on",
        "a client that repeats a chunk after a stop believes that it is being played",
    ),
    Change(
        "dense-points", PROGRESS, "if span_ns < CLOSEST * gaps", "if span_ns < 0.0 * gaps",
        "points closer together than the period fill the queue",
    ),
    Change(
        "queue-without-end", PROGRESS, "if ahead_s + span_s > self.most_s:", "if False:",
        "minutes of trajectory are queued and cannot be withdrawn in time",
    ),
    Change(
        "queue-forgets-passed", PROGRESS, "+ sum(s for _, s in self._passed)", "",
        "more trajectory than configured is queued ahead of the loop",
    ),
    Change(
        "others-trajectory", PROGRESS,
        "return (self.number, self.client) == (command.trajectory, command.client)",
        "return self.number == command.trajectory", "another client's chunks continue a trajectory",
    ),
    Change(
        "drift-a-thousand-times", LEASE, "CLOCK_DRIFT = 1e-3", "CLOCK_DRIFT = 1.0",
        "after some seconds a command of any age counts as fresh",
    ),
    Change(
        "no-drift", LEASE, "CLOCK_DRIFT = 1e-3", "CLOCK_DRIFT = 0.0",
        "after hours every command of a client with a slow clock is refused as late",
    ),
    Change(
        "lease-never-ends", LEASE, "now_ns - self._seen_ns <= self.length_ns", "True",
        "a client that has disconnected keeps the stage",
    ),
    Change(
        "lease-number-ignored", LEASE, "and client == self.client and lease == self.lease",
        "and client == self.client", "commands recorded under an earlier lease are accepted",
    ),
    Change(
        "acquire-takes-over", GATE,
        'if command.action == "take-over" or not lease.is_held(now_ns):', "if True:",
        "a second client takes the stage without asking for it",
    ),
    Change(
        "sequence-starts-high", LEASE, "        self.sequence = -1\n        self._seen_ns = self",
        "        self._seen_ns = self", "after a new lease every set-point is refused as old",
    ),
    Change(
        "give-up-keeps", LEASE, "self.client = self.lease = 0\n        self.label",
        "self.label", "a lease that was given up still excludes others",
    ),
    Change(
        "late-loses-lease", LEASE, "        self._seen_ns = now_ns\n\n    def age_ns",
        "        return\n\n    def age_ns", "on a slow link another client obtains the lease",
    ),
    Change(
        "player-takes-every-no-as-final", PLAYER, "waits = code in CODES and CODES[code].waits",
        'waits = code == "queue-full"',
        "a starting loop, or a slow network, ends a scan that runs overnight",
        tests=("tests/daemon/client/test_playing_on.py",),
    ),
    Change(
        "player-waits-for-ever", PLAYER,
        "            waits = now_ns - self.asked_since_ns <= PATIENCE_S * 1e9\n", "",
        "a client waits forever for a daemon that keeps asking for time",
        tests=("tests/daemon/client/test_playing_on.py",),
    ),
    Change(
        "accept-without-asking", ACCEPT, "return reach[0] > status.reach_min + slack or",
        "return False and", "an accepted model cuts off the scan being played without a question",
        tests=("tests/daemon/commands/test_accept_says.py",),
    ),
)  # fmt: skip
