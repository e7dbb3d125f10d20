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


@njit(cache=True, nogil=True)
def table_at(address: int, places: int) -> Words:
    """The table at an address."""
    return carray(pointer(address), (3 * places,), types.int64)


@njit(cache=True, nogil=True)
def floats_at(table: Words, place: int) -> NDArray[np.float64]:
    """The (n,) float array at a place."""
    return carray(pointer(table[3 * place]), (table[3 * place + 1],), types.float64)


@njit(cache=True, nogil=True)
def grid_at(table: Words, place: int) -> NDArray[np.float64]:
    """The (n, m) float array at a place."""
    shape = (table[3 * place + 1], table[3 * place + 2])
    return carray(pointer(table[3 * place]), shape, types.float64)


@njit(cache=True, nogil=True)
def whole_at(table: Words, place: int) -> Words:
    """The (n,) integer array at a place."""
    return carray(pointer(table[3 * place]), (table[3 * place + 1],), types.int64)


@njit(cache=True, nogil=True)
def whole_grid_at(table: Words, place: int) -> NDArray[np.int64]:
    """The (n, m) integer array at a place."""
    shape = (table[3 * place + 1], table[3 * place + 2])
    return carray(pointer(table[3 * place]), shape, types.int64)


def tuple_reader(example: tuple[Any, ...]) -> Callable[[int], Any]:
    """The function `tuple_at(address)` for compiled code: the tuple whose table (`Addresses.of`)
    lies at an address. example: a tuple of the same types, of any sizes."""
    word = ir.IntType(64)

    @intrinsic
    def tuple_at(typing: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            table = builder.inttoptr(arguments[0], word.as_pointer())
            place = iter(range(1 << 20))

            def number(i: int) -> Any:
                return builder.load(builder.gep(table, [ir.Constant(word, i)]))

            def built(kind: Any) -> Any:
                if isinstance(kind, types.BaseTuple):
                    return context.make_tuple(builder, kind, [built(item) for item in kind])
                at = 3 * next(place)
                data_type = context.get_data_type(kind.dtype)
                size = ir.Constant(word, context.get_abi_sizeof(data_type))
                shape = [number(at + 1 + axis) for axis in range(kind.ndim)]
                strides = [size] if kind.ndim == 1 else [builder.mul(size, shape[1]), size]
                array = context.make_array(kind)(context, builder)
                data = builder.inttoptr(number(at), data_type.as_pointer())
                populate_array(array, data, shape, strides, size, None)
                return array._getvalue()

            return built(signature.return_type)

        return typeof(example)(types.int64), codegen

    return tuple_at
