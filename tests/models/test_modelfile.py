"""The model file: an exact round trip, to the last bit; every defect is reported with its key."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.errors import BadModel
from dehyst.models.model import Block, Fit, Hysteresis, Model, Provenance, Validity
from dehyst.models.modelfile import dumps, loads, shipped

ROOT = Path(__file__).parents[2]


def _same(a: Model, b: Model) -> bool:
    arrays = all(np.array_equal(getattr(a.hysteresis, n), getattr(b.hysteresis, n)) for n in "rbkc")
    rest = replace(a, hysteresis=b.hysteresis) == b
    return arrays and rest and a.hysteresis.u_offset == b.hysteresis.u_offset


@pytest.mark.parametrize("name", ["paper-eq11", "paper-eq12"])
def test_shipped_models_survive_the_round_trip(name: str) -> None:
    model = shipped(name)
    assert _same(loads(dumps(model)), model)


numbers = st.floats(-1e6, 1e6, allow_nan=False)


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.floats(0, 100), numbers, numbers), min_size=1, max_size=12),
    st.lists(numbers, min_size=2, max_size=7),
    numbers,
    st.sampled_from(["v", "um", "counts"]),
)
def test_any_model_survives_the_round_trip(
    rows: list[tuple[float, float, float]], c: list[float], offset: float, unit: str
) -> None:
    r, b, k = (np.array(column) for column in zip(*sorted(rows), strict=True))
    model = Model(
        Hysteresis(r=r, b=b, k=k, c=c, u_offset=offset),
        Validity(-1.0, 2.0, 3.0, None, 1e-3),
        drive_unit=unit,
        displacement_unit="nm",
        blocks=(
            Block("coupling", "stage", {"gain_nm_per_unit": 0.5}, "u2_v"),
            Block("polynomial", "sensor", {"coefficients": (0.0, 1.0, 0.1)}),
        ),
        fit=Fit(1.0, None, 0.5),
        provenance=Provenance("now", "0", "a test", (("a.csv", "00ff"),)),
    )
    assert _same(loads(dumps(model)), model)


def _damaged(change: dict[str, object]) -> str:
    data = tomllib.loads(dumps(shipped("paper-eq12")))
    for path, value in change.items():
        *parents, last = path.split(".")
        table = data
        for parent in parents:
            table = table[parent]
        if value is ...:
            del table[last]
        else:
            table[last] = value
    return tomli_w.dumps(data)


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"format": 2}, "format"),
        ({"format": ...}, "format"),
        ({"colour": "red"}, "colour"),
        ({"drive_unit": "furlong"}, "drive_unit"),
        ({"hysteresis": ...}, "hysteresis"),
        ({"hysteresis.weights": ...}, "hysteresis.weights"),
        ({"hysteresis.weights": [1.0]}, "hysteresis"),
        ({"hysteresis.weights": ["a"] * 10}, "hysteresis.weights"),
        ({"hysteresis.thresholds_v": [-1.0] * 10}, "threshold"),
        ({"hysteresis.thresholds_um": [1.0]}, "hysteresis.thresholds_um"),
        ({"hysteresis.saturation_um": [1.0]}, "saturation"),
        ({"hysteresis.saturation_um": [1.0, float("nan")]}, "hysteresis.saturation_um"),
        ({"validity.drive_max_v": -1.0}, "validity.drive_max_v"),
        ({"validity.rate_max_v_per_s": 0.0}, "validity.rate_max_v_per_s"),
        ({"fit.rms_um": -1.0}, "fit.rms_um"),
        ({"fit.rms_um": True}, "fit.rms_um"),
        ({"provenance.source": 3}, "provenance.source"),
        ({"blocks": [{"kind": "lag", "place": "stage", "tau_ms": 1.0}]}, "blocks[0]: tau_ms"),
        ({"blocks": [{"kind": "lag", "tau_s": 1.0}]}, "blocks[0].place"),
        ({"blocks": [{"kind": "slew", "place": "drive", "rate_um_per_s": 1.0}]}, "rate_um_per_s"),
        ({"blocks": 3}, "blocks"),
    ],
)
def test_damage_is_named_by_its_key(change: dict[str, object], names: str) -> None:
    with pytest.raises(BadModel, match=re.escape(names)):
        loads(_damaged(change))


@pytest.mark.parametrize("key", ["slopes_s_per_v", "drive_offset_v"])
@pytest.mark.parametrize("name", ["paper-eq11", "paper-eq12"])
def test_a_key_whose_absence_would_change_the_model_is_missed(name: str, key: str) -> None:
    """Models of later versions always have both keys; those of the first versions left out what
    was 0, and still do, so that their digests stay."""
    model = shipped(name)
    later = replace(model, provenance=Provenance(version="0.3.0"))
    assert _same(loads(dumps(later)), later)
    data = tomllib.loads(dumps(later))
    del data["hysteresis"][key]
    with pytest.raises(BadModel, match=f"hysteresis.{key}: this key is missing"):
        loads(tomli_w.dumps(data))
    for version in ("0.1.0", "0.2.0"):
        earlier = replace(model, provenance=Provenance(version=version))
        assert "drive_offset_v" not in dumps(earlier)
        assert ("slopes_s_per_v" in dumps(earlier)) == (name == "paper-eq12")
        assert _same(loads(dumps(earlier)), earlier)


@pytest.mark.parametrize(
    "path", [p for p in ROOT.glob("[dm]*/**/*.toml") if "[hysteresis]" in p.read_text("utf-8")]
)
def test_every_model_in_the_tree_can_be_read(path: Path) -> None:
    loads(path.read_text("utf-8"))


def test_text_that_is_no_toml() -> None:
    with pytest.raises(BadModel, match="TOML"):
        loads("format = = 1")
    with pytest.raises(BadModel):
        shipped("paper-eq99")
