"""The page in a browser: who is let in, how fast passwords are guessed, what strangers cost."""

from tests.mutations.change import Change, room

DOORS, GUARD, GUESSES = "daemon/page/doors.py", "daemon/page/guard.py", "daemon/page/guesses.py"
PEOPLE, SERVER, VISITS = "daemon/page/people.py", "daemon/page/server.py", "daemon/page/visits.py"
WIRE = "daemon/page/wire.py"
STRANGERS = "tests/daemon/page/test_strangers.py"

CHANGES = [
    *room(
        ("tests/daemon/page/test_guesses.py",),
        Change(
            "wrong-guess-costs-nothing", GUESSES,
            "max(self._even_ns.pop(key, now_ns), now_ns) + self._each_ns",
            "max(self._even_ns.pop(key, now_ns), now_ns)",
            "passwords are guessed as fast as the network carries them",
        ),
        Change(
            "one-guesser-slows-everybody", GUESSES, "    return str(found)\n\n",
            '    return "everybody"\n\n',
            "the right password waits while a stranger guesses",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_guesses_are_slow_whichever_way_and_nobody_else_waits",),
        Change(
            "tokens-guessed-freely", PEOPLE, "        if token or kind:\n", "        if False:\n",
            "session tokens are guessed as fast as the network carries them",
        ),
        Change(
            "header-that-is-no-text", PEOPLE, "except ValueError:", "except KeyError:",
            "a stranger's header ends in a traceback for each request",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_log_out_ends_what_the_log_in_opened",),
        Change(
            "log-out-leaves-the-socket", SERVER,
            "lambda: not by_session or self.people.lasts(token)", "lambda: True",
            "who has logged out goes on commanding the stage",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_500_connections_that_say_nothing_cost_nobody_anything",),
        Change(
            "half-heads-wait-for-ever", DOORS, "call_later(HEAD_S, self.transport.abort)",
            "call_later(1e6, self.transport.abort)", "silent connections stay for ever",
        ),
        Change(
            "waiting-not-bounded", DOORS, "if len(mine) > MOST_OF_ONE:", "if False:",
            "one address keeps all places of those who wait",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_pages_that_are_deaf_leave_room_for_another_address",),
        Change(
            "places-for-everybody-together", SERVER,
            "self._visits[address] >= MOST_VISITS_OF_ONE or", "self._visits.total() >= 64 or",
            "the pages of one address leave nobody else a place",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_a_wrong_frame_costs_its_sender_alone",),
        Change(
            "binary-frame-not-refused", WIRE, "    if text is None:\n", "    if False:\n",
            "a binary frame ends in a traceback",
        ),
        Change(
            "deep-frame-not-refused", WIRE, "except RecursionError:", "except KeyError:",
            "a deeply nested frame ends in a traceback",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_who_answers_no_ping_is_ended",),
        Change(
            "deaf-pages-stay", DOORS,
            "        super().keepalive_timeout()\n        self.transport.abort()\n",
            "        pass\n", "a page that has gone without a word keeps its place for ever",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_a_port_that_is_busy_is_said_in_one_line",),
        Change(
            "busy-port-in-numbers", DOORS, "    if error.errno == errno.EADDRINUSE:\n",
            "    if False:\n", "a busy port is said as a number of the system",
        ),
    ),
]  # fmt: skip
