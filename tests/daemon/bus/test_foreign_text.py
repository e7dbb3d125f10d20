"""Text that others write on the bus locks nobody out and does not control a terminal."""

import json

import pytest
from tests.daemon.commands.test_remote import run
from tests.rigs.gateway_bench import Bench, renewed

from dehyst.daemon.bus.session import Bus
from dehyst.daemon.client.client import Client
from dehyst.daemon.printable import printable

COLOUR = "\x1b]0;owned\x07\x9b31m"


def dehyst(bench: Bench, *words: str, code: int = 0) -> tuple[str, str]:
    """Run a command; return (stdout, stderr), which must be free of control characters."""
    ended, out, err = run(*words, bench=bench)
    assert ended == code, err
    assert not {"\x1b", "\x07", "\x9b"} & set(out + err)
    return out, err


def test_printable() -> None:
    assert printable("4 µm at λ") == "4 µm at λ"
    assert printable("a\x1b[2Jb\n\u202ec") == "a\\x1b[2Jb\\n\\u202ec"


def test_an_odd_token_is_passed_over_and_named(
    shared: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    with Bus.connect([shared.address]) as evil:
        evil.announce("dehyst/@v1/EVIL\x1b[31m/alive")
        for _ in range(20):
            with Client(connect=shared.address) as client:
                assert client.name == "bench"
            if "EVIL" in caplog.text:
                break
    assert "EVIL\\x1b[31m" in caplog.text
    assert "\x1b" not in caplog.text


def test_a_label_commands_no_terminal(shared: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DEHYST_CONNECT", shared.address)
    with Client(label=COLOUR) as client:  # the address comes from the environment
        client.acquire()
        with renewed(client):
            _, said = dehyst(shared, "send", "5", code=2)
        assert "owned" in said
        assert "--take-over" in said
        listed, _ = dehyst(shared, "watch", "--list")
        assert "bench" in listed
        shown, _ = dehyst(shared, "watch", "--for", "2.5", "--json")
        statuses = [json.loads(line) for line in shown.splitlines()]
        assert statuses
        assert {status["name"] for status in statuses} == {"bench"}
        shown, _ = dehyst(shared, "watch", "--for", "2.5")
        assert "no target" in shown
        assert "nan" not in shown
        _, said = dehyst(shared, "send", "999", "--allow-unreachable", "--take-over")
        assert "999 um cannot be reached: going to" in said
