"""Builds the records with which the gateway commands the loop, in memory."""

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.records import COMMAND, LoopCommand

NOTHING: NDArray[np.void] = np.zeros(0, COMMAND)


def make_records(
    kind: LoopCommand,
    client: int,
    trajectory: int = 0,
    value: NDArray[np.float64] | None = None,
    offset_ns: NDArray[np.int64] | None = None,
) -> NDArray[np.void]:
    """Return one COMMAND record per value and offset (n,); a single record if there are none."""
    out = np.zeros(1 if value is None else value.size, COMMAND)
    out["kind"], out["client"], out["trajectory"] = kind, client, trajectory
    if value is not None:
        out["value"] = value
    if offset_ns is not None:
        out["offset_ns"] = offset_ns
    return out


def trust(trusted: bool) -> NDArray[np.void]:
    """Return the COMMAND record that informs the loop whether the mismatch watch trusts stage and
    gauge."""
    return make_records(LoopCommand.TRUST, 0, value=np.array([float(trusted)]))
