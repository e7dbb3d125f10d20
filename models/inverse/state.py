"""Data of the inverse's kernels: one named tuple of preallocated arrays.

`Inverse` holds all of it. Python keeps the tuple; kernels read it through a table of addresses of
its fields (dehyst.models.addresses), so that a call from Python passes one address.
"""

from typing import NamedTuple

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from dehyst.models.addresses import tuple_reader
from dehyst.models.cascade.step import BLOCK, Chain
from dehyst.models.hysteresis.operators import Operators

SETTING = np.dtype(
    [
        ("rate", "<f8"),  # largest |du/dt|
        ("period", "<f8"),
        ("noise", "<f8"),
        ("slope", "<f8"),  # mean |dy/du|
        ("late", "<f8"),  # delay of drive and stage, in samples
        ("valid_low", "<f8"),
        ("valid_high", "<f8"),
        ("valid_rate", "<f8"),
        ("per_node", "<i8"),  # samples from node to node of the plan
        ("planned", "<i8"),  # whether a plan is computed
        ("wanted", "<i8"),  # targets that the mode needs ahead; 0: none
        ("stage_blocks", "<i8"),
        ("beside", "<i8"),  # whether blocks parallel to the hysteresis add to it
    ],
    align=True,
)
LIMITS = np.dtype(
    [
        ("u_offset", "<f8"),
        ("y_first", "<f8"),  # displacements at the ends of the saturation's branch
        ("y_last", "<f8"),
        ("low", "<f8"),  # drive range
        ("high", "<f8"),
    ],
    align=True,
)
STATE = np.dtype(
    [
        ("last", "<f8"),  # drive at the hysteresis
        ("command", "<f8"),  # applied last
        ("beside", "<f8"),  # what the blocks parallel to the hysteresis add
        ("time", "<f8"),
        ("target", "<f8"),  # present target at the hysteresis, blocks undone; NaN: none
        ("target_before", "<f8"),
        ("gap", "<f8"),  # drive minus the static inverse's, while it fades
        ("x_0", "<f8"),  # drive at the previous node, and one node earlier
        ("x_before", "<f8"),
        ("slope_0", "<f8"),  # drive slope per node at the nodes on either side
        ("slope_1", "<f8"),
        ("damping", "<f8"),
        ("seen_low", "<f8"),  # range of the targets until now
        ("seen_high", "<f8"),
        ("phase", "<i8"),  # samples since the previous node
        ("begun", "<i8"),  # whether a plan exists
        ("followed", "<i8"),  # 1: the plan is followed; 0: the static inverse
        ("nodes", "<i8"),  # how many nodes have a known target
        ("known", "<i8"),  # how many targets are in `ahead`
        ("ring_at", "<i8"),  # index in the ring for the next passed target
        ("ring_fill", "<i8"),
    ],
    align=True,
)
FRAME = np.dtype(
    [
        ("x_0", "<f8"),  # drive before the window, and one node earlier
        ("x_before", "<f8"),
        ("period", "<f8"),  # from node to node
        ("half", "<f8"),  # half a sampling period, in nodes
        ("low", "<f8"),
        ("high", "<f8"),
        ("travel", "<f8"),  # largest change from node to node
        ("spring", "<f8"),  # stiffness beyond low, high and travel
    ],
    align=True,
)
RESULT = np.dtype(
    [
        ("drive", "<f8"),
        ("predicted", "<f8"),
        ("reading", "<f8"),
        ("mode", "<i8"),
        ("flags", "<i8"),
    ],
    align=True,
)


class StaticTables(NamedTuple):
    """Data of the breakpoint walk: r, b (n,); c (m,); z_knots (K,); limits (1,) LIMITS."""

    r: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    z_knots: NDArray[np.float64]
    limits: NDArray[np.void]


class Nodes(NamedTuple):
    """Least-squares problem of a plan. target, trust, smooth: (P,); rows (4, P), bands (4, P):
    scratch; frame: (1,) FRAME."""

    target: NDArray[np.float64]
    trust: NDArray[np.float64]
    smooth: NDArray[np.float64]
    rows: NDArray[np.float64]
    bands: NDArray[np.float64]
    frame: NDArray[np.void]


class Inverse(NamedTuple):
    """All data of an inverse. setting (1,) SETTING; state (1,) STATE; result (1,) RESULT; plays
    (n,): operator outputs of the stage; ahead_plays, static_plays, after_plays (n,): scratch; plan,
    trial (P,): drives at the nodes; blocks, scratch: states of the cascade's blocks; ahead (W,):
    targets known from the present sample on; ring: passed targets; seq: targets while the blocks
    are undone; y (5,): output of `advance`; channels: values of the model's further channels;
    targets: a compiled caller fills them."""

    hysteresis: Operators
    chain: Chain
    static: StaticTables
    nodes: Nodes
    setting: NDArray[np.void]
    state: NDArray[np.void]
    result: NDArray[np.void]
    plays: NDArray[np.float64]
    ahead_plays: NDArray[np.float64]
    static_plays: NDArray[np.float64]
    after_plays: NDArray[np.float64]
    plan: NDArray[np.float64]
    trial: NDArray[np.float64]
    blocks: NDArray[np.float64]
    scratch: NDArray[np.float64]
    ahead: NDArray[np.float64]
    ring: NDArray[np.float64]
    seq: NDArray[np.float64]
    y: NDArray[np.float64]
    channels: NDArray[np.float64]
    targets: NDArray[np.float64]


_Z, _G = np.zeros(1), np.zeros((1, 1))
_EXAMPLE = Inverse(
    Operators(_G, _Z, _Z),
    Chain(np.zeros(1, BLOCK), _Z),
    StaticTables(_Z, _Z, _Z, _Z, np.zeros(1, LIMITS)),
    Nodes(_Z, _Z, _Z, _G, _G, np.zeros(1, FRAME)),
    np.zeros(1, SETTING),
    np.zeros(1, STATE),
    np.zeros(1, RESULT),
    *(14 * (_Z,)),
)
INVERSE = typeof(_EXAMPLE)
"""numba type of every Inverse."""
inverse_at = tuple_reader(_EXAMPLE)  # Inverse by its table's address, for compiled code
