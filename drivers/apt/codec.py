"""The APT protocol of Thorlabs K-Cubes and T-Cubes: bytes to messages and back, without a port.

A message is a six-byte header, little-endian, followed by data or containing two parameters:

    <HBBBB   id, parameter 1, parameter 2, destination, source
    <HHBB    id, length of the data, destination | 0x80, source         then the data

MESSAGES has all messages used here for a KSG101 / TSG001 strain gauge reader, a KPZ101 / TPZ001
piezo driver, or a channel of a KPC101, BPC301 or BPC303. The layouts are those of Thorlabs' "APT
Communications Protocol"; published packages use other ids for the TSG messages, which the units do
not answer.
"""

import struct
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from dehyst.drivers.interface import ProtocolError

HOST = 0x01
UNIT = 0x50
"""Addresses of the computer, and of a unit that is not a rack."""
RACK, BAYS = 0x11, (0x21, 0x22, 0x23)
"""Addresses of a rack: its motherboard, and its bays with one channel each."""
HEADER = struct.Struct("<HBBBB")
LONG_HEADER = struct.Struct("<HHBB")
HAS_DATA = 0x80  # bit of the destination in a header that is followed by data
LONGEST = 256  # bytes of data; anything longer is garbage


@dataclass(frozen=True)
class MessageLayout:
    """The layout of one message. data: struct of the data ("": header only, values are
    parameters)."""

    id: int
    name: str
    fields: tuple[str, ...]
    data: str = ""

    @property
    def size(self) -> int:
        """Number of data bytes after the header."""
        return struct.calcsize("<" + self.data) if self.data else 0


@dataclass(frozen=True)
class AptMessage:
    """A message with its values by name; "0x...." and raw data if it is not in MESSAGES."""

    name: str
    values: dict[str, Any] = field(default_factory=dict)
    source: int = HOST
    destination: int = UNIT


_IO = ("chan", "analog_out", "display_mode", "force_calibration", "reserved")
_TPZ_IO = ("chan", "voltage_limit", "hub_analog_input", "future_1", "future_2")
_INFO = (
    "serial_number",
    "model",
    "type",
    "firmware",
    "notes",
    "hardware_version",
    "modification",
    "channels",
)
MESSAGES = (
    MessageLayout(0x0002, "hw_disconnect", ()),
    MessageLayout(0x0005, "hw_req_info", ()),
    MessageLayout(0x0006, "hw_get_info", _INFO, "I8sH4s60sHHH"),
    MessageLayout(0x0011, "hw_start_updatemsgs", ("rate",)),
    MessageLayout(0x0012, "hw_stop_updatemsgs", ()),
    MessageLayout(0x0060, "rack_req_bayused", ("bay",)),
    MessageLayout(0x0061, "rack_get_bayused", ("bay", "state")),
    MessageLayout(0x0080, "hw_response", ()),
    MessageLayout(0x0081, "hw_richresponse", ("message", "code", "text"), "HH64s"),
    MessageLayout(0x0210, "mod_set_chanenablestate", ("chan", "state")),
    MessageLayout(0x0211, "mod_req_chanenablestate", ("chan",)),
    MessageLayout(0x0212, "mod_get_chanenablestate", ("chan", "state")),
    MessageLayout(0x0223, "mod_identify", ("chan",)),
    MessageLayout(0x0640, "pz_set_poscontrolmode", ("chan", "mode")),
    MessageLayout(0x0641, "pz_req_poscontrolmode", ("chan",)),
    MessageLayout(0x0642, "pz_get_poscontrolmode", ("chan", "mode")),
    MessageLayout(0x0643, "pz_set_outputvolts", ("chan", "voltage"), "Hh"),
    MessageLayout(0x0644, "pz_req_outputvolts", ("chan",)),
    MessageLayout(0x0645, "pz_get_outputvolts", ("chan", "voltage"), "Hh"),
    MessageLayout(0x0650, "pz_req_maxtravel", ("chan",)),
    MessageLayout(0x0651, "pz_get_maxtravel", ("chan", "travel_100nm"), "HH"),
    MessageLayout(0x0652, "pz_set_inputvoltssrc", ("chan", "inputs"), "HH"),
    MessageLayout(0x0653, "pz_req_inputvoltssrc", ("chan",)),
    MessageLayout(0x0654, "pz_get_inputvoltssrc", ("chan", "inputs"), "HH"),
    MessageLayout(0x0658, "pz_set_zero", ("chan",)),
    MessageLayout(0x0660, "pz_req_pzstatusupdate", ("chan",)),
    MessageLayout(
        0x0661, "pz_get_pzstatusupdate", ("chan", "output", "position", "status"), "HhhI"
    ),
    MessageLayout(0x0662, "pz_ack_pzstatusupdate", ()),
    MessageLayout(0x0681, "pz_req_outputmaxvolts", ("chan",)),
    MessageLayout(0x0682, "pz_get_outputmaxvolts", ("chan", "voltage_100mv", "flags"), "HHH"),
    MessageLayout(0x07D4, "pz_set_tpz_iosettings", _TPZ_IO, "HHHHH"),
    MessageLayout(0x07D5, "pz_req_tpz_iosettings", ("chan",)),
    MessageLayout(0x07D6, "pz_get_tpz_iosettings", _TPZ_IO, "HHHHH"),
    MessageLayout(0x07DA, "tsg_set_iosettings", _IO, "HHHII"),
    MessageLayout(0x07DB, "tsg_req_iosettings", ("chan",)),
    MessageLayout(0x07DC, "tsg_get_iosettings", _IO, "HHHII"),
    MessageLayout(0x07DD, "tsg_req_reading", ("chan",)),
    MessageLayout(0x07DE, "tsg_get_reading", ("chan", "reading", "smoothed"), "HhH"),
)
BY_NAME = {layout.name: layout for layout in MESSAGES}
BY_ID = {layout.id: layout for layout in MESSAGES}

