"""Replies recorded from real units, byte for byte: the emulator writes them, and the codec reads
them, wherever they are cut."""

import pytest

from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_unit import Mdt693bUnit
from dehyst.drivers.mdt693b.codec import Ack, Answer, Dialect, Mdt693bCodec, Refused, detect_dialect

ID_110 = (
    b"\r\r\rModel MDT693B Piezo Control Module\rFirmware Version: 1.10\rVoltage Range: 0V to 150V\r"
    b"Serial#:150226175403\rFriendly Name:MDT693B\rThorlabs, Inc. Newton, NJ 07860\r"
    b"www.thorlabs.com\r\r>"
)
ID_LINES = ID_110.strip(b"\r>").decode()

# firmware, knobs, sent, received, and the event that the codec makes of it
RECORDED = [
    ("1.05", {"limit_v": 100}, b"vlimit?\n", b"vlimit?\n*[ 100]\r*", Answer),
    ("1.05", {"start_v": 24.8}, b"xvoltage?\n", b"xvoltage?\n*[  24.8]\r", Answer),
    ("1.05", {}, b"xvoltage=12.500\n", b"xvoltage=12.500\n*", Ack),
    ("1.05", {"echo": False}, b"xmin?\r", b"*0", Answer),
    ("1.05", {"echo": False, "limit_v": 100}, b"xmax?\r", b"*100.5", Answer),
    ("1.05", {"echo": False}, b"cm?\r", b"*[MDT693A Compatibility Mode Off]\r*", Answer),
    (
        "1.05",
        {"echo": False, "serial_number": "140421-07"},
        b"serial?\r",
        b"140421-07\r*",
        Answer,
    ),
    ("1.05", {"echo": False}, b"*IDN?\r", b"!", Refused),
    ("1.05", {"echo": False}, b"\r", b"!", Refused),
    ("1.05", {}, b"echo=0\r", b"echo=0\r*[Echo Off]\r", Answer),
    ("1.10", {"echo": False}, b"xmin?\r", b"0\r>", Answer),
    ("1.10", {"echo": False}, b"xmax?\r", b"150.50\r>", Answer),
    ("1.10", {"echo": False}, b"XYZVOLTAGE?\r", b"[  0.24,  0.21,  0.22]\r>", Answer),
    ("1.10", {"echo": False}, b"serial?\r", b"150226175403\r>", Answer),
    ("1.10", {"echo": False, "serial_number": ""}, b"serial?\r", b"\r>", Answer),
    ("1.10", {"echo": False}, b"*IDN?\r", b"CMD_NOT_DEFINED>", Refused),
    ("1.10", {"echo": False}, b"\r", b"CMD_NOT_DEFINED>", Refused),
    ("1.10", {"echo": False}, b"xvoltage?\r", b"[  0.24]\r>", Answer),
    ("1.10", {"echo": False}, b"xvoltage=12.500\r", b">", Ack),
    ("1.10", {"echo": False}, b"ID?\r", ID_110, Answer),
    ("1.10", {}, b"xvoltage?\r", b"xvoltage?\r[  0.24]\r>", Answer),
    ("1.10", {}, b"echo=0\r", b"echo=0\r[Echo Off]\r>", Answer),
    ("1.10", {"echo": False}, b"echo=1\r", b"[Echo On]\r>", Answer),
    ("1.10", {"echo": False}, b"xvoltage=151\r", b"CMD_ARG_INVALID>", Refused),
    ("1.10", {"echo": False, "range_error": b"!"}, b"xvoltage=151\r", b"!>", Refused),
]


def quiet_unit(firmware: str, **knobs) -> Mdt693bUnit:
    """Return a unit with the readback of the recorded units; it answers at once."""
    axes_v = {"x": 0.24, "y": 0.21, "z": 0.22}
    start_v = knobs.pop("start_v", None)
    fixed = {"latency_s": 0.0, "jitter_s": 0.0, "readback_noise_v": 0.0, "adc_step_v": 0.0}
    fixed |= {"readback_offset_v": 0.0, "dac_step_v": 0.0}
    unit = Mdt693bUnit(Mdt693bKnobs(dialect=firmware, **fixed, **knobs), clock=lambda: 0.0)
    for axis, volts in axes_v.items():
        unit._readback[axis].seen_v = volts if start_v is None else start_v
    return unit


