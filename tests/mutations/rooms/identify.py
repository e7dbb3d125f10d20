"""Figures that an identification shows."""

from tests.mutations.change import Change, room

UNCERTAINTY = "models/identify/uncertainty.py"
RESULT = "models/identify/identification.py"

CHANGES = room(
    ("tests/models/identify/test_intervals.py",),
    Change(
        "errors-halved", RESULT, "errors=Params.unpacked(np.sqrt(",
        "errors=Params.unpacked(0.5 * np.sqrt(", "intervals are half as wide as they should be",
    ),
    Change(
        "errors-a-twentieth", RESULT, "errors=Params.unpacked(np.sqrt(",
        "errors=Params.unpacked(0.05 * np.sqrt(",
        "intervals are a twentieth of what they should be",
    ),
    Change(
        "errors-doubled", RESULT, "errors=Params.unpacked(np.sqrt(",
        "errors=Params.unpacked(2.0 * np.sqrt(", "intervals are twice as wide as they should be",
    ),
    Change(
        "one-stretch-for-each-sample", UNCERTAINTY,
        "stretch = max(1, total // TUNING.stretches)", "stretch = 1",
        "noise that hangs together counts as independent",
    ),
    Change(
        "few-stretches", "models/identify/tuning.py", "stretches: int = 50", "stretches: int = 4",
        "intervals are left to chance",
    ),
)  # fmt: skip
