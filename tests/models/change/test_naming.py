"""Which finding is named first, and which models are tried, by what each change alone removes."""

import math
from dataclasses import InitVar, dataclass, replace

import numpy as np
import pytest

from dehyst.models.change.causes import Cause, WeighedCause
from dehyst.models.change.naming import (
    ChangeResiduals,
    add_rivals,
    explains_all,
    find_one_change,
    is_of_sensor,
    leaves_nothing_new,
    move_sensor_blocks,
    pick_models,
    rank_findings,
    state_one_change,
)
from dehyst.models.model import Block, Hysteresis, Model, Validity


@dataclass(frozen=True)
class F:
    """The fields of a finding that the ranking uses."""

    name: str
    share: float = 0.5
    place: str = "stage"
    near: InitVar[tuple[str, ...]] = ()
    ambiguous_with: tuple[str, ...] = ()

    def __post_init__(self, near: tuple[str, ...]) -> None:
        object.__setattr__(self, "ambiguous_with", self.ambiguous_with or near)


def alone(
    name: str,
    new: float,
    place: str = "stage",
    left: float = 0.0,
    confused_with: tuple[str, ...] = (),
) -> WeighedCause:
    plain = Hysteresis(np.zeros(1), np.ones(1), np.array([0.0, 1.0]))
    tag = f"{name}-{place}"  # distinguishes the models
    model = Model(plain, Validity(0.0, 1.0), tag)
    return WeighedCause(Cause(name, place, "", model, confused_with), left, new)


def test_what_is_new_is_reported_first() -> None:
    found = [F(name) for name in ("unknown", "shape", "creep", "rate", "lag")]
    causes = [alone("lag", 0.04), alone("creep", 0.01)]
    for least, expected in (
        (0.005, ["lag", "creep", "shape", "rate", "unknown"]),
        (0.020, ["lag", "shape", "creep", "rate", "unknown"]),
        (0.100, ["shape", "lag", "creep", "rate", "unknown"]),
    ):
        names = [f.name for f in rank_findings(found, causes, least, 0.0)]  # type: ignore[arg-type]
        assert names == expected


def test_what_is_little_beside_a_cause_that_the_diagnosis_does_not_name_is_not_first() -> None:
    """A cause that removes little is not first if the diagnosis does not name it: friction, which
    the refitted loop absorbs, together with a lag of a few milliseconds."""
    found = [F("lag"), F("shape", near=("friction",)), F("creep")]
    for lag, expected in ((0.0055, "shape"), (0.0200, "lag")):
        causes = [alone("friction", 0.0466), alone("lag", lag, "sensor")]
        ranked = rank_findings(found, causes, 0.0052, 0.0005)  # type: ignore[arg-type]
        assert ranked[0].name == expected


def test_of_what_does_as_well_the_diagnosis_share_decides() -> None:
    found = [F("lag", 0.1), F("delay", 0.7)]
    causes = [alone("lag", 0.0403), alone("delay", 0.0400)]
    for noise2, expected in ((0.0004, "delay"), (0.0002, "lag")):
        ranked = rank_findings(found, causes, 0.001, noise2)  # type: ignore[arg-type]
        assert ranked[0].name == expected


def test_the_gauge_has_changed_where_nothing_else_does_as_well() -> None:
    lag = F("lag", place="sensor")
    for elsewhere, expected in ((0.0400, False), (0.0300, True)):
        causes = [alone("lag", 0.0402, "sensor"), alone("lag", elsewhere, "drive")]
        assert is_of_sensor(lag, causes, 0.0004) is expected  # type: ignore[arg-type]
    assert is_of_sensor(lag, causes[:1], 0.0004)  # type: ignore[arg-type]
    assert not is_of_sensor(F("lag", place="drive"), causes, 0.0004)  # type: ignore[arg-type]
    causes.append(alone("delay", 0.0400, "drive"))
    assert is_of_sensor(lag, causes, 0.0004)  # type: ignore[arg-type]
    tied = F("lag", place="sensor", near=("delay",))
    assert not is_of_sensor(tied, causes, 0.0004)  # type: ignore[arg-type]


