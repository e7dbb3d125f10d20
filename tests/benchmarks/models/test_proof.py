"""The proof judges correctly: a perfect answer meets every bar, an empty one misses them, and a
plan's statements about a stage agree with figures computed here."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.benchmarks.models.proof import limits
from tests.benchmarks.models.proof.base import RichBase, least_left, rms
from tests.benchmarks.models.proof.families import COUNTS, cases, parse, plan
from tests.benchmarks.models.proof.recorder import Rig
from tests.benchmarks.models.proof.score import Truth, converted, figures, score
from tests.benchmarks.models.proof.stages import HELD, Case, Hidden, Wanted, make_case
from tests.benchmarks.models.proof.tables import bars_of, wrong
from tests.rigs.hardware_stages import make_rig

from dehyst.models.diagnosis import diagnose

Row = dict[str, Any]
RIG = Rig()
UM_MV = Rig(drive_unit="v", low=-75.0, high=75.0, unit="nm", per_um=1000.0)


def hidden(name: str, left: float = 3.0, ties: tuple[str, ...] = (), **truth: float) -> Hidden:
    return Hidden(name, "by hand", "stage", left, 0.5, ties, truth)


STAGES = [
    ("single", True, (hidden("delay", delay_s=2e-3),)),
    ("pair", True, (hidden("creep", gain_per_decade=0.02), hidden("hum", amplitude=0.1))),
    ("triple", False, (hidden("creep"), hidden("hum"), hidden("coupling"))),
    ("clean", False, ()),
    ("clean", True, ()),
    ("shape", False, (hidden("shape"),)),
    ("outside", True, (hidden("unknown"),)),
]


def effect(name: str, ties: tuple[str, ...] = (), **stated: float) -> Row:
    parameters = {k: {"value": v, "low": 0.9 * v, "high": 1.1 * v} for k, v in stated.items()}
    tied = list(ties)
    return {"name": name, "acts_on": "stage", "ambiguous_with": tied, "parameters": parameters}


def perfect(truth: Truth) -> Row:
    rename = {"amplitude": "amplitude_um"}
    effects = [
        effect(h.name, **{rename.get(k, k): v for k, v in h.truth.items()}) for h in truth.hidden
    ]
    if truth.bent and not any(h.name == "shape" for h in truth.hidden):
        effects.append(effect("shape"))
    verdict = "partly" if truth.outside else "explained" if effects else "clean"
    return {"verdict": verdict, "effects": effects, "would_have_seen": []}


def row(family: str, truth: Truth, said: Row, after: float = 0.2, limit: bool = True) -> Row:
    return {
        "case": f"{family}-0", "family": family, "truth": truth.to_dict(), "answer": said,
        "score": score(truth, said, RIG), "seconds": 1.0,
        "figures": {
            "model": 3.0, "held_model": 3.0, "held_augmented": after, "noise_said": 1.0,
            "disagrees": 1.0,
        },
        "fault": "",
        "limits": [
            {"limit": "lag above 1", "name": "lag", "left": 1.0, "true": limit, "answer": "clean"}
        ],
    }  # fmt: skip


def all_rows(answer: Any, **kinds: Any) -> list[Row]:
    truths = [(family, Truth(h, foreign)) for family, foreign, h in STAGES]
    return [row(family, truth, answer(truth), **kinds) for family, truth in truths]


def test_a_perfect_answer_holds_every_bar() -> None:
    rows = all_rows(perfect)
    bars = bars_of(rows)
    assert bars.code == 0, bars.table()
    assert [wrong(r) for r in rows] == [[]] * len(rows)


def test_an_empty_answer_misses_what_is_to_be_named() -> None:
    rows = all_rows(lambda truth: {"verdict": "clean", "effects": [], "would_have_seen": []})
    held = {r.name: r.held for r in bars_of(rows).rows}
    assert bars_of(rows).code == 1
    for name in ("single effect named first", "two or three effects: all named", "shape named"):
        assert held[name] is False
    assert held["outside the library: reported"] is False
    assert held["no effect: no physics named"] is True  # reporting nothing is not a false alarm


@pytest.mark.parametrize(
    ("missed", "rows"),
    [
        ("no effect: no physics named", lambda: [bad("clean", False, (), [effect("lag")])]),
        ("no effect: no physics named", lambda: [bad("clean", False, (), [effect("shape")])]),
        ("names that are spurious", lambda: [bad("clean", True, (), [effect("creep")])]),
        ("exclusion limits, asked again: false", lambda: all_rows(perfect, limit=False)),
        ("written model worse held out by a noise", lambda: worse(4.1)),
        ("explained, and over 1.5 noises left held out", lambda: worse(1.6)),
        ("parameters inside their interval", lambda: [off_by_a_fifth()]),
        ("limits that what is there proves false", lambda: [blind()]),
        ("answers against their own rules", lambda: [rash()]),
    ],
)
def test_each_mistake_is_noticed(missed: str, rows: Any) -> None:
    held = {r.name: r.held for r in bars_of(rows()).rows}
    assert held[missed] is False
    assert all(wrong(r) for r in rows())


def worse(after: float) -> list[Row]:
    """Return stages with an effect whose held-out drive leaves the written model this much."""
    rows = all_rows(perfect, after=after)
    return [r for r in rows if r["answer"]["verdict"] == "explained"]


def test_a_written_model_that_hardly_ever_predicts_better_is_noticed() -> None:
    rows = [row("single", Truth(h, True), perfect(Truth(h, True)), 3.5) for _, _, h in STAGES[:2]]
    held = {r.name: r.held for r in bars_of(rows).rows}
    assert held["written model better held out, where named"] is False


def bad(family: str, foreign: bool, there: tuple[Hidden, ...], said: list[Row]) -> Row:
    answer = {"verdict": "explained", "effects": said, "would_have_seen": []}
    return row(family, Truth(there, foreign), answer)


def off_by_a_fifth() -> Row:
    return bad("single", True, (hidden("delay", delay_s=2e-3),), [effect("delay", delay_s=2.4e-3)])


def blind() -> Row:
    said = {"name": "delay", "above": 9.9e-5, "unit": "s"}
    answer = {"verdict": "clean", "effects": [], "would_have_seen": [said]}
    return row("single", Truth((hidden("delay", delay_s=3e-4),), True), answer)


def rash() -> Row:
    one = row("clean", Truth((), True), perfect(Truth((), True)))
    limit = {"name": "friction", "above": 1.0, "unit": "um"}
    said = {
        **one["answer"], "effects": [effect("shape", ("friction",))], "would_have_seen": [limit],
    }  # fmt: skip
    return row("clean", Truth((), True), said)


def test_a_line_on_a_harmonic_of_the_drive_is_not_asked_for() -> None:
    own = replace(plan(5, "waveform", 0), effects=(Wanted("hum", 3.0, True),))
    hz = make_case(own).hidden[0].truth["frequency_hz"]
    beside = replace(own, repeats_hz=hz / 25.5)
    assert make_case(beside).hidden[0].separable
    on = replace(own, repeats_hz=hz / 25.0)
    assert make_case(on).hidden[0].blind
    assert not make_case(on).hidden[0].separable


def test_a_double_counts_only_where_both_say_that_it_is_one() -> None:
    def first(ties: tuple[str, ...], said: tuple[str, ...]) -> bool:
        there = (hidden("lag", ties=ties),)
        return bool(bad("single", True, there, [effect("delay", said)])["score"]["first_right"])

    assert first(("delay",), ("lag",))
    assert not first(("delay",), ())
    assert not first((), ("lag",))


def test_a_resistor_before_a_current_limit_is_a_lag_and_a_bare_limit_has_none() -> None:
    said = [effect("slew"), effect("lag")]
    assert not wrong(bad("single", True, (hidden("slew"),), said))
    assert wrong(bad("single", True, (hidden("slew", rate=100.0),), said))


def test_what_cannot_be_distinguished_is_not_asked_for_and_is_not_spurious() -> None:
    there = (hidden("creep", left=0.8),)
    assert not wrong(bad("single", True, there, []))
    assert not wrong(bad("single", True, there, [effect("creep")]))


def test_parameters_are_converted_to_the_recordings_units() -> None:
    assert converted("rate", 100.0, UM_MV) == 1500.0
    assert converted("max", 9.0, UM_MV) == 60.0
    assert converted("amplitude", 0.1, UM_MV) == 100.0
    assert converted("delay_s", 0.1, UM_MV) == 0.1


def test_every_family_makes_plans_that_follow_from_seed_and_name() -> None:
    names = cases(sum(COUNTS.values()))
    assert len(names) == len(set(names)) == 236
    assert {parse(n)[0] for n in names} == set(COUNTS)
    assert [names.count(f"{f}-0") for f in COUNTS] == [1] * len(COUNTS)
    assert plan(5, "units", 1).rig == plan(5, "units", 1).rig
    assert plan(5, "clean", 0).seed != plan(6, "clean", 0).seed
    with pytest.raises(ValueError, match="no such case"):
        parse("past")


def made(family: str, number: int, maker: str, size: float = 3.0, own: bool = True) -> Case:
    return make_case(replace(plan(5, family, number), effects=(Wanted(maker, size, own),)))


def added(case: Case, name: str) -> Any:
    return case.stage.read(case.chain, name) - case.stage.read([], name)


def test_a_delay_in_the_stage_is_a_delay_of_its_reading() -> None:
    case = made("single", 2, "delay")
    late = case.hidden[0].truth["delay_s"]
    y, x = case.stage.read(case.chain, "identify"), case.stage.read([], "identify")
    t = np.arange(x.size) * 1e-3
    shifts = np.arange(0.0, 0.04, 2e-5)
    error = [rms((y - np.interp(t - s, t, x))[1500:]) for s in shifts]
    assert shifts[int(np.argmin(error))] == pytest.approx(late, abs=6e-5)


def test_a_hum_in_the_stage_has_its_amplitude_at_its_frequency() -> None:
    case = made("single", 7, "hum")
    truth, d = case.hidden[0].truth, added(case, "hold")
    t = np.arange(d.size) * 1e-3
    phasor = 2 * np.mean(d * np.exp(-2j * np.pi * truth["frequency_hz"] * t))
    assert abs(phasor) == pytest.approx(truth["amplitude"], rel=0.01)
    assert case.hidden[0].left == pytest.approx(
        truth["amplitude"] / np.sqrt(2) / case.noise, rel=0.05
    )


def test_creep_of_a_move_before_the_recording_goes_on_in_it() -> None:
    case = made("past", 0, "creep")
    table, d = case.tables["scan-1"], added(case, "scan-1")
    before, g, level = case.plan.before_s, case.hidden[0].truth["gain_per_decade"], 0.0
    level = case.stage.read([], "scan-1")[0]
    rest = table.t_s < 0.02  # the scan has only just begun
    want = g * level * np.log10(1.0 + (table.t_s[rest] + before) / 0.1)
    np.testing.assert_allclose(d[rest], want, atol=0.05 * g * level)
    assert d[0] > 0.5 * g * level


def test_a_rich_base_takes_a_bend_and_leaves_a_clock() -> None:
    t = np.arange(6000) * 1e-3
    u = 5.0 - 4.5 * np.cos(2 * np.pi * 1.3 * t) * (0.4 + 0.6 * t / 6.0)
    base = RichBase([u], 1e-3)
    assert rms(base.residual(0.02 * u**2)) < 1e-3
    line = 0.1 * np.sin(2 * np.pi * 47.3 * t)
    assert rms(base.residual(line)) == pytest.approx(0.1 / np.sqrt(2), rel=0.05)
    slow = base.lags_of(u)
    assert least_left(base.residual(0.02 * np.gradient(u, 1e-3)), slow) < 0.2 * rms(
        base.residual(0.02 * np.gradient(u, 1e-3))
    )


@pytest.mark.parametrize("fault", ["every third reading missing", "stalls", "rows missing"])
def test_faults_take_away_what_they_say(fault: str) -> None:
    case = make_case(replace(plan(5, "clean", 1), fault=fault))
    whole = make_case(plan(5, "clean", 1))
    given, all_of_it = case.given()[0], whole.given()[0]
    missing = int(given.missing_displacement.sum()) / given.size
    lost = 1.0 - given.size / all_of_it.size
    if fault == "every third reading missing":
        assert missing == pytest.approx(1 / 3, abs=1e-3)
        assert lost == 0
    else:
        assert missing == 0
        assert 0.005 < lost < 0.07
    assert case.recording(HELD).size == whole.recording(HELD).size


@pytest.mark.parametrize("name", list(limits.MAKERS))
def test_a_limit_is_put_into_the_stage_at_its_size(name: str) -> None:
    case = make_case(plan(5, "clean", 1))
    values = {"slew": 40.0, "clip": 6.0, "resonance": 60.0, "delay": 3e-3, "lag": 3e-3}
    side = "below" if name in ("slew", "clip", "resonance") else "above"
    limit = {"name": name, side: values.get(name, 0.05), "unit": "?"}
    more = limits.beyond(case, limit, np.random.default_rng(1))
    y = [r.displacement for r in case.given(more)]
    x = [r.displacement for r in case.given()]
    change = rms(np.concatenate([a - b for a, b in zip(y, x, strict=True)]))
    assert 0.002 < change < 3.0
    if name == "hum":  # a sine slightly larger than the limit
        assert change == pytest.approx(1.05 * 0.05 / np.sqrt(2), rel=0.02)


def test_a_quiet_stage_follows_another_drive_no_worse_than_by_the_model_in_use() -> None:
    """Sines and a hold of a Preisach stage, with almost no noise: where the recordings do not
    decide, the prediction is that of the model in use."""
    case = make_case(plan(20440, *parse("quiet-5")))
    d = diagnose(case.given(), with_limits=False)
    assert d.findings[0].name == "shape"
    assert d.verdict == "partly"
    reached = figures(case, d)
    assert d.model == d.base_model or reached["held_augmented"] < reached["held_model"]


def test_a_recording_that_shows_most_of_an_effect_belongs_to_the_others() -> None:
    """The loop widens with the rate, of which the two sines of one recording show most."""
    case = make_case(plan(662911, *parse("single-9")))
    d = diagnose(case.given(), with_limits=False)
    assert d.findings[0].name == "rate"
    assert {view.name for view in d.views} == {one.name for one in case.given()}


def test_a_small_effect_of_the_drive_that_predicts_nothing_is_not_named() -> None:
    """A clean Preisach stage: a bent sensor fits 3 % of the misfit, and predicts no better what
    was left out."""
    found = diagnose(make_case(plan(551237, *parse("faults-0"))).given(), with_limits=False)
    assert [finding.name for finding in found.findings] == ["shape"]


def test_an_effect_without_which_the_written_model_predicts_all_is_not_named() -> None:
    """Presliding friction: the loop is steeper after each turn. Friction that depends on the speed
    seemed to explain all of that in one recording, but the loop's shape leaves less."""
    case = make_case(plan(730418, *parse("shape-22")))
    found = diagnose(case.given(), with_limits=False)
    assert [finding.name for finding in found.findings] == ["shape"]
    assert found.rms["heldout_augmented"] < 0.1 * found.rms["heldout_model"]


