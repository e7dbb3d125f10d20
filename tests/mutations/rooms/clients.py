"""Clients: several threads, forked processes, and a stage that says it is there."""

from tests.mutations.change import Change, room

POSITIONER, HELD = "daemon/client/positioner.py", "daemon/client/held_axes.py"
LEASE = """\
            if not self._lease:
                self.acquire()
            reply = """

CHANGES = [
    *room(
        ("tests/daemon/test_interrupts.py",),
        Change(
            "interrupt-lost",
            "daemon/interrupts.py",
            "        if noted:\n            taken = True\n            raise KeyboardInterrupt\n",
            "        pass\n",
            "a trajectory continues although Ctrl-C was pressed",
        ),
    ),
    *room(
        ("tests/daemon/client/test_threads_and_forks.py",),
        Change(
            "threads-command-at-once",
            "daemon/client/client.py",
            "        with self.commanding:\n" + LEASE,
            "        if True:\n" + LEASE,
            "threads of one client are refused at random",
        ),
        Change(
            "inherited-client-hangs",
            "daemon/bus/session.py",
            "        if not self.is_of_this_process:\n            raise",
            "        if False:\n            raise",
            "a client inherited by a forked child hangs silently",
        ),
        Change(
            "library-of-the-parent",
            "daemon/bus/after_fork.py",
            "    _stale = True\n",
            "    _stale = False\n",
            "a new client in a forked child hangs silently",
        ),
    ),
    *room(
        ("tests/daemon/client/test_held_axes.py",),
        Change(
            "held-axis-lost-when-late",
            "daemon/client/held_axes.py",
            ' or getattr(error, "code", "") in IN_PASSING\n',
            "\n",
            "an axis is given up because this computer stood still for a moment",
        ),
        Change(
            "a-queued-wave-outlives-a-stop",
            HELD,
            "self._fly(group, t, values, repeat, before, begun))",
            "self._fly(group, t, values, repeat, self._stops.count, begun))",
            "a wave that waits for its turn is not what a stop ends",
        ),
        Change(
            "refused-and-done-later",
            HELD,
            "            if not done.set_running_or_notify_cancel():\n",
            "            if False:\n",
            "a move that was answered with an error is made later",
        ),
        Change(
            "released-and-still-there",
            HELD,
            '            self._views.change(axis, asked=np.nan, lost="")\n',
            "            pass\n",
            "after a release the next relative move begins at the last target",
        ),
        Change(
            "lease-runs-out-without-a-target",
            HELD,
            "        elif self._taken:",
            "        elif False:",
            "another client takes an axis whose servo was switched on",
        ),
    ),
    *room(
        ("tests/daemon/client/test_positioner.py",),
        Change(
            "place-lost-when-late",
            "daemon/client/positioner.py",
            "error.code not in IN_PASSING or now_ns",
            "True or now_ns",
            "a scan loses its place because its computer stood still for a moment",
        ),
        Change(
            "a-cancelled-future-ends-all",
            POSITIONER,
            "    with suppress(InvalidStateError):\n",
            "    with suppress(ZeroDivisionError):\n",
            "a program that gives up waiting for a move can no longer stop the stage",
        ),
        Change(
            "inherited-positioner-waits",
            POSITIONER,
            "        if os.getpid() != self._process:\n            raise NotNow(",
            "        if False:\n            raise NotNow(",
            "a positioner inherited by a forked child returns futures that never complete",
            tests=(
                "tests/daemon/client/test_positioner.py"
                "::test_one_that_another_process_made_says_so_and_waits_for_nothing",
            ),
        ),
        Change(
            "stop-before-the-flight",
            POSITIONER,
            "self._fly(client, times, targets, before, future)",
            "self._fly(client, times, targets, self._stops.count, future)",
            "a stop straight after a flight was requested is forgotten, and the flight is flown",
        ),
        Change(
            "there-without-a-reading",
            POSITIONER,
            '            near &= np.isfinite(samples["measured"])\n',
            "            near &= True\n",
            "a stage whose gauge gives no reading is reported on target",
        ),
        Change(
            "a-gauge-that-disagrees-is-silent",
            POSITIONER,
            "        if there.finite and not agrees:\n",
            "        if False:\n",
            "a stage is reported on target while its gauge is 0.4 um off",
        ),
    ),
]
