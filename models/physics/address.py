"""Call kernels by address: the forward and inverse kernels of all physics share one signature.

    kernel(p_at, n_p, s_at, n_s, x, t, dt, ch) -> y

p_at, s_at: addresses of the block's packed parameters and of its state; n_p, n_s: how many numbers
each has; x: input; t: time [s]; dt: time since the previous sample [s]; ch: the block's channel.
Code in numba's disk cache calls a kernel by its address (`call_at`), so that a chain of blocks
needs neither a list of functions nor a chain of ifs. A kernel reads its parameters and state by
name (`record`), and the part of variable length that follows them with `behind`.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic

from dehyst.models.addresses import pointer, record
from dehyst.models.model import Floats

__all__ = ("Kernel", "behind", "call_at", "call_kernel", "fields", "numbers", "record")

_WORD, _NUMBER = types.int64, types.float64
SIGNATURE = _NUMBER(*[_WORD] * 4, *[_NUMBER] * 4)


def fields(*names: str) -> np.dtype[Any]:
    """Return the dtype of a record of floating-point numbers with these names."""
    return np.dtype([(name, "f8") for name in names])


@njit(cache=True, nogil=True)
def numbers(address: int, n: int) -> Floats:
    """Return the n numbers at an address, (n,)."""
    return carray(pointer(address), n, np.float64)


@njit(cache=True, nogil=True)
def behind(address: int, n: int, first: int) -> Floats:
    """Return the numbers from index `first` on, of n numbers at an address, (n - first,)."""
    return carray(pointer(address + 8 * first), n - first, np.float64)


@intrinsic
def call_at(typing: Any, address: Any, words: Any, values: Any) -> Any:
    """Call the kernel at an address. words: (p_at, n_p, s_at, n_s), values: (x, t, dt, ch)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number = ir.IntType(64), ir.DoubleType()
        kind = ir.FunctionType(number, [word] * 4 + [number] * 4)
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        each = [builder.extract_value(one, i) for one in arguments[1:] for i in range(4)]
        return builder.call(function, each)

    return _NUMBER(_WORD, types.UniTuple(_WORD, 4), types.UniTuple(_NUMBER, 4)), generate


class Kernel:
    """A compiled function with an address; compiled, or loaded from the cache, on first use."""

    def __init__(self, function: Callable[..., float]) -> None:
        self.function = function
        self.__doc__ = function.__doc__

    @cached_property
    def _compiled(self) -> Any:
        return cfunc(SIGNATURE, cache=True)(self.function)

    @property
    def address(self) -> int:
        """Address of the machine code in this process."""
        return int(self._compiled.address)

    def __call__(
        self, p: Floats, s: Floats, x: float, t: float = 0.0, dt: float = 0.0, ch: float = 0.0
    ) -> float:
        """Compute one sample and advance s."""
        return float(_once(self.address, p, s, x, t, dt, ch))


@njit(cache=True, nogil=True)
def _once(kernel: int, p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    return call_at(kernel, (p.ctypes.data, p.size, s.ctypes.data, s.size), (x, t, dt, ch))


@njit(cache=True, nogil=True)
def call_kernel(
    kernel: int, p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats
) -> None:
    """Run a whole record through one kernel: fill y (N,) for x (N,) at times t (N,); ch (N,), or
    (0,) if the block reads no channel."""
    words = (p.ctypes.data, p.size, s.ctypes.data, s.size)
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = call_at(kernel, words, (x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0))
