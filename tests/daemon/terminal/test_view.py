"""The live view on a small terminal, a large one, and one without colours."""

import io
import re
import time
from collections import deque
from typing import Any

import msgspec
import numpy as np
import pytest
from rich.console import Console

from dehyst.daemon.bus.messages import Event, GatewayStatus, Rejection, Status
from dehyst.daemon.rings.records import TELEMETRY, State
from dehyst.daemon.rings.status import STATUS, message_values
from dehyst.daemon.terminal import readout, view
from dehyst.daemon.terminal.overview import find_troubles, overview

WALL_NS = 1_700_000_000_000_000_000  # 2023-11-14 22:13:20 UTC


@pytest.fixture(autouse=True)
def _utc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()


def status(**changed: Any) -> Status:
    record = np.zeros(1, STATUS)[0]
    record["unit"], record["state"], record["period_ns"] = b"um", State.RUNNING, 5_000_000
    record["actuator_ok"] = record["sensor_ok"] = 1
    record["wall_ns"], record["reach_max"], record["samples"] = WALL_NS, 15.0, 100_000
    gateway = GatewayStatus(
        pid=1,
        uptime_s=60.0,
        samples_published=9,
        samples_lost=0,
        commands=0,
        rejected={},
        lease_client=0,
        lease_label="",
        lease_left_s=0.0,
        history_s=1.0,
        restarts_of_core=0,
    )
    made = Status(
        name="stage-1",
        software="1",
        core_alive=True,
        run=1,
        gateway=gateway,
        **message_values(record),
    )
    return msgspec.structs.replace(made, **changed)


def window() -> view.RecentTelemetry:
    samples = np.zeros(2000, TELEMETRY)
    samples["scheduled_ns"] = 5_000_000 * np.arange(2000)
    samples["target"] = np.sin(np.arange(2000) / 50.0)
    samples["measured"] = samples["target"] + 0.01
    samples["state"] = State.RUNNING
    made = view.RecentTelemetry(10.0, 5_000_000)
    made.add(samples)
    return made


def drawn(
    size: tuple[int, int],
    events: int = 0,
    text: str = "number {}",
    changed: dict[str, Any] | None = None,
    **options: Any,
) -> str:
    happened = deque(
        Event(time_ns=i, wall_ns=WALL_NS + i * 10**9, level=2, code="core", text=text.format(i))
        for i in range(events)
    )
    refused = deque([Rejection(time_ns=-(10**9), client=1, code="busy", text="no", count=2)])
    screen = view.screen(
        status(**(changed or {})), window(), 0, happened, refused if events else deque(), size
    )
    file = io.StringIO()
    console = Console(width=size[0], height=size[1], file=file, force_terminal=True, **options)
    console.print(screen)
    return file.getvalue()


def braille(text: str) -> int:
    return sum(any(ord(c) >= 0x2800 for c in line) for line in text.splitlines())


def test_at_80_by_24_the_plots_have_the_rows_and_an_event_one_line_with_its_time() -> None:
    text = drawn((80, 24), 3, no_color=True)
    assert len(text.splitlines()) == 24
    assert braille(text) >= 16
    assert "22:13:22 core: number 2" in text
    assert "number 1" not in text
    assert "stage-1: running" in text
    assert "missed 0 of 100000" in text


def test_a_large_terminal_shows_all_numbers_and_no_more_of_a_box_than_there_are_events() -> None:
    for events, lines in ((0, 3), (2, 5)):
        text = drawn((120, 40), events, no_color=True)
        assert "wake-up p50" in text
        box = text.splitlines()[
            text.splitlines().index(next(line for line in text.splitlines() if "events" in line)) :
        ]
        assert len(box) == lines
    assert "22:13:19 refused 2 x: no" in text  # by the controller's clock, from the status
    assert braille(text) >= 20


@pytest.mark.parametrize("size", [(80, 24), (100, 40), (120, 40)])
def test_what_is_longer_than_a_line_is_wrapped_and_not_cut(size: tuple[int, int]) -> None:
    long = (
        "trim frozen: the reading has jumped, gauge and model differ by 0.3124; it resumes when "
        "the reading is back and settled, or after `dehyst zero`, number {}"
    )
    changed = {
        "trimmed": True, "trim": 0.0869, "differs": -0.219, "trim_frozen": "jumped",
        "missed_by": {"preempted": 3, "driver_io": 473, "compute": 1, "late_wake": 33, "stall": 24},
        "actuator_ok": False,
    }  # fmt: skip
    shown = drawn(size, 6, long, changed, no_color=True)
    assert len(shown.splitlines()) == size[1]
    words = " ".join(re.sub(r"[^\x20-\x7e]", " ", shown).split())
    assert "or after `dehyst zero`, number 5" in words
    assert "FAILED" in words
    assert "from the model" in words
    assert "\u2026" not in shown
    assert braille(shown) >= 9


