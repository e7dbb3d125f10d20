"""`dehyst bench`: what would flatter a model."""

from tests.mutations.change import Change, room

RUN, REPORT, CASES = (f"daemon/benchmark/{name}.py" for name in ("run", "report", "cases"))

CHANGES = [
    *room(
        ("tests/daemon/benchmark/test_run.py",),
        Change(
            "bench-scores-what-was-fitted",
            RUN,
            "rms(left[case.scored])",
            "rms(left)",
            "rows that a model was fitted to count as held out",
        ),
        Change(
            "bench-fits-what-is-held-out",
            CASES,
            "head(whole, first), head(whole, n)",
            "head(whole, n), head(whole, n)",
            "every model has seen the rows that it predicts",
        ),
        Change(
            "bench-hides-where-it-loses",
            REPORT,
            "own.share > TIE * best.share",
            "own.share > 100.0 * best.share",
            "a case that this project loses is not reported",
        ),
    ),
]
