"""EPICS process variables: what a put does, and what becomes of the stage."""

from tests.mutations.change import Change, room

RECORDS, PROFILE = "daemon/epics/records.py", "daemon/epics/profile.py"
SERVER, OPEN = "daemon/epics/server.py", "daemon/client/open_protocol.py"

CHANGES = [
    *room(
        ("tests/daemon/epics/test_waiting.py",),
        Change(
            "a-path-is-no-excuse",
            RECORDS,
            "            if view.flying:  # a path",
            "            if False:  # a path",
            "a slow move fails at the client while the stage moves on",
        ),
    ),
    *room(
        ("tests/daemon/epics/test_profile.py",),
        Change(
            "too-fast",
            PROFILE,
            "        velocity = distance / ramp_s\n",
            "        velocity = 2 * distance / ramp_s\n",
            "a short move is faster than its acceleration allows",
        ),
        Change(
            "not-there",
            PROFILE,
            "    positions[-1] = end\n",
            "",
            "a move ends off its target",
        ),
    ),
    *room(
        ("tests/daemon/epics/test_epics.py",),
        Change(
            "observer-moves",
            RECORDS,
            "        if self._source.observe:\n",
            "        if False:\n",
            "a server that may only observe moves the stage",
        ),
        Change(
            "stop-does-nothing",
            RECORDS,
            "            await self._run(self._axes.stop)\n",
            "",
            "STOP leaves the stage moving",
        ),
        Change(
            "completion-at-once",
            RECORDS,
            "            if view.on_target and not view.flying:\n",
            "            if True:\n",
            "a put with completion returns before the stage has arrived",
        ),
    ),
    *room(
        ("tests/daemon/epics/test_epics.py::test_beacons_that_nobody_hears_are_not_on_the_screen",),
        Change(
            "every-beacon-a-traceback",
            SERVER,
            "    return not str(record.msg).startswith(BEACONS)\n",
            "    return True\n",
            "without a repeater on the machine the log fills with tracebacks",
        ),
    ),
    *room(
        ("tests/daemon/client/test_open_protocol.py",),
        Change(
            "tolerance-below-zero",
            OPEN,
            "    if tolerance < 0.0:\n",
            "    if False:\n",
            "a stage is never reported on target",
        ),
        Change(
            "served-to-the-network",
            OPEN,
            "    if not local and not allowed:\n",
            "    if False:\n",
            "anybody who reaches the address can command the stage, without permission",
        ),
    ),
    *room(
        ("tests/daemon/epics/test_epics.py",),
        Change(
            "no-velocity-is-the-fastest",
            "daemon/epics/records.py",
            "        if not (math.isfinite(value) and value > 0):\n",
            "        if False:\n",
            "a velocity of 0, -1 or NaN is taken, and the next move is the fastest",
        ),
        Change(
            "stop-of-a-motor-screen",
            "daemon/epics/records.py",
            '        if value in (0, 1, "Stop", "Pause"):\n',
            "        if False:\n",
            "Stop on a motor screen (SPMG) does not stop the axis",
        ),
        Change(
            "slow-move-from-outside",
            "daemon/epics/records.py",
            "        start = min(max(start, view.low), view.high)\n",
            "",
            "no slow move is possible from a stage at rest, which is outside the reach",
        ),
    ),
]
