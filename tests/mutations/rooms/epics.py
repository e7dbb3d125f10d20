"""EPICS process variables: what a put does, and what becomes of the stage."""

from tests.mutations.change import Change, room

RECORDS, PROFILE = "daemon/epics/records.py", "daemon/epics/profile.py"

CHANGES = [
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
            "a move ends beside its target",
        ),
    ),
    *room(
        ("tests/daemon/epics/test_epics.py",),
        Change(
            "observer-moves",
            RECORDS,
            "        if self._source.observe:\n",
            "        if False:\n",
            "a server that only observes moves the stage",
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
            "a put with completion returns before the stage is there",
        ),
    ),
]
