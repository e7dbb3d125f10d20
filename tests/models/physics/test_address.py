"""Kernels are called by address, from cached code, in another process."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import numpy as np
from dehyst.models.cascade.step import invert_stage_blocks, pack
from dehyst.models.model import Block, Hysteresis, Model, Validity

blocks = (
    Block("creep", "stage", {"gain_per_decade": 0.02, "tau_min_s": 0.1, "tau_max_s": 10.0}),
    Block("lag", "stage", {"tau_s": 0.01}),
)
model = Model(Hysteresis(r=[0.0], b=[1.0], c=[0.0, 1.0]), Validity(0.0, 10.0), blocks=blocks)
packed = pack(model, 1e-3)
states = packed.settle(1.0, 1.0)
x = np.linspace(1.0, 2.0, 20)
invert_stage_blocks(packed.chain, states, states.copy(), np.zeros(0), 1, 1e-3, 1e-3, x)
print(x.tolist())
"""


def test_a_second_process_takes_everything_from_the_cache(tmp_path: Path) -> None:
    outputs, compiled = [], []
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        )
        outputs.append(run.stdout)
        compiled.append({f: f.stat().st_mtime_ns for f in tmp_path.rglob("*.nb?")})
    assert compiled[0]
    assert compiled[0] == compiled[1]
    assert outputs[0] == outputs[1]
