"""Messages from a browser: each one is either understood or refused with a reason."""

import json
from contextlib import suppress
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.page import wire
from dehyst.models.errors import BadInput

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=12,
)
NEAR = st.fixed_dictionaries(
    {"ask": st.sampled_from(["look", "past", "go", "hold", "play", "stop", "decide"]) | JSON},
    optional=dict.fromkeys(
        ("name", "window_s", "width_px", "first_s", "end_s", "value", "seconds", "job", "offer"),
        JSON,
    ),
)


@given(
    st.binary(max_size=200).map(lambda data: {"bytes": data})
    | st.text(max_size=200).map(lambda text: {"text": text})
    | (JSON | NEAR).map(lambda data: {"text": json.dumps(data)})
    | st.integers(1, 70_000).map(lambda n: {"text": '{"x":' + "[" * n})
)
def test_any_message_is_understood_or_refused_in_words(message: dict[str, Any]) -> None:
    with suppress(BadInput):
        assert isinstance(wire.read_ask(message), wire.Ask)
