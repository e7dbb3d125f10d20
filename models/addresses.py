"""How compiled code finds arrays: a table of (address, rows, columns), one entry for each array.

Handing a kernel many arrays from Python costs a few microseconds a call; one table costs one array,
and each of the arrays may be exchanged. `Addresses.of` makes a table of a (nested) NamedTuple of
arrays, in the order of its own fields; `tuple_reader` gives the function by which compiled code
makes the same tuple again.
"""

from collections.abc import Callable, Iterator
from typing import Any, Self

import numpy as np
from llvmlite import ir
from numba import carray, njit, typeof, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

Words = NDArray[np.int64]
_WORD = ir.IntType(64)


def leaves(named: tuple[Any, ...]) -> Iterator[NDArray[Any]]:
    """The arrays of a tuple and of the tuples in it, in order."""
    for item in named:
        if isinstance(item, tuple):
            yield from leaves(item)
        else:
            yield item


class Addresses:
    """Arrays by address: `words` is (3 n,) int64, [address, rows, columns] for each place.

    The arrays are kept alive; they must be C-contiguous and stay where they are.
    """

    def __init__(self, places: int) -> None:
        self.words: Words = np.zeros(3 * places, np.int64)
        self.kept: dict[int, NDArray[Any]] = {}

    @classmethod
    def of(cls, named: tuple[Any, ...]) -> Self:
        """The arrays of a NamedTuple, nested ones included, in the order of their fields."""
        arrays = list(leaves(named))
        table = cls(len(arrays))
        for place, array in enumerate(arrays):
            table.put(place, array)
        return table

    def put(self, place: int, array: NDArray[Any]) -> None:
        """Let a place stand for `array`, one- or two-dimensional."""
        if not array.flags.c_contiguous or array.ndim not in (1, 2):
            raise ValueError(f"place {place}: a C-contiguous array of one or two dimensions")
        self.kept[place] = array
        columns = array.shape[1] if array.ndim == 2 else 1
        self.words[3 * place : 3 * place + 3] = array.ctypes.data, array.shape[0], columns

    @property
    def address(self) -> int:
        """Where the table itself is."""
        return int(self.words.ctypes.data)


@intrinsic
def pointer(typing: Any, address: Any) -> Any:
    """An address as a void pointer."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), codegen


@intrinsic
def record(typing: Any, address: Any, dtype: Any) -> Any:
    """The record of a global dtype at an address, to read and write by name."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = context.get_value_type(signature.return_type)
        return builder.inttoptr(arguments[0], kind)

    return dtype.dtype(types.int64, dtype), codegen


@njit(cache=True, nogil=True)
def table_at(address: int, places: int) -> Words:
    """The table at an address."""
    return carray(pointer(address), (3 * places,), types.int64)


def _array(context: Any, builder: Any, kind: Any, table: Any, at: Any) -> Any:
    """The array of a type whose address, rows and columns stand in a table from a word on."""

    def number(i: int) -> Any:
        return builder.load(builder.gep(table, [builder.add(at, ir.Constant(_WORD, i))]))

    data_type = context.get_data_type(kind.dtype)
    size = ir.Constant(_WORD, context.get_abi_sizeof(data_type))
    shape = [number(1 + axis) for axis in range(kind.ndim)]
    strides = [size] if kind.ndim == 1 else [builder.mul(size, shape[1]), size]
    array = context.make_array(kind)(context, builder)
    data = builder.inttoptr(number(0), data_type.as_pointer())
    populate_array(array, data, shape, strides, size, None)
    return array._getvalue()


def _array_reader(kind: Any) -> Callable[[Words, int], Any]:
    """The function `array_at(table, place)` for compiled code. An intrinsic has no call of its own
    that would be compiled for each place."""

    @intrinsic
    def array_at(typing: Any, table: Any, place: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            words = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            at = builder.mul(arguments[1], ir.Constant(_WORD, 3))
            return _array(context, builder, kind, words, at)

        return kind(table, types.int64), codegen

    return array_at


floats_at = _array_reader(types.float64[::1])  # the (n,) float array at a place
grid_at = _array_reader(types.float64[:, ::1])  # the (n, m) float array at a place
whole_at = _array_reader(types.int64[::1])  # the (n,) integer array at a place
whole_grid_at = _array_reader(types.int64[:, ::1])  # the (n, m) integer array at a place


def tuple_reader(example: tuple[Any, ...]) -> Callable[[int], Any]:
    """The function `tuple_at(address)` for compiled code: the tuple whose table (`Addresses.of`)
    lies at an address. example: a tuple of the same types, of any sizes."""

    @intrinsic
    def tuple_at(typing: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            table = builder.inttoptr(arguments[0], _WORD.as_pointer())
            place = iter(range(1 << 20))

            def built(kind: Any) -> Any:
                if isinstance(kind, types.BaseTuple):
                    return context.make_tuple(builder, kind, [built(item) for item in kind])
                return _array(context, builder, kind, table, ir.Constant(_WORD, 3 * next(place)))

            return built(signature.return_type)

        return typeof(example)(types.int64), codegen

    return tuple_at