def test_what_was_named_is_tried_and_what_does_better_among_its_ties() -> None:
    causes = [
        alone("rate", 0.05), alone("lag", 0.045, "sensor"), alone("lag", 0.04, "drive"),
        alone("creep", 0.01), alone("delay", -0.01),
    ]  # fmt: skip
    first = F("lag", near=("rate", "delay"))
    for noise2, expected in ((0.005, ["lag-drive", "rate-stage"]), (0.02, ["lag-drive"])):
        picked = pick_models(first, causes, noise2)  # type: ignore[arg-type]
        assert [m.drive_unit for m in picked] == expected
    del causes[2]
    picked = pick_models(first, causes, 0.02)  # type: ignore[arg-type]
    assert [m.drive_unit for m in picked] == ["rate-stage"]


LEFT = ChangeResiduals(in_use=0.40, when_good=0.05, found=0.18, noise=0.03)


def test_one_change_that_explains_all_that_is_new_is_found_beside_the_diagnosis() -> None:
    found = [F("lag"), F("shape"), F("unknown")]
    mode = alone("resonance", 0.158, left=0.05)
    causes = [mode, alone("lag", 0.09, "sensor", 0.26)]
    assert find_one_change(found, causes, LEFT) is mode  # type: ignore[arg-type]
    tied = [F("lag", near=("resonance",)), *found[1:]]  # may be the mode
    assert find_one_change(tied, causes, LEFT) is mode  # type: ignore[arg-type]
    reported = state_one_change(mode, causes, LEFT, found[0])
    assert (reported.name, reported.place, reported.ambiguous_with) == ("resonance", "stage", ())
    assert reported.share == pytest.approx(0.158 / (0.40**2 - 0.03**2))
    near = state_one_change(mode, [*causes, alone("delay", 0.1575, left=0.051)], LEFT, found[0])
    assert near.ambiguous_with == ("delay",)


@pytest.mark.parametrize(
    ("found", "left", "limits"),
    [
        ([F("resonance")], 0.05, LEFT),  # the diagnosis names it
        (
            [F("lag", near=("resonance",)), F("creep")],
            0.05,
            LEFT,
        ),  # the lag may be the mode
        ([F("lag")], 0.05, LEFT),  # the diagnosis, too, has a single name
        ([F("lag"), F("creep")], 0.25, LEFT),  # the diagnosis explains more
        ([F("lag"), F("creep")], 0.20, LEFT._replace(found=0.30)),  # both leave much
        ([F("shape")], 0.09, LEFT._replace(found=0.03)),  # a shape explains what the mode does not
        ([F("shape")], 0.05, LEFT._replace(found=0.03, when_good=math.nan)),
        ([F("shape")], 0.05, LEFT._replace(when_good=0.40)),  # the residual is not new
    ],
)
def test_else_the_diagnosis_stands(found: list[F], left: float, limits: ChangeResiduals) -> None:
    new = 0.16 - left**2
    lag = alone("lag", new - 0.0008, left=math.sqrt(0.1608 - new))
    causes = [alone("resonance", new, left=left), lag]
    assert find_one_change(found, causes, limits) is None  # type: ignore[arg-type]
    assert find_one_change(found, [], limits) is None  # type: ignore[arg-type]


def test_an_effect_that_looks_like_another_is_named_where_alone_it_explains_more() -> None:
    """Friction, which a refitted base shows as an asymmetry; the model in use leaves more than the
    noise of the good recording."""
    left = ChangeResiduals(in_use=0.287, when_good=0.0725, found=0.028, noise=0.0216)
    found = [F("asymmetry"), F("shape"), F("creep")]
    friction = alone("friction", 0.0740, left=0.0917, confused_with=("shape", "asymmetry"))
    causes = [friction, alone("asymmetry", 0.0722, left=0.1008)]
    assert find_one_change(found, causes, left) is friction  # type: ignore[arg-type]
    assert not explains_all(friction, left)
    named = state_one_change(friction, causes, left, found[0])  # type: ignore[arg-type]
    assert (named.name, named.ambiguous_with) == ("friction", ("asymmetry",))
    stranger = [alone("friction", 0.0740, left=0.0917), causes[1]]  # not said to look alike
    assert find_one_change(found, stranger, left) is None  # type: ignore[arg-type]
    little = [replace(friction, left=0.15), causes[1]]  # it leaves more than the allowed part
    assert find_one_change(found, little, left) is None  # type: ignore[arg-type]


