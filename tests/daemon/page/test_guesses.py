"""Limit how fast passwords can be guessed; the time is injected."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.page.guesses import EACH_S, FREE, MOST_ADDRESSES, NS, Guesses, origin_of


def guess(guesses: Guesses, address: str, now_ns: int) -> bool:
    """Make a wrong guess; return whether it was checked or had to wait."""
    if guesses.wait_s(address, now_ns) > 0:
        return False
    guesses.wrong(address, now_ns)
    return True


@given(st.lists(st.integers(0, 20 * NS), min_size=1, max_size=200))
def test_within_any_time_no_more_guesses_are_looked_at_than_are_free_and_one_each(
    pauses_ns: list[int],
) -> None:
    guesses, now_ns, looked = Guesses(), 0, list[int]()
    for pause_ns in pauses_ns:
        now_ns += pause_ns
        if guess(guesses, "192.0.2.7", now_ns):
            looked.append(now_ns)
    for i, first in enumerate(looked):
        for k, last in enumerate(looked[i:], 1):
            assert k <= FREE + (last - first) / (EACH_S * NS)


@given(st.integers(0, 1000))
def test_who_waits_as_long_as_is_said_is_looked_at(wrong: int) -> None:
    guesses, now_ns = Guesses(), 5
    for _ in range(wrong):
        guess(guesses, "192.0.2.7", now_ns)
    now_ns += round(guesses.wait_s("192.0.2.7", now_ns) * NS)
    assert guess(guesses, "192.0.2.7", now_ns)


def test_one_address_does_not_wait_for_another() -> None:
    guesses = Guesses()
    for _ in range(120):
        guess(guesses, "192.0.2.7", 0)
    assert guesses.wait_s("192.0.2.7", 0) > 0
    assert guesses.wait_s("192.0.2.8", 0) == 0


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("192.0.2.1", "192.0.2.2", False),
        ("2001:db8::1", "2001:db8::ffff:1", True),  # one household owns a whole /64
        ("2001:db8:0:1::1", "2001:db8:0:2::1", False),
        ("::ffff:192.0.2.1", "192.0.2.1", True),
        ("fe80::1%eth0", "fe80::2%eth1", True),
    ],
)
def test_what_counts_as_one_address(one: str, other: str, same: bool) -> None:
    assert (origin_of(one) == origin_of(other)) is same


def test_what_is_kept_is_bounded() -> None:
    guesses = Guesses()
    for i in range(3 * MOST_ADDRESSES):
        guess(guesses, f"10.{i >> 16}.{i >> 8 & 255}.{i & 255}", i)
    assert len(guesses._even_ns) <= MOST_ADDRESSES
