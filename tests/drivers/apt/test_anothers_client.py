"""The messages of the piezo driver, compared with another implementation of the protocol document:
thorlabs-apt-protocol, which has its own encoding and decoding."""

import pytest

from dehyst.drivers.apt.codec import BAYS, HOST, RACK, UNIT, encode_apt
from dehyst.drivers.emulated.kpc101_unit import Bpc303Unit, Kpc101Knobs
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit

apt = pytest.importorskip("thorlabs_apt_protocol")

# our message, theirs, and our name for each of their arguments
SAME = [
    ("hw_req_info", "hw_req_info", {}),
    ("hw_stop_updatemsgs", "hw_stop_updatemsgs", {}),
    ("mod_set_chanenablestate", "mod_set_chanenablestate", {"chan_ident": 1, "enable_state": 1}),
    ("mod_req_chanenablestate", "mod_req_chanenablestate", {"chan_ident": 1}),
    ("pz_req_poscontrolmode", "pz_req_positioncontrolmode", {"chan_ident": 1}),
    ("pz_set_outputvolts", "pz_set_outputvolts", {"chan_ident": 1, "voltage": 0x1234}),
    ("pz_req_outputvolts", "pz_req_outputvolts", {"chan_ident": 1}),
    ("pz_req_inputvoltssrc", "pz_req_inputvoltssrc", {"chan_ident": 1}),
    ("pz_req_tpz_iosettings", "pz_req_tpz_iosettings", {"chan_ident": 1}),
]
OURS = {"chan_ident": "chan", "enable_state": "state", "voltage": "voltage"}


@pytest.mark.parametrize(("ours", "theirs", "values"), SAME, ids=[row[0] for row in SAME])
def test_the_same_bytes(ours: str, theirs: str, values: dict) -> None:
    made = getattr(apt, theirs)(dest=UNIT, source=HOST, **values)
    assert encode_apt(ours, **{OURS[name]: value for name, value in values.items()}) == made


def test_its_requests_are_answered_in_what_it_understands() -> None:
    unit = Kpz101Unit(Kpz101Knobs(limit_v=100, latency_s=0.0, enabled=True), clock=lambda: 0.0)
    to = {"dest": UNIT, "source": HOST}
    unit.feed(
        apt.pz_set_outputvolts(chan_ident=1, voltage=16384, **to)
        + apt.pz_req_outputvolts(chan_ident=1, **to)
        + apt.pz_req_tpz_iosettings(chan_ident=1, **to)
        + apt.hw_req_info(**to)
    )
    unpacker = apt.Unpacker()
    while raw := unit.take():
        unpacker.feed(raw)
    volts, limit, info = list(unpacker)
    assert unit.output_v() == pytest.approx(50.0, abs=0.01)
    assert (volts.msg, volts.voltage) == ("pz_get_outputvolts", 16384)
    assert (limit.msg, limit.voltage_limit) == ("pz_get_tpz_iosettings", 2)
    assert (info.serial_number, info.model_number.rstrip(b"\0")) == (29000123, b"KPZ101")


@pytest.mark.parametrize(("enabled", "mode"), [(True, 1), (False, 1), (True, 2)])
def test_it_understands_the_status(enabled: bool, mode: int) -> None:
    knobs = Kpz101Knobs(latency_s=0.0, enabled=enabled, mode=mode, start_v=75.0)
    unit = Kpz101Unit(knobs, clock=lambda: 0.0)
    unit.feed(apt.pz_req_pzstatusupdate(chan_ident=1, dest=UNIT, source=HOST))
    unpacker = apt.Unpacker()
    while raw := unit.take():
        unpacker.feed(raw)
    (status,) = list(unpacker)
    assert (status.msg, status.output_voltage) == ("pz_get_pzstatusupdate", 16384)
    assert (status.enabled, status.control_mode) == (enabled, mode == 2)
    assert (status.connected, status.strain_gauge_connected) == (True, False)
    assert (status.max_75V, status.max_100V, status.max_150V) == (False, False, True)


# further requests for the channels of a KPC101, BPC301 and BPC303
ALSO = [
    ("pz_req_pzstatusupdate", "pz_req_pzstatusupdate"),
    ("pz_req_maxtravel", "pz_req_maxtravel"),
    ("pz_req_outputmaxvolts", "pz_req_outputmaxvolts"),
]


@pytest.mark.parametrize("to", [UNIT, *BAYS])
@pytest.mark.parametrize(("ours", "theirs"), ALSO, ids=[row[0] for row in ALSO])
def test_the_same_bytes_to_every_bay(ours: str, theirs: str, to: int) -> None:
    made = getattr(apt, theirs)(dest=to, source=HOST, chan_ident=1)
    assert encode_apt(ours, destination=to, chan=1) == made


def test_the_same_bytes_to_a_motherboard() -> None:
    asked = encode_apt("rack_req_bayused", destination=RACK, bay=2)
    assert asked == apt.rack_req_bayused(dest=RACK, source=HOST, bay_ident=2)
    assert asked == bytes.fromhex("60 00 02 00 11 01")


def test_a_rack_answers_in_what_it_understands() -> None:
    knobs = Kpc101Knobs(model="BPC303", serial_number=71000123, limit_v=75, latency_s=0.0, bays=2)
    unit = Bpc303Unit(knobs, position=lambda channel, time_s: 5.0 * channel, clock=lambda: 0.0)
    bay = {"dest": BAYS[1], "source": HOST, "chan_ident": 1}
    unit.feed(
        apt.hw_req_info(dest=RACK, source=HOST)
        + apt.rack_req_bayused(dest=RACK, source=HOST, bay_ident=1)
        + apt.rack_req_bayused(dest=RACK, source=HOST, bay_ident=2)
        + apt.pz_req_maxtravel(**bay)
        + apt.pz_req_outputmaxvolts(**bay)
        + apt.pz_req_pzstatusupdate(**bay)
    )
    unpacker = apt.Unpacker()
    while raw := unit.take():
        unpacker.feed(raw)
    info, second, third, travel, limit, status = list(unpacker)
    assert (info.serial_number, info.model_number.rstrip(b"\0")) == (71000123, b"BPC303")
    assert [(b.bay_ident, b.occupied) for b in (second, third)] == [(1, True), (2, False)]
    assert (travel.travel, limit.voltage, limit.max_75V) == (200, 750, True)
    assert (status.position, status.strain_gauge_connected) == (16384, True)  # 10 um of 20
    assert (status.source, travel.source, info.source) == (BAYS[1], BAYS[1], RACK)
