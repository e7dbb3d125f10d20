"""Pass arrays to compiled code as one table of (address, rows, columns), one entry per array.

Passing many arrays to a kernel from Python costs a few microseconds per call. A table costs as much
as one array, and each array in it can be replaced. `Addresses.of` makes the table of a (nested)
NamedTuple of arrays, in the order of its fields; `tuple_reader` returns the function with which
compiled code rebuilds that tuple.
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
    """Yield the arrays of a tuple and of the tuples nested in it, in order."""
    for item in named:
        if isinstance(item, tuple):
            yield from leaves(item)
        else:
            yield item


class Addresses:
    """Hold arrays by address: `words` is (3 n,) int64, [address, rows, columns] for each place.

    The arrays are kept alive. They must be C-contiguous and must not be moved in memory.
    """

    def __init__(self, places: int) -> None:
        self.words: Words = np.zeros(3 * places, np.int64)
        self.kept: dict[int, NDArray[Any]] = {}

    @classmethod
    def of(cls, named: tuple[Any, ...]) -> Self:
        """Make the table of a NamedTuple's arrays, nested ones included, in field order."""
        arrays = list(leaves(named))
        table = cls(len(arrays))
        for place, array in enumerate(arrays):
            table.put(place, array)
        return table

    def put(self, place: int, array: NDArray[Any]) -> None:
        """Put `array`, one- or two-dimensional, in a place. Raises ValueError for any other."""
        if not array.flags.c_contiguous or array.ndim not in (1, 2):
            raise ValueError(f"place {place}: a C-contiguous array of one or two dimensions")
        self.kept[place] = array
        columns = array.shape[1] if array.ndim == 2 else 1
        self.words[3 * place : 3 * place + 3] = array.ctypes.data, array.shape[0], columns

    @property
    def address(self) -> int:
        """Address of the table itself."""
        return int(self.words.ctypes.data)


@intrinsic
def pointer(typing: Any, address: Any) -> Any:
    """Return an address as a void pointer."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), codegen


@intrinsic
def record(typing: Any, address: Any, dtype: Any) -> Any:
    """Return the record at an address, with fields read and written by name; dtype: a global."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = context.get_value_type(signature.return_type)
        return builder.inttoptr(arguments[0], kind)

    return dtype.dtype(types.int64, dtype), codegen


@njit(cache=True, nogil=True)
def table_at(address: int, places: int) -> Words:
    """Return the table at an address."""
    return carray(pointer(address), (3 * places,), types.int64)


def _array(context: Any, builder: Any, kind: Any, table: Any, at: Any) -> Any:
    """Build the array of a type; its address, rows and columns are in `table` from word `at` on."""

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
    """Return the function `array_at(table, place)` for compiled code. It is an intrinsic, so that
    numba does not compile a separate call for each place."""

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
    """Return the function `tuple_at(address)` for compiled code. It rebuilds the tuple whose table
    (`Addresses.of`) is at that address. example: a tuple of the same types, of any sizes."""

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
