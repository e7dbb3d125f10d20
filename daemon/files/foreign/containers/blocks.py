"""Join arrays that hold their samples in blocks, such as 30 blocks of 100."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dehyst.daemon.files.foreign.beside import group_of
from dehyst.daemon.files.foreign.epochs import rises_evenly
from dehyst.daemon.files.foreign.found import Given
from dehyst.daemon.files.foreign.roles import role_of
from dehyst.daemon.files.foreign.units import find_unit_key

Key = tuple[str, tuple[int, ...]]
MOST_SIDE_BY_SIDE = 8
"""Columns of a two-dimensional array that may be channels although no times belong to them."""


def joined_blocks(arrays: Sequence[Given]) -> tuple[list[Given], list[str]]:
    """Return (arrays, names of those left out): times, drive and displacement of one shape (N, M)
    become (N M,) in the order in which the times rise. They are left out if the times rise in
    neither order, unless all blocks have the same times."""
    sets: dict[Key, dict[str, Any]] = {}
    for one in arrays:
        if (key := _key_of(one)) is not None:
            role = role_of(one.name, find_unit_key(one.unit))[0]
            sets.setdefault(key, {}).setdefault(role, one.values)
    lengths = {np.size(one.values) for one in arrays if np.ndim(one.values) == 1}
    orders = {key: _order_of(key, of, lengths) for key, of in sets.items()}
    out, left = [], []
    for one in arrays:
        order = orders.get(_key_of(one) or ("", ()), "")
        if order is None:
            left.append(one.name)
        elif order:
            out.append(replace(one, values=np.ravel(one.values, order)))
        else:
            out.append(one)
    return out, left


def _key_of(one: Given) -> Key | None:
    """Return the key that arrays which belong together have in common; None for an array that does
    not have two dimensions of numbers."""
    values = one.values
    if not isinstance(values, np.ndarray) or values.ndim != 2 or values.dtype.kind not in "iuf":
        return None
    return (group_of(one.name), values.shape) if min(values.shape) > 1 else None


def _order_of(key: Key, of: dict[str, Any], lengths: set[int]) -> Any:
    """Return the order in which the samples of arrays follow each other, "" if their columns are
    channels, None if it is not known. of: an array for each role; lengths: of the arrays of one
    dimension."""
    if not of.keys() >= {"u", "y"}:
        return ""
    shape = key[1]
    if "t" not in of:
        channels = min(shape) <= MOST_SIDE_BY_SIDE or lengths & set(shape)
        return "" if channels else None
    times = of["t"]
    blocks = times if shape[0] < shape[1] else times.T
    if np.array_equal(blocks, np.broadcast_to(blocks[0], blocks.shape)):
        return ""
    return next((order for order in "CF" if rises_evenly(times.ravel(order))), None)
