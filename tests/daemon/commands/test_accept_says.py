"""`dehyst accept` reports what changes, and asks for confirmation if a trajectory in play may be
cut."""

import io
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from dehyst.daemon.bus.messages import ModelOffer
from dehyst.daemon.client.offer_change import cuts_trajectory, describe_change, new_reach
from dehyst.daemon.commands.accept import require_consent
from dehyst.models.errors import BadInput, NotNow


def offer(**more: Any) -> ModelOffer:
    fields: dict[str, Any] = {
        "number": 1, "seconds": 10.0, "rms_in_use": 0.2, "rms_offered": 0.01, "noise": 0.003,
        "trial_s": 30.0, "reach_in_use": (3.0, 23.0), "reach_offered": (5.0, 22.0),
        "rate_in_use": 100.0, "rate_offered": 100.0,
    }  # fmt: skip
    return ModelOffer(**(fields | more))


def status(**more: Any) -> Any:
    fields: dict[str, Any] = {
        "reach_min": -10.0, "reach_max": 10.0, "unit": "um", "drive_unit": "v",
        "trajectory_done": False, "state": "running",
    }  # fmt: skip
    return SimpleNamespace(**(fields | more))


def test_reach_and_error_are_said_in_set_points() -> None:
    assert new_reach(offer(), status()) == (-8.0, 9.0)
    said = describe_change(offer(), status())
    assert "-10 to 10 becomes -8 to 9 um" in said
    assert "0.2 becomes 0.01 um" in said
    assert "rate" not in said


def test_a_rate_is_said_where_it_changes() -> None:
    assert "100 becomes 60 v/s" in describe_change(offer(rate_offered=60.0), status())
    assert "100 becomes unlimited" in describe_change(offer(rate_offered=None), status())


@pytest.mark.parametrize(
    ("offered", "state", "done", "asks"),
    [
        ((5.0, 23.0), "running", False, True),
        ((3.0, 22.0), "running", False, True),
        ((3.0, 23.0), "running", False, False),
        ((2.0, 24.0), "running", False, False),
        ((5.0, 22.0), "running", True, False),
        ((5.0, 22.0), "ready", False, False),
        (None, "running", False, False),
    ],
)
def test_it_asks_where_a_trajectory_in_play_may_be_cut(
    offered: tuple[float, float] | None, state: str, done: bool, asks: bool
) -> None:
    now = status(state=state, trajectory_done=done)
    assert cuts_trajectory(offer(reach_offered=offered), now) is asks


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_without_a_terminal_yes_is_required(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    with pytest.raises(BadInput, match="--yes"):
        require_consent()


@pytest.mark.parametrize(
    ("answer", "goes_on"), [("y", True), ("yes", True), ("", False), ("n", False)]
)
def test_only_a_yes_is_one(monkeypatch: pytest.MonkeyPatch, answer: str, goes_on: bool) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal(f"{answer}\n"))
    if goes_on:
        require_consent()
    else:
        with pytest.raises(NotNow):
            require_consent()