def everything(unit: Mdt693bUnit) -> bytes:
    out = b""
    while chunk := unit.take():
        out += chunk
    return out


@pytest.mark.parametrize(
    ("firmware", "knobs", "sent", "received", "kind"),
    RECORDED,
    ids=lambda value: repr(value)[:24] if isinstance(value, bytes) else "",
)
class TestRecorded:
    def test_the_emulator_answers_as_recorded(self, firmware, knobs, sent, received, kind):
        unit = quiet_unit(firmware, **knobs)
        unit.feed(sent)
        assert everything(unit) == received

    def test_the_emulator_does_not_care_how_the_command_is_cut(
        self, firmware, knobs, sent, received, kind
    ):
        unit = quiet_unit(firmware, **knobs)
        for byte in sent:
            unit.feed(bytes([byte]))
        assert everything(unit) == received

    def test_the_codec_reads_it_cut_at_every_byte(self, firmware, knobs, sent, received, kind):
        dialect = Dialect.LEGACY if firmware < "1.09" else Dialect.MODERN
        command = sent.strip(b"\r\n").decode()
        answers = []
        for cut in range(len(received) + 1):
            codec = Mdt693bCodec(dialect)
            codec.send(command)
            events = codec.receive(received[:cut]) + codec.receive(received[cut:])
            while codec.waiting and (more := codec.silence()):
                events += more
            answers.append(events)
            assert [type(e) for e in events] == [kind], f"cut at {cut}: {events}"
        assert all(a == answers[0] for a in answers)

    def test_the_codec_reads_it_one_byte_at_a_time(self, firmware, knobs, sent, received, kind):
        codec = Mdt693bCodec(Dialect.LEGACY if firmware < "1.09" else Dialect.MODERN)
        codec.send(sent.strip(b"\r\n").decode())
        events = [e for byte in received for e in codec.receive(bytes([byte]))]
        if codec.waiting:
            events += codec.silence()
        assert [type(e) for e in events] == [kind]


@pytest.mark.parametrize(
    ("dialect", "command", "raw", "value"),
    [
        (Dialect.LEGACY, "vlimit?", b"*[ 100]\r*", "100"),
        (Dialect.LEGACY, "vlimit?", b"vlimit?\n*[ 100]\r", "100"),
        (Dialect.LEGACY, "xvoltage?", b"*[  24.8]\r", "24.8"),
        (Dialect.LEGACY, "xmax?", b"*100.5", "100.5"),
        (Dialect.LEGACY, "serial?", b"140421-07\r*", "140421-07"),
        (Dialect.MODERN, "xmax?", b"150.50\r>", "150.50"),
        (Dialect.MODERN, "xvoltage?", b"[  0.24]\r>", "0.24"),
        (Dialect.MODERN, "xvoltage?", b"\0[  0.24]\n>", "0.24"),
        (Dialect.MODERN, "xyzvoltage?", b"[  0.24,  0.21,  0.22]\r>", "0.24,  0.21,  0.22"),
        (Dialect.MODERN, "serial?", b"\r>", ""),
        (Dialect.MODERN, "id?", ID_110, ID_LINES),
        (Dialect.LEGACY, "id?", b"*" + ID_110[:-1], ID_LINES),
    ],
)
def test_values(dialect, command, raw, value):
    codec = Mdt693bCodec(dialect)
    codec.send(command)
    events = codec.receive(raw)
    if codec.waiting:
        events += codec.silence()
    assert [e.value for e in events] == [value]


@pytest.mark.parametrize(
    ("raw", "dialect"),
    [
        (b"!", Dialect.LEGACY),
        (b"\r!", Dialect.LEGACY),
        (b"\n\0!", Dialect.LEGACY),
        (b"CMD_NOT_DEFINED>", Dialect.MODERN),
        (b"\rCMD_NOT_DEFINED>", Dialect.MODERN),
        (b">", Dialect.MODERN),
        (b"", None),
        (b"login: ", None),
    ],
)
def test_the_dialect_is_reported_by_the_answer_to_an_empty_line(raw, dialect):
    assert detect_dialect(raw) is dialect
