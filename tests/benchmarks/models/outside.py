"""Recordings outside of the class, ordinary ones, and one rate against two: what identify says.

python -m tests.benchmarks.models.outside [--ordinary 60] [--lags 40]
"""

import argparse

from tests.rigs.outside import lagged, ordinary, outside

from dehyst.models.errors import BadRecording
from dehyst.models.identify import identify


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ordinary", type=int, default=60)
    parser.add_argument("--lags", type=int, default=40)
    args = parser.parse_args()
    refused = 0
    for kind, recording in outside().items():
        try:
            identify([recording])
            print(f"accepted: {kind}")
        except BadRecording as error:
            refused += 1
            print(f"refused: {str(error)[:110]}")
    taken = 0
    for seed in range(args.ordinary):
        try:
            identify([ordinary(seed)])
            taken += 1
        except BadRecording as error:
            print(f"ordinary {seed} refused: {error}")
    static = sum(not identify(lagged(s, (1.0,), 0.02 * (s % 2))).model.blocks
                 for s in range(args.lags))  # fmt: skip
    told = 0
    for seed in range(args.lags):
        try:
            found = identify(lagged(seed, (0.5, 4.0), 0.01 + 0.02 * (seed % 3) / 2))
        except BadRecording as error:
            print(f"lag {seed} refused: {str(error)[:110]}")
            continue
        told += any(b.kind in ("lag", "delay") for b in found.model.blocks)
    print("| what | of | number |\n|---|---|---|")
    print(f"| outside of the class, refused | {len(outside())} | {refused} |")
    print(f"| ordinary recordings, taken | {args.ordinary} | {taken} |")
    print(f"| one slow loop, given no dynamics | {args.lags} | {static} |")
    print(f"| a lag at two rates, given one | {args.lags} | {told} |")


if __name__ == "__main__":
    main()
