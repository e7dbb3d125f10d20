"""The paper's experiments: what would make a figure look reached, or flatter the inverse."""

from tests.mutations.change import Change, room

EXPERIMENTS = "daemon/paper/experiments.py"

CHANGES = [
    *room(
        ("tests/daemon/paper",),
        Change(
            "paper-tracking-of-all-rows",
            EXPERIMENTS,
            "inside = error[reachable]",
            "inside = error",
            "rows that no drive can reach count as errors of the inverse",
        ),
        Change(
            "paper-noise-left-out",
            EXPERIMENTS,
            "predicted - measured,",
            "predicted - true,",
            "the errors here exclude sensor noise, unlike those of the paper",
        ),
    ),
]