BAY_OCCUPIED, BAY_EMPTY = 1, 2
"""States of rack_get_bayused, which counts bays from 0."""

CHANNEL_ENABLED, CHANNEL_DISABLED = 1, 2
"""States of mod_*_chanenablestate."""

OPEN_LOOP, CLOSED_LOOP = 1, 2
"""Modes of pz_*_poscontrolmode; 3 and 4 are the same modes with smooth transitions."""

SOFTWARE_ONLY, EXTERNAL_SIGNAL, POTENTIOMETER = 0, 1, 2
"""Sources of pz_*_inputvoltssrc: bits; each source adds to the voltage that software sets."""

VOLTAGE_LIMITS_V = {1: 75.0, 2: 100.0, 3: 150.0}
"""voltage_limit of pz_*_tpz_iosettings -> output voltage at a value of FULL_OUTPUT."""

FULL_OUTPUT = 32767
"""The voltage field of pz_*_outputvolts at the unit's voltage limit."""

FULL_TRAVEL = 32767
"""The reading or position field at the travel that pz_get_maxtravel reports."""

# status bits of pz_get_pzstatusupdate
ACTUATOR_CONNECTED = 0x01
ZEROED = 0x10
GAUGE_CONNECTED = 0x100
LOOP_CLOSED = 0x400
LIMIT_75_V = 0x1000  # the next two bits mean 100 and 150 V
OUTPUT_ENABLED = 0x8000_0000


def encode_apt(name: str, *, source: int = HOST, destination: int = UNIT, **values: Any) -> bytes:
    """Return the bytes of a message. Raises ProtocolError for a wrong name, field or value."""
    layout = BY_NAME.get(name)
    if layout is None:
        raise ProtocolError(f"there is no APT message '{name}' here")
    if set(values) != set(layout.fields):
        raise ProtocolError(f"{name} takes {', '.join(layout.fields) or 'nothing'}")
    ordered = [values[key] for key in layout.fields]
    try:
        if layout.data:
            header = LONG_HEADER.pack(layout.id, layout.size, destination | HAS_DATA, source)
            return header + struct.pack("<" + layout.data, *ordered)
        first, second = [*ordered, 0, 0][:2]
        return HEADER.pack(layout.id, first, second, destination, source)
    except struct.error as error:
        raise ProtocolError(f"{name} with {values}: {error}") from None


class Decoder:
    """Decode bytes into messages; resynchronises after garbage.

    receivers, senders: the addresses that messages may carry; anything else is garbage, which is
    skipped byte by byte and counted in `skipped`.
    """

    def __init__(
        self, receivers: Collection[int] = (HOST,), senders: Collection[int] = (UNIT,)
    ) -> None:
        self.receivers = receivers
        self.senders = senders
        self.skipped = 0
        self._buffer = bytearray()

    def reset(self) -> None:
        """Discard the bytes of an unfinished message."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[AptMessage]:
        """Take bytes in pieces of any size; return the messages that they complete."""
        self._buffer += data
        found: list[AptMessage] = []
        while len(self._buffer) >= HEADER.size:
            size = self._size()
            if size is None:
                del self._buffer[0]
                self.skipped += 1
            elif len(self._buffer) < size:
                break
            else:
                found.append(self._decode(bytes(self._buffer[:size])))
                del self._buffer[:size]
        return found

    def _size(self) -> int | None:
        """Return the size in bytes of the message that starts here; None if none does."""
        number, first, second, destination, source = HEADER.unpack_from(self._buffer)
        if destination & ~HAS_DATA not in self.receivers or source not in self.senders:
            return None
        layout = BY_ID.get(number)
        length = first + 256 * second if destination & HAS_DATA else 0
        if length > LONGEST or (destination & HAS_DATA and length == 0):
            return None
        if layout is not None and (bool(layout.data) != bool(length) or length < layout.size):
            return None
        return HEADER.size + length

    def _decode(self, raw: bytes) -> AptMessage:
        number, first, second, destination, source = HEADER.unpack_from(raw)
        layout = BY_ID.get(number)
        data = raw[HEADER.size :]
        values: tuple[Any, ...]
        if layout is None:
            table = {"data": data} if data else {"parameters": (first, second)}
            return AptMessage(f"0x{number:04x}", table, source, destination & ~HAS_DATA)
        if layout.data:  # newer firmware may append fields: they are ignored
            values = struct.unpack_from("<" + layout.data, data)
        else:
            values = (first, second)
        named = dict(zip(layout.fields, values, strict=False))
        return AptMessage(layout.name, named, source, destination & ~HAS_DATA)
