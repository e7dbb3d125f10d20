"""PI's command set: what a motion program is answered, and what the stage does for it."""

from tests.mutations.change import Change, room

CONTROLLER, DIALECT = "daemon/gcs/controller.py", "daemon/gcs/dialect.py"
GRAMMAR, WAVES = "daemon/gcs/grammar.py", "daemon/gcs/waves.py"
HELD = "daemon/client/held_axes.py"

CHANGES = [
    *room(
        ("tests/daemon/gcs/test_waves.py",),
        Change(
            "no-bound-of-a-line",
            GRAMMAR,
            "            elif len(self._line) >= LONGEST:\n",
            "            elif False:\n",
            "a line without an end fills up the memory",
        ),
        Change(
            "wave-jumps",
            WAVES,
            "    speed = 1.0 / max(n - s, 1.0)\n",
            "    speed = 1.0 / max(n, 1.0)\n",
            "a scan line jumps at its end",
        ),
        Change(
            "offset-left-out",
            WAVES,
            "            waves[axis] = self.offset.get(axis, 0.0) + points\n",
            "            waves[axis] = points\n",
            "WOS has no effect",
        ),
    ),
    *room(
        ("tests/daemon/gcs/test_pipython.py",),
        Change(
            "moves-without-servo",
            CONTROLLER,
            "            self._need_servo(name)\n            view",
            "            view",
            "MOV moves an axis with its servo off",
        ),
        Change(
            "leaves-the-stage",
            CONTROLLER,
            "                self.held.let_go()\n            except",
            "                pass\n            except",
            "the stage stays at a high voltage after the program that commanded it has gone",
        ),
        Change(
            "others-axes-leave-too",
            CONTROLLER,
            "            if any(self._servo.values()):\n                return\n",
            "",
            "a connection that ends releases the axes that another one commands",
        ),
        Change(
            "stop-lets-go",
            HELD,
            "        if here:\n",
            "        if False:\n",
            "after a stop the stage ramps to its safe voltage instead of staying",
        ),
        Change(
            "stop-has-no-error",
            CONTROLLER,
            "        raise GcsError(GcsCode.STOP",
            "        return str(GcsCode.STOP",
            "a program is not informed that it was stopped",
        ),
    ),
]