def test_what_explains_all_that_is_new_gives_way_to_nothing_richer() -> None:
    """A lag, which weights that follow the rate imitate and describe a little better, since they
    also take up some of what the model in use left before."""
    left = ChangeResiduals(in_use=0.254, when_good=0.0760, found=0.022, noise=0.0216)
    found = [F("lag", near=("rate",)), F("shape"), F("creep")]
    lag, rate = alone("lag", 0.0544, left=0.0711), alone("rate", 0.0555, left=0.0633)
    assert leaves_nothing_new(found[0], [rate, lag], left)  # type: ignore[arg-type]
    assert find_one_change(found, [rate, lag], left) is None  # type: ignore[arg-type]
    little = replace(lag, left=0.0940)
    assert not leaves_nothing_new(found[0], [rate, little], left)  # type: ignore[arg-type]
    assert find_one_change(found, [rate, little], left) is rate  # type: ignore[arg-type]
    assert not leaves_nothing_new(F("creep"), [rate, lag], left)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("new", "left_by_it", "when_good", "expected"),
    [
        (0.0720, 0.0917, 0.0725, ("friction",)),
        (0.0700, 0.0917, 0.0725, ("friction",)),  # the model in use already leaves as much
        (0.0700, 0.0917, math.nan, ()),
        (0.0600, 0.0917, 0.0725, ()),
        (0.0720, 0.1500, 0.0725, ()),
    ],
)
def test_what_looks_like_the_first_finding_and_explains_as_much_stands_beside_it(
    new: float, left_by_it: float, when_good: float, expected: tuple[str, ...]
) -> None:
    left = ChangeResiduals(in_use=0.287, when_good=when_good, found=0.028, noise=0.0216)
    causes = [
        alone("asymmetry", 0.0722, left=0.0930),
        alone("friction", new, left=left_by_it, confused_with=("asymmetry",)),
        alone("rate", 0.0722, left=0.0930),
    ]
    first = add_rivals(F("asymmetry"), causes, left)  # type: ignore[arg-type]
    assert first.ambiguous_with == expected


def lagging(place: str, kind: str = "lag") -> Model:
    plain = Hysteresis(np.zeros(1), np.ones(1), np.array([0.0, 1.0]))
    return Model(plain, Validity(0.0, 1.0), "v", blocks=(Block(kind, place, {"tau_s": 0.01}),))


PLAIN = replace(lagging("sensor"), blocks=())


@pytest.mark.parametrize(
    ("elsewhere", "expected"),
    [(0.0310, "drive"), (0.0302, "drive"), (0.0200, "stage"), (None, "sensor")],
)
def test_a_lag_that_may_be_the_stages_is_not_left_at_the_gauge(
    elsewhere: float | None, expected: str
) -> None:
    """The written model has the lag at the gauge, where nothing would compensate it, beside a
    change of the stage: a lag at the gauge shows much of that change too."""
    causes = [
        WeighedCause(Cause("lag", place, "", lagging(place)), 0.07, new)
        for place, new in (("drive", elsewhere), ("sensor", 0.0302))
        if new is not None
    ]
    found = [F("rate"), F("lag", place="sensor")]
    model = move_sensor_blocks(lagging("sensor"), PLAIN, found, causes, 0.0005)  # type: ignore[arg-type]
    assert [b.place for b in model.blocks] == [expected]
    other = move_sensor_blocks(lagging("sensor", "delay"), PLAIN, found, causes, 0.0005)  # type: ignore[arg-type]
    assert [b.place for b in other.blocks] == ["sensor"]  # a block without such a cause stays


def test_a_lag_goes_where_a_lag_acts_not_where_what_it_looks_like_does() -> None:
    causes = [
        alone("rate", 0.0910),
        WeighedCause(Cause("lag", "drive", "", lagging("drive")), 0.05, 0.0908),
        WeighedCause(Cause("lag", "sensor", "", lagging("sensor")), 0.06, 0.0905),
    ]
    found = [F("lag", place="sensor", near=("rate",))]
    known = move_sensor_blocks(lagging("sensor"), lagging("sensor"), found, causes, 0.0005)  # type: ignore[arg-type]
    assert [b.place for b in known.blocks] == ["sensor"]  # the model in use has it at the gauge
    model = move_sensor_blocks(lagging("sensor"), PLAIN, found, causes, 0.0005)  # type: ignore[arg-type]
    assert [b.place for b in model.blocks] == ["drive"]