def test_after_a_resize_it_fills_the_new_size() -> None:
    assert [len(drawn(size).splitlines()) for size in ((80, 24), (132, 50), (60, 15))] == [
        24,
        50,
        15,
    ]


def test_no_color_is_respected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[31m" in drawn((80, 24))
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[3" not in drawn((80, 24), 1)


@pytest.mark.parametrize(
    ("changed", "gateway", "words"),
    [
        ({}, {}, ""),
        ({"core_alive": False}, {}, "has ended, was killed, or hangs"),
        ({"sensor_ok": False, "sensor_errors": 7}, {}, "the sensor does not answer (7 errors)"),
        ({"state": "fault"}, {}, "the events give the reason"),
        (
            {},
            {"mismatch": "slow", "health": 1.4},
            "does not behave like its model (slow, 1.4 times",
        ),
        ({"trimmed": True, "trim_frozen": "stuck"}, {}, "the gauge is stuck"),
        ({"trimmed": True, "trim_frozen": "not_running"}, {}, ""),
        ({"missed": 100, "missed_by": {"stall": 100}}, {}, ""),
        ({"missed": 101, "missed_by": {"stall": 101}}, {}, "0.1 % of the deadlines were missed"),
        ({"missed": 170_000, "missed_by": {}}, {}, "100 % of the deadlines were missed"),
        ({}, {"samples_lost": 3}, "3 samples were lost"),
    ],
)
def test_status_says_what_needs_a_look(
    changed: dict[str, Any], gateway: dict[str, Any], words: str
) -> None:
    base = status()
    said = msgspec.structs.replace(
        base, gateway=msgspec.structs.replace(base.gateway, **gateway), **changed
    )
    troubles = find_troubles(said)
    assert len(troubles) == (1 if words else 0)
    assert words in " ".join(troubles)
    screen = "\n".join(overview(said, None, [], troubles))
    assert screen.count("\n  ! ") == len(troubles)
    assert screen.count("\n") <= 22


@pytest.mark.parametrize("changed", [{"core_alive": False, "period_ns": 0}, {"state": "start"}])
def test_a_start_is_a_state_that_every_view_knows(changed: dict[str, Any]) -> None:
    starts = status(**changed)
    empty = view.RecentTelemetry(10.0, starts.period_ns)
    assert view.line(starts, empty, 0).startswith("starting")
    screens = [
        view.screen(starts, empty, 0, deque(), deque(), size) for size in ((80, 24), (120, 40))
    ]
    for screen in screens:
        file = io.StringIO()
        Console(width=120, height=40, file=file, force_terminal=True, no_color=True).print(screen)
        assert "starting" in file.getvalue()
    lines = overview(starts, None, [], find_troubles(starts))
    assert lines[0].startswith("stage-1: starting for 60 s")
    assert not [line for line in lines if "reach" in line or "position" in line]
    assert find_troubles(starts) == []
    long = msgspec.structs.replace(starts.gateway, uptime_s=400.0)
    assert "has taken 7 min" in find_troubles(msgspec.structs.replace(starts, gateway=long))[0]


def test_where_the_stage_is_stands_in_the_status_and_large_in_the_view() -> None:
    at = msgspec.structs.replace(status().gateway, measured=7.98, target=8.0)
    shown = "\n".join(overview(status(gateway=at, volts=51.25), None, [], []))
    assert "measured 7.9800 um, target 8.0000 um, error -0.0200 um, output 51.250 V" in shown
    none = "\n".join(overview(status(), None, [], []))
    assert "no valid reading, no target" in none
    large = drawn((120, 40), no_color=True)
    measured = float(window().place())
    for row in readout.large(f"{measured:.4f}"):
        assert row.rstrip() in large


def test_the_screen_fits_one() -> None:
    events = [
        Event(time_ns=0, wall_ns=WALL_NS, level=1 + i % 3, code="x", text="a\x1b[2J")
        for i in range(30)
    ]
    lines = overview(status(), None, events, [])
    assert len(lines) <= 24
    assert "\x1b" not in "".join(lines)
    assert lines[-1].startswith("11-14 22:13:20 error: x: a\\x1b")


def test_several_axes_share_the_rows_and_each_has_its_plots_and_newest_event() -> None:
    event = Event(time_ns=1, wall_ns=WALL_NS, level=1, code="core", text="it is there")
    views = [view.AxisScreen(status(), window(), 0, deque([event]), deque()) for _ in range(3)]
    for size in ((120, 60), (80, 36)):
        file = io.StringIO()
        Console(width=size[0], height=size[1], file=file, force_terminal=True, no_color=True).print(
            view.screens(views, size)
        )
        text = file.getvalue()
        assert len(text.splitlines()) == size[1]
        assert text.count("stage-1: running") == text.count("it is there") == 3
        assert braille(text) >= 12
