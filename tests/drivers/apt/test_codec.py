"""APT messages: golden bytes, layouts, and resynchronisation after garbage."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import HOST, MESSAGES, UNIT, Decoder, encode_apt
from dehyst.drivers.interface import ProtocolError

# a request or reply, and its bytes written by hand from the protocol document's layouts
GOLDEN = [
    (("hw_req_info", {}, HOST, UNIT), "05 00 00 00 50 01"),
    (("hw_stop_updatemsgs", {}, HOST, UNIT), "12 00 00 00 50 01"),
    (("tsg_req_reading", {"chan": 1}, HOST, UNIT), "dd 07 01 00 50 01"),
    (
        ("tsg_get_reading", {"chan": 1, "reading": -2, "smoothed": 0xFFFE}, UNIT, HOST),
        "de 07 06 00 81 50 01 00 fe ff fe ff",
    ),
    (("pz_set_zero", {"chan": 1}, HOST, UNIT), "58 06 01 00 50 01"),
    (("pz_req_maxtravel", {"chan": 1}, HOST, UNIT), "50 06 01 00 50 01"),
    (
        ("pz_get_maxtravel", {"chan": 1, "travel_100nm": 200}, UNIT, HOST),
        "51 06 04 00 81 50 01 00 c8 00",
    ),
    (
        (
            "tsg_set_iosettings",
            {
                "chan": 1,
                "analog_out": 2,
                "display_mode": 1,
                "force_calibration": 1000,
                "reserved": 0,
            },
            HOST,
            UNIT,
        ),
        "da 07 0e 00 d0 01 01 00 02 00 01 00 e8 03 00 00 00 00 00 00",
    ),
    (("pz_req_pzstatusupdate", {"chan": 1}, HOST, UNIT), "60 06 01 00 50 01"),
    (("pz_ack_pzstatusupdate", {}, HOST, UNIT), "62 06 00 00 50 01"),
    (("mod_set_chanenablestate", {"chan": 1, "state": 1}, HOST, UNIT), "10 02 01 01 50 01"),
    (("mod_req_chanenablestate", {"chan": 1}, HOST, UNIT), "11 02 01 00 50 01"),
    (("mod_get_chanenablestate", {"chan": 1, "state": 2}, UNIT, HOST), "12 02 01 02 01 50"),
    (("pz_set_poscontrolmode", {"chan": 1, "mode": 1}, HOST, UNIT), "40 06 01 01 50 01"),
    (("pz_req_poscontrolmode", {"chan": 1}, HOST, UNIT), "41 06 01 00 50 01"),
    (("pz_get_poscontrolmode", {"chan": 1, "mode": 2}, UNIT, HOST), "42 06 01 02 01 50"),
    (
        ("pz_set_outputvolts", {"chan": 1, "voltage": 0x1234}, HOST, UNIT),
        "43 06 04 00 d0 01 01 00 34 12",
    ),
    (("pz_req_outputvolts", {"chan": 1}, HOST, UNIT), "44 06 01 00 50 01"),
    (
        ("pz_get_outputvolts", {"chan": 1, "voltage": -2}, UNIT, HOST),
        "45 06 04 00 81 50 01 00 fe ff",
    ),
    (("pz_req_inputvoltssrc", {"chan": 1}, HOST, UNIT), "53 06 01 00 50 01"),
    (
        ("pz_get_inputvoltssrc", {"chan": 1, "inputs": 2}, UNIT, HOST),
        "54 06 04 00 81 50 01 00 02 00",
    ),
    (("pz_req_tpz_iosettings", {"chan": 1}, HOST, UNIT), "d5 07 01 00 50 01"),
    (
        (
            "pz_get_tpz_iosettings",
            {"chan": 1, "voltage_limit": 3, "hub_analog_input": 2, "future_1": 0, "future_2": 0},
            UNIT,
            HOST,
        ),
        "d6 07 0a 00 81 50 01 00 03 00 02 00 00 00 00 00",
    ),
]


@pytest.mark.parametrize(("message", "expected"), GOLDEN, ids=[m[0] for m, _ in GOLDEN])
def test_golden_bytes_both_ways(message: tuple, expected: str) -> None:
    name, values, source, destination = message
    raw = bytes.fromhex(expected)
    assert encode_apt(name, source=source, destination=destination, **values) == raw
    (found,) = Decoder((destination,), (source,)).feed(raw)
    assert found.name == name
    assert {key: found.values[key] for key in values} == values


def test_sizes_and_ids_of_the_protocol() -> None:
    sizes = {m.name: codec.HEADER.size + m.size for m in MESSAGES if m.data}
    assert sizes["hw_get_info"] == 90
    assert sizes["tsg_get_reading"] == 12
    assert sizes["tsg_get_iosettings"] == 20
    ids = {m.name: m.id for m in MESSAGES}
    assert [ids[f"tsg_{verb}_iosettings"] for verb in ("set", "req", "get")] == [2010, 2011, 2012]
    assert len(set(ids.values())) == len(MESSAGES)


def reading(value: int) -> bytes:
    return encode_apt(
        "tsg_get_reading", source=UNIT, destination=HOST, chan=1, reading=value, smoothed=0
    )


@given(st.lists(st.integers(-32768, 32767), max_size=8), st.integers(1, 13))
def test_split_anywhere(values: list[int], size: int) -> None:
    raw = b"".join(reading(value) for value in values)
    decoder = Decoder()
    found = [m for i in range(0, len(raw), size) for m in decoder.feed(raw[i : i + size])]
    assert [m.values["reading"] for m in found] == values
    assert decoder.skipped == 0


@given(st.binary(max_size=40), st.integers(-32768, 32767))
def test_finds_back_after_garbage(garbage: bytes, value: int) -> None:
    decoder = Decoder()
    decoder.feed(garbage)
    # whatever length the garbage announces, it swallows at most the longest message
    found = [m for _ in range(30) for m in decoder.feed(reading(value))]
    assert found[-1].values["reading"] == value


def test_garbage_without_a_header_costs_nothing() -> None:
    decoder = Decoder()
    found = decoder.feed(b"\x00garbage\xff" + reading(5))
    assert [m.values["reading"] for m in found] == [5]
    assert decoder.skipped == 9


def test_another_units_reading_is_garbage() -> None:
    decoder = Decoder()
    others = encode_apt(
        "tsg_get_reading", source=0x21, destination=HOST, chan=1, reading=99, smoothed=0
    )
    to_another = encode_apt(
        "tsg_get_reading", source=UNIT, destination=0x11, chan=1, reading=98, smoothed=0
    )
    found = decoder.feed(others + to_another + reading(5))
    assert [m.values["reading"] for m in found] == [5]
    assert decoder.skipped == 24


@pytest.mark.parametrize("length", [257, 5000, 65535])
def test_a_header_that_announces_more_than_256_bytes_holds_nothing_up(length: int) -> None:
    header = struct.pack("<HHBB", 0x07F6, length, HOST | 0x80, UNIT)
    found = Decoder().feed(header + reading(7))
    assert [m.values["reading"] for m in found] == [7]


def test_unknown_message_is_passed_over_whole() -> None:
    unknown = struct.pack("<HHBB", 0x07F6, 4, HOST | 0x80, UNIT) + reading(9)[:4]
    found = Decoder().feed(unknown + reading(7))
    assert [m.name for m in found] == ["0x07f6", "tsg_get_reading"]


def test_longer_reply_of_newer_firmware() -> None:
    raw = struct.pack("<HHBBHhHI", 0x07DE, 10, HOST | 0x80, UNIT, 1, 42, 43, 0)
    (found,) = Decoder().feed(raw)
    assert found.values == {"chan": 1, "reading": 42, "smoothed": 43}


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("tsg_get_ready", {}, "no APT message"),
        ("tsg_req_reading", {}, "takes chan"),
        ("tsg_get_reading", {"chan": 1, "reading": 40000, "smoothed": 0}, "40000"),
    ],
)
def test_wrong_messages_are_refused(name: str, values: dict, says: str) -> None:
    with pytest.raises(ProtocolError, match=says):
        encode_apt(name, **values)
