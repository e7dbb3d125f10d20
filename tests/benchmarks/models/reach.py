"""Compare the predicted reach with the simulated one, over random cascades and model files.

python -m tests.benchmarks.models.reach [--count 2000] [--first 0] [MODEL.toml ...]

The random cascades contain every physics.
"""

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from tests.rigs.random_cascades import random_cascade, simulated_reach

from dehyst.daemon.files.models import load_model
from dehyst.models.cascade.reach import displacement_range, displacement_reach
from dehyst.models.model import Model


def off(model: Model) -> tuple[float, float]:
    """Return the largest deviation of an end, as a share of the range: of the whole cascade's
    reach, and of the hysteresis' alone."""
    v = model.validity
    low, high = simulated_reach(model)
    bare = Model(model.hysteresis, v)
    out = []
    for reach in (displacement_range(model, v.drive_min, v.drive_max),
                  displacement_range(bare, v.drive_min, v.drive_max)):  # fmt: skip
        out.append(max(abs(reach[0] - low), abs(reach[1] - high)) / (high - low))
    return out[0], out[1]


def table(title: str, models: Iterable[Model]) -> None:
    """Print one row for models without an assumption, one for those with one."""
    rows: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    for model in models:
        v = model.validity
        assumes = displacement_reach(model, v.drive_min, v.drive_max).assumes
        rows[bool(assumes)].append(off(model))
    for assumed, found in rows.items():
        if found:
            ours, bare = np.array(found).T
            words = "under a stated assumption" if assumed else "as it is"
            print(
                f"| {title}, {words} | {len(found)} | {100 * np.median(ours):.3f} | "
                f"{100 * ours.max():.3f} | {100 * bare.max():.1f} | {np.sum(ours > 0.005)} |"
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("models", nargs="*", type=Path)
    args = parser.parse_args()
    print("| models | number | median, % of the range | largest | largest of the hysteresis alone "
          "| above 0.5 % |\n|---|---|---|---|---|---|")  # fmt: skip
    table("random cascades", (random_cascade(args.first + i) for i in range(args.count)))
    if args.models:
        table("model files", (load_model(path) for path in args.models))


if __name__ == "__main__":
    main()