def test_what_no_reading_determines_before_a_first_move_does_not_hide_a_mode() -> None:
    """A stage rests, its past unknown, and the first move makes it ring. The loop that was fitted
    to the rows after that stood at four times the range before it, and any mode rang on from
    there."""
    found = diagnose(make_case(plan(730418, *parse("units-9"))).given(), with_limits=False)
    assert found.findings[0].name == "resonance"
    assert found.rms["heldout_augmented"] < 1.5 * found.noise < found.rms["heldout_model"]


@pytest.mark.parametrize(("seed", "case"), [(551237, "past-14"), (730418, "past-16")])
def test_a_drift_from_before_two_recordings_is_no_creep(seed: int, case: str) -> None:
    """Creep that starts from where a drifting stage was read has the drift in it already."""
    found = diagnose(make_case(plan(seed, *parse(case))).given(), with_limits=False)
    assert found.findings[0].name == "drift"
    assert found.rms["heldout_augmented"] < 1.5 * found.noise < found.rms["heldout_model"]


def test_the_shape_of_one_waveform_explains_no_other() -> None:
    """A mode that the only recording hardly excites: a shape fits that recording to the noise, and
    another waveform was left with 2.6 noises."""
    rig = make_rig(730418, 31)
    found = diagnose(rig.given, with_limits=False)
    assert len(rig.given) == 1
    assert found.findings[0].name == "shape"
    assert found.rms["heldout_augmented"] < 1.3 * rig.noise
    assert found.verdict == "partly"


