"""Compiling is told: what for, how far, how long. numba compiles something here."""

import math
from collections.abc import Callable

import pytest
from numba import njit

from dehyst.daemon.terminal import compiling


def fresh_kernel() -> Callable[[float], float]:
    """One that calls another; neither is kept on the disk."""

    @njit
    def inner(x: float) -> float:
        return math.sqrt(x)

    @njit
    def outer(x: float) -> float:
        return float(inner(x) + 1.0)

    return outer  # type: ignore[no-any-return]


def test_it_says_once_that_it_compiles_and_how_long_it_took(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    with compiling.compiling_told("dehyst core", in_pipes=True):
        assert fresh_kernel()(4.0) == 3.0
        assert fresh_kernel()(9.0) == 4.0
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith("dehyst core: compiling kernels, once")
    assert last.startswith("dehyst core: compiled 4 kernels in")
    with compiling.compiling_told("dehyst core", in_pipes=True, ends=False):
        fresh_kernel()(4.0)
    assert "compiled" not in capsys.readouterr().err


def test_what_is_soon_done_or_there_already_is_not_worth_a_word(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kernel = fresh_kernel()
    kernel(1.0)
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    with compiling.compiling_told("dehyst core", in_pipes=True):
        kernel(4.0)
    monkeypatch.setattr(compiling, "SILENT_S", 1e3)
    with compiling.compiling_told("dehyst core", in_pipes=True):
        fresh_kernel()(4.0)
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    with compiling.compiling_told("dehyst identify"):  # no terminal reads it
        fresh_kernel()(4.0)
    assert capsys.readouterr().err == ""


def test_a_kernel_within_a_kernel_is_counted_and_its_time_once() -> None:
    names: list[str] = []
    from numba.core.event import install_listener

    compilations = compiling.Compilations(names.append)
    with install_listener("numba:compile", compilations):
        fresh_kernel()(4.0)
    assert [name.rpartition(".")[2] for name in names] == ["outer", "inner"]
    assert compilations.count == 2
    spent = compilations.seconds
    assert 0.0 < spent < 60.0
    assert compilations.seconds == spent


def test_all_kernels_of_the_product_are_counted() -> None:
    assert compiling.count_kernels() > 150
