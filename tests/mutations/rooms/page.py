"""The page in a browser: who is let in, how fast passwords are guessed, what strangers cost."""

from tests.mutations.change import Change, room

DOORS, GUARD, GUESSES = "daemon/page/doors.py", "daemon/page/guard.py", "daemon/page/guesses.py"
PEOPLE, SERVER, VISITS = "daemon/page/people.py", "daemon/page/server.py", "daemon/page/visits.py"
WIRE = "daemon/page/wire.py"
STATIC = "daemon/page/static"
BROWSER, PICTURES = "tests/daemon/page/test_browser.py", "tests/daemon/page/test_pictures.py"
PROXY = "tests/daemon/page/test_behind_a_proxy.py"
STRANGERS = "tests/daemon/page/test_strangers.py"

CHANGES = [
    *room(
        ("tests/daemon/page/test_commanding.py",),
        Change(
            "connecting-outlives-a-stop", "daemon/page/commanding.py",
            "            if over.is_set():  # connecting", "            if False:  # connecting",
            "an axis moves after the page has said that all are stopped",
        ),
        Change(
            "page-stop-has-no-patience", "daemon/page/watching.py",
            "                    self._client = Client.of_axis(\n"
            "                        client.bus, client.keys, client.label, client.client\n"
            "                    )\n",
            "                    self._client = client\n",
            "the page's stop is lost while the gateway restarts",
        ),
    ),
    *room(
        ("tests/daemon/page/test_guesses.py",),
        Change(
            "wrong-guess-costs-nothing", GUESSES,
            "max(self._even_ns.pop(key, now_ns), now_ns) + self._each_ns",
            "max(self._even_ns.pop(key, now_ns), now_ns)",
            "passwords can be guessed as fast as the network allows",
        ),
        Change(
            "one-guesser-slows-everybody", GUESSES, "    return str(found)\n\n",
            '    return "everybody"\n\n',
            "the correct password has to wait while a stranger guesses",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_guesses_are_slow_whichever_way_and_nobody_else_waits",),
        Change(
            "tokens-guessed-freely", PEOPLE, "        if token or kind:\n", "        if False:\n",
            "session tokens can be guessed as fast as the network allows",
        ),
        Change(
            "header-that-is-no-text", PEOPLE, "except ValueError:", "except KeyError:",
            "a stranger's header causes a traceback for each request",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_log_out_ends_what_the_log_in_opened",),
        Change(
            "log-out-leaves-the-socket", SERVER,
            "lambda: not by_session or self.people.lasts(token)", "lambda: True",
            "a logged-out user continues to command the stage",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_500_connections_that_say_nothing_cost_nobody_anything",),
        Change(
            "half-heads-wait-for-ever", DOORS, "call_later(HEAD_S, self.transport.abort)",
            "call_later(1e6, self.transport.abort)", "silent connections stay forever",
        ),
        Change(
            "waiting-not-bounded", DOORS, "if len(mine) > MOST_OF_ONE:", "if False:",
            "one address occupies all places of waiting connections",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_silent_connections_before_tls_cost_nobody_anything",),
        Change(
            "handshakes-wait-for-ever", DOORS, '"ssl_handshake_timeout": HEAD_S',
            '"ssl_handshake_timeout": 600.0', "silent connections before TLS stay forever",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_a_body_of_which_nothing_comes_is_given_up",),
        Change(
            "body-waited-for", SERVER, "async with asyncio.timeout(STALLED_S):",
            "async with asyncio.timeout(None):",
            "half-sent files occupy the places of their address",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_pages_that_are_deaf_leave_room_for_another_address",),
        Change(
            "places-for-everybody-together", SERVER,
            "self._visits[address] >= MOST_VISITS_OF_ONE or", "self._visits.total() >= 64 or",
            "the pages of one address leave no place for anybody else",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_a_wrong_frame_costs_its_sender_alone",),
        Change(
            "binary-frame-not-refused", WIRE, "    if text is None:\n", "    if False:\n",
            "a binary frame causes a traceback",
        ),
        Change(
            "deep-frame-not-refused", WIRE, "except RecursionError:", "except KeyError:",
            "a deeply nested frame causes a traceback",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_who_answers_no_ping_is_ended",),
        Change(
            "deaf-pages-stay", DOORS,
            "        super().keepalive_timeout()\n        self.transport.abort()\n",
            "        pass\n", "a page that disappeared silently keeps its place forever",
        ),
    ),
    *room(
        (f"{STRANGERS}::test_a_port_that_is_busy_is_said_in_one_line",),
        Change(
            "busy-port-in-numbers", DOORS, "    if error.errno == errno.EADDRINUSE:\n",
            "    if False:\n", "a busy port is reported as a system error number",
        ),
    ),
    *room(
        (PROXY,),
        Change(
            "public-origin-refused", GUARD, "or public.called(headers)", "or False",
            "the page loads through a proxy but cannot command",
        ),
        Change(
            "path-kept-is-not-found", GUARD, 'if self._public.path and scope["path"]',
            'if False and scope["path"]', "a proxy that keeps the path gets 404 for everything",
        ),
        Change(
            "public-page-without-passwords", "daemon/bus/security.py",
            "            if not passwords:\n", "            if False:\n",
            "anybody who reaches the proxy can move the stage",
        ),
    ),
    *room(
        (f"{BROWSER}::test_a_file_that_is_given_while_another_is_checked_shows_its_own_figures",),
        Change(
            "earlier-file-shown", f"{STATIC}/files.js",
            "      if (turn === this.turn) this.show(job);", "      this.show(job);",
            "the figures of an earlier file are shown with the new one, and play plays that file",
        ),
    ),
    *room(
        (f"{BROWSER}::test_arrows_step_and_space_stops_whatever_has_the_focus",),
        Change(
            "space-presses-the-button", f"{STATIC}/keys.js", '(e.key === " " && !choosing)',
            '(e.key === " " && !choosing && !e.target.closest("button"))',
            "space moves the stage where it should stop it",
        ),
        Change(
            "arrows-the-wrong-way", f"{STATIC}/keys.js", "ArrowUp: [1, 1]", "ArrowUp: [1, -1]",
            "an arrow moves the stage opposite to its direction",
        ),
    ),
    *room(
        (f"{BROWSER}::test_steps_end_at_the_reach",),
        Change(
            "steps-beyond-the-reach", f"{STATIC}/now.js",
            "Math.min(reach[1], Math.max(reach[0], from + times * size))", "from + times * size",
            "the last step before the end of the range is refused",
        ),
    ),
    *room(
        (f"{PICTURES}::test_noise_at_rest_is_a_small_part_of_the_picture",),
        Change(
            "noise-fills-the-chart", f"{STATIC}/plot.js", "() => 0.05 * span()", "() => 0",
            "a stage at rest seems to shake",
        ),
    ),
    *room(
        ("tests/daemon/page/test_server.py::"
         "test_a_stage_that_stands_outside_its_reach_is_held_there",),
        Change(
            "hold-refused-at-rest", "daemon/page/commanding.py",
            'if refused.code != "unreachable":', "if True:",
            "hold is refused when it is needed most",
        ),
    ),
    *room(
        ("tests/daemon/page/test_server.py::test_a_preview_is_played_where_it_was_made",),
        Change(
            "preview-of-another-controller-played", VISITS, "if job.controller not in names:",
            "if False:", "a trajectory that was checked for one stage moves another",
        ),
    ),
    *room(
        ("tests/daemon/page/test_other_programs.py",),
        Change(
            "programs-shut-out", GUARD, '            anywhere = "origin" not in headers\n',
            "            anywhere = False\n",
            "a program other than a browser cannot use the WebSocket",
        ),
        Change(
            "any-site-commands", GUARD, '            anywhere = "origin" not in headers\n',
            "            anywhere = True\n",
            "a page of another site in the same browser can command the stage",
        ),
    ),
]  # fmt: skip
