"""The messages of the piezo driver against another's implementation of the protocol document:
thorlabs-apt-protocol, which encodes requests and decodes replies on its own."""

import pytest

from dehyst.drivers.apt.codec import HOST, UNIT, encode_apt
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit

apt = pytest.importorskip("thorlabs_apt_protocol")

# our message, theirs, our name of each argument of theirs
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