def test_what_two_recordings_do_not_predict_of_each_other_is_not_explained() -> None:
    """A stage warms up from moves that nobody recorded, at another pace in each recording. In each
    a drift leaves little, whichever time is left out, but a third recording drifts otherwise."""
    case = make_case(plan(830117, "past", 4))
    d = diagnose(case.given(), with_limits=False)
    assert d.verdict == "partly"
    assert any("fitted to one of the two recordings" in text for text in d.data.says)
    assert d.rms["heldout_augmented"] < 1.5 * d.noise
    assert d.findings[0].name == "drift"
    assert figures(case, d)["held_augmented"] > 1.5


def test_a_quick_drive_next_to_a_mode_is_no_held_one() -> None:
    """Straight lines cut a quick drive's peaks off, and a hold that makes up for that is half a
    sample ahead, which became a delay."""
    found = diagnose(make_rig(531977, 43).given, with_limits=False)
    assert {f.name for f in found.findings} <= {"resonance", "shape"}
    assert not [said for said in found.data.says if "held, not ramped" in said]


def test_a_delay_by_part_of_a_sample_next_to_a_mode() -> None:
    case = make_case(plan(531977, *parse("pair-15")))
    (delay_s,) = (e.truth(s)["delay_s"] for e, s in case.chain if e.name == "delay")
    found = diagnose(case.given(), with_limits=False)
    (stated,) = (f.parameters["delay_s"] for f in found.findings if f.name == "delay")
    assert stated.low < delay_s < stated.high
    assert abs(stated.value - delay_s) < 0.1e-3


def test_a_model_that_the_recordings_do_not_determine_elsewhere_explains_nothing() -> None:
    """Three recordings of a Preisach stage: the model without any of them predicts that one to 1.3
    noises, another drive to 1.9."""
    case = make_case(plan(531977, *parse("pair-0")))
    found = diagnose(case.given(), with_limits=False)
    assert {"slew", "coupling"} <= {f.name for f in found.findings}
    assert figures(case, found)["held_augmented"] > 1.5
    assert found.verdict == "partly"
    assert any("record loops of several sizes" in text for text in found.data.says)
