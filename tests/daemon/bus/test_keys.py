"""Keys of the bus: a key that is built is parsed back; zenoh itself decides what matches."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.bus import topics
from dehyst.daemon.bus.keys import DAEMON, Keys, ParsedKey
from dehyst.models.errors import BadInput

CHUNK = st.from_regex(r"[a-z0-9_-]{1,63}", fullmatch=True)


@given(CHUNK, CHUNK, CHUNK, CHUNK)
def test_built_keys_parse_back(base: str, name: str, subject: str, source: str) -> None:
    keys = Keys(f"{base}/lab", name)
    assert keys.parse(keys.pubsub(subject, source)) == ParsedKey(name, "pubsub", subject, source)
    assert keys.parse(keys.rpc("model")) == ParsedKey(name, "rpc", "model")
    assert keys.parse(keys.alive()) == ParsedKey(name, "alive")
    zenoh.KeyExpr(keys.pubsub(subject, source))  # zenoh accepts it


@given(st.text(max_size=60))
def test_anything_else_is_refused(text: str) -> None:
    keys = Keys("dehyst", "stage")
    for key in (text, f"dehyst/@v1/{text}", f"dehyst/@v1/stage/pubsub/{text}"):
        try:
            parsed = keys.parse(key)
        except BadInput:
            continue
        assert parsed.space in ("pubsub", "rpc", "alive")
        assert "*" not in key
        assert "$" not in key


def test_wildcards_match_what_they_should_and_no_other_version() -> None:
    keys = Keys("dehyst", "a")
    setpoints = zenoh.KeyExpr(keys.setpoints())
    for unit in ("um", "nm", "mrad"):
        assert setpoints.includes(zenoh.KeyExpr(keys.pubsub(f"setpoint_{unit}", "17")))
    assert not setpoints.intersects(zenoh.KeyExpr(keys.pubsub("telemetry")))
    assert not setpoints.intersects(zenoh.KeyExpr(Keys("dehyst", "b").pubsub("setpoint_um", "17")))
    assert zenoh.KeyExpr(Keys("dehyst", "*").alive()).includes(zenoh.KeyExpr(keys.alive()))
    assert not zenoh.KeyExpr("dehyst/**").intersects(zenoh.KeyExpr(keys.alive()))


@pytest.mark.parametrize("bad", ["A", "a b", "", "a/../b", "x*", "@v1", "ü"])
def test_bad_names_are_refused(bad: str) -> None:
    with pytest.raises(BadInput):
        Keys("dehyst", bad)
    with pytest.raises(BadInput):
        Keys("dehyst", "a").pubsub(bad)


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(BadInput, match="methods are"):
        Keys("dehyst", "a").rpc("shutdown")


def test_topics_have_distinct_subjects() -> None:
    keys = Keys("dehyst", "a")
    every = (
        topics.SETPOINT, topics.TELEMETRY, topics.STATUS, topics.EVENT, topics.REJECTION,
    )  # fmt: skip
    built = [keys.pubsub(topics.subject(topic)) for topic in every]
    assert len(set(built)) == len(every)
    assert all(key.endswith(f"/{DAEMON}") for key in built)
