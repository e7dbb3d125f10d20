"""An interrupt is never lost, wherever it arrives."""

import signal
import threading
from contextlib import suppress

import pytest

from dehyst.daemon.interrupts import noted_interrupts


def interrupt_within_a_callback_that_swallows_it() -> None:
    with suppress(BaseException):  # as a callback from compiled code does
        signal.raise_signal(signal.SIGINT)


@pytest.fixture(autouse=True)
def usual_handler() -> None:
    assert threading.current_thread() is threading.main_thread()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_it_is_raised_where_it_can_be_taken() -> None:
    with noted_interrupts() as raise_noted:
        raise_noted()
        interrupt_within_a_callback_that_swallows_it()
        with pytest.raises(KeyboardInterrupt):
            raise_noted()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_one_that_nobody_took_is_raised_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt), noted_interrupts():
        interrupt_within_a_callback_that_swallows_it()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_one_is_raised_at_once() -> None:
    with suppress(KeyboardInterrupt), noted_interrupts():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_elsewhere_than_in_the_main_thread_nothing_changes() -> None:
    seen = []

    def other() -> None:
        with noted_interrupts() as raise_noted:
            raise_noted()
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
