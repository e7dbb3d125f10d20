"""Several axes of one controller: leases of all or none, stops that reach all, roles at each."""

from tests.mutations.change import Change, room

TOGETHER, GATE = "daemon/gateway/together.py", "daemon/gateway/admission.py"
START = "daemon/gateway/group_start.py"
INTAKE, SAFE = "daemon/gateway/command_intake.py", "daemon/service/safe_state.py"
HEARTBEAT, SECURITY = "daemon/service/heartbeat.py", "daemon/bus/security.py"
LEARNING, JOINED = "daemon/client/learning.py", "daemon/files/joined.py"
AXES = "tests/daemon/gateway/test_several_axes.py"

CHANGES = [
    *room(
        ("tests/daemon/gateway/test_together.py",),
        Change(
            "lease-of-some-axes", TOGETHER,
            "            gate.check_free(now_ns, request)\n", "            pass\n",
            "a client that asks for several axes takes them from their holder",
        ),
        Change(
            "lease-number-of-each", TOGETHER, "gate.give_lease(now_ns, request, number)",
            "gate.give_lease(now_ns, request)",
            "a client that has several axes can command a single one",
        ),
        Change(
            "stop-ends-at-a-refusal", TOGETHER,
            "            refused = _of_axis(name, reply)\n",
            "            return _of_axis(name, reply), records\n",
            "an axis that cannot be stopped keeps the others moving",
        ),
        Change(
            "strange-axes-taken", TOGETHER,
            "    if strangers or asked not in request.axes or", "    if",
            "a lease is taken for an axis that was not requested",
        ),
        Change(
            "group-forgotten", GATE, "        if len(command.axes) > 1:\n", "        if False:\n",
            "axes that play a trajectory together diverge in time",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_group_start.py",),
        Change(
            "contradicting-axes-start", START,
            "if not start.why and set(chunk.axes) != set(start.axes):", "if False:",
            "axes start although one of them names another set of axes",
        ),
        Change(
            "group-ends-silently", START,
            "        for axis in start.axes:\n", "        for axis in ():\n",
            "a trajectory of several axes does not start, and no axis reports it",
        ),
        Change(
            "first-axis-sets-out", START,
            "if any(n not in start.chunks and not gates[n][0].is_playing(chunk) for n in "
            "chunk.axes):",
            "if False:",
            "an axis moves to its first point although another one will not play",
        ),
        Change(
            "not-checked-again", START,
            "start.chunks.items():\n            gate, room = gates[name]\n            try:\n",
            "().__iter__():\n            gate, room = gates[name]\n            try:\n",
            "some axes begin although another has faulted since its first points arrived",
        ),
        Change(
            "starts-behind-a-stop", START,
            "if of_axis.size and name in start.chunks:", "if False:",
            "a trajectory begins after a stop",
        ),
        Change(
            "waits-for-the-others-for-ever", START, "now_ns - start.since_ns > WAIT_NS", "False",
            "a trajectory begins long after it was sent",
        ),
    ),
    *room(
        ("tests/daemon/service/test_safe_state.py",),
        Change(
            "one-axis-keeps-all-high", SAFE,
            "                errors[config.name] = error\n        _ramp(",
            "                raise error\n        _ramp(",
            "one unplugged amplifier keeps the outputs of the others high",
        ),
        Change(
            "first-axis-alone-is-safe", SAFE, "        for config in axes:\n",
            "        for config in axes[:1]:\n",
            "after the core's death only the first axis is made safe",
        ),
        Change(
            "one-attempt-alone", SAFE, "if isinstance(failed.get(config.name), PASSING)",
            "if False",
            "one truncated reply leaves the output where the core's death found it",
        ),
        Change(
            "hold-is-ramped", SAFE, 'if config.safe.on_fault == "ramp" else self.volts', "",
            "an output that should be held is ramped",
        ),
    ),
    *room(
        ("tests/daemon/service/test_heartbeat.py",),
        Change(
            "one-axis-may-stand", HEARTBEAT,
            "return any(axis.core.hangs for axis in self._axes)",
            "return all(axis.core.hangs for axis in self._axes)",
            "a core that no longer serves one of its axes is left running",
        ),
        Change(
            "ready-with-one-axis", HEARTBEAT,
            "return all(axis.gateway.moves for axis in self._axes)",
            "return any(axis.gateway.moves for axis in self._axes)",
            "the daemon reports ready while an axis cannot be reached",
        ),
    ),
    *room(
        (AXES,),
        Change(
            "roles-of-the-first-axis", SECURITY, "[keys.setpoints() for keys in axes]",
            "[keys.setpoints() for keys in axes[:1]]",
            "operators cannot write set-points to the further axes",
        ),
        Change(
            "axis-that-is-not-there", INTAKE, "(why := self._why_not_together(inbox, command))",
            '(why := "")', "a group waits for an axis that does not exist",
        ),
        Change(
            "others-play-on-alone", "daemon/client/together.py",
            "        _stop_begun([p for p, e in zip(players, ended, strict=True) if e is None])\n",
            "        pass\n", "if one axis ends early, the others continue",
            survives="the loop itself holds the members of a group together",
        ),
    ),
    *room(
        ("tests/daemon/client/test_repeated.py", "tests/daemon/files/test_joined.py"),
        Change(
            "held-pass-learned", LEARNING, "good &= np.abs(samples", "np.abs(samples",
            "a pass interrupted by a hold is learned from at the wrong positions",
        ),
        Change(
            "joined-over-a-reboot", JOINED, "                self._begin_anew()\n",
            "                pass\n",
            "a recording of several axes waits forever after a restart of the machine",
        ),
        Change(
            "joined-too-early", JOINED, "else min(self._newest_ns.values())",
            "else max(self._newest_ns.values())",
            "a recording lacks samples of another axis that arrived later",
        ),
    ),
]  # fmt: skip
