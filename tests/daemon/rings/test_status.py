"""The status: its record, its message and its display come from one table of rows."""

import io
from collections import deque

import msgpack
import msgspec
import numpy as np
from rich.console import Console

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import GatewayStatus, Status
from dehyst.daemon.gateway.publisher import status_message
from dehyst.daemon.rings.status import STATUS
from dehyst.daemon.terminal import view

# the record's layout and a message as version 0.1.0 wrote them
LAYOUT = (
    "time_ns <i8, wall_ns <i8, state u1, policy u1, priority u1, mode u1, samples <i8, "
    "missed <i8, missed_by 9<i8, wake_us 4<f4, exec_us 4<f4, io_us 4<f4, actuator_ok u1, "
    "sensor_ok u1, actuator_errors <i8, sensor_errors <i8, volts <f8, queue_s <f8, "
    "trajectory <u8, trajectory_done u1, origin <f8, reach_min <f8, reach_max <f8, "
    "latency_s <f8, period_ns <i8, pid <i8"
)
PAYLOAD = bytes.fromhex(
    "de0023a6736368656d61ad6465687973742e737461747573a776657273696f6e01a46e616d65a57374616765"
    "a8736f667477617265a5302e312e30aa636f72655f616c697665c3a372756e09a4756e6974a2756daa647269"
    "76655f756e6974a176a774696d655f6e7301a777616c6c5f6e7302a57374617465a772756e6e696e67a6706f"
    "6c696379a46669666fa87072696f7269747905a46d6f6465a770726576696577a773616d706c657307a66d69"
    "7373656408a96d69737365645f627983aa706167655f6661756c7401a5737465616c02a973757370656e6465"
    "6405a777616b655f757384a3703530cb4022000000000000a3703939cb4024000000000000a470393939cb40"
    "26000000000000a36d6178cb4028000000000000a7657865635f757384a3703530cb4024000000000000a370"
    "3939cb4026000000000000a470393939cb4028000000000000a36d6178cb402a000000000000a5696f5f7573"
    "84a3703530cb4026000000000000a3703939cb4028000000000000a470393939cb402a000000000000a36d61"
    "78cb402c000000000000ab6163747561746f725f6f6bc3a973656e736f725f6f6bc2af6163747561746f725f"
    "6572726f72730fad73656e736f725f6572726f727310a5766f6c7473cb4031000000000000a771756575655f"
    "73cb4032000000000000aa7472616a6563746f727909af7472616a6563746f72795f646f6e65c3a66f726967"
    "696ecb4035000000000000a972656163685f6d696ecb4036000000000000a972656163685f6d6178cb403700"
    "0000000000a96c6174656e63795f73cb0000000000000000a9706572696f645f6e7319a37069641aa7676174"
    "657761798da37069644da8757074696d655f73cb3ff8000000000000b173616d706c65735f7075626c697368"
    "65640aac73616d706c65735f6c6f737402a8636f6d6d616e647303a872656a656374656481a36f6c6401ac6c"
    "656173655f636c69656e7405ab6c656173655f6c6162656ca26d65ac6c656173655f6c6566745f73cb3fe000"
    "0000000000a9686973746f72795f73cb4018000000000000b072657374617274735f6f665f636f726501a668"
    "65616c7468cb3fd0000000000000a86d69736d61746368a46761696e"
)
GATEWAY = GatewayStatus(
    pid=77, uptime_s=1.5, samples_published=10, samples_lost=2, commands=3, rejected={"old": 1},
    lease_client=5, lease_label="me", lease_left_s=0.5, history_s=6.0, restarts_of_core=1,
    health=0.25, mismatch="gain",
)  # fmt: skip


def record() -> np.void:
    """Return a STATUS record: field number i holds i + 1, arrays i, i + 1, ..., except those set
    below."""
    row = np.zeros(1, STATUS)[0]
    numbers = [name for name in STATUS.names or () if STATUS[name].kind != "S"]
    for i, name in enumerate(numbers):
        row[name] = np.arange(STATUS[name].shape[0]) + i if STATUS[name].shape else i + 1
    row["unit"], row["drive_unit"], row["model"] = "um", "v", "0123456789abcdef"
    row["state"], row["mode"], row["policy"] = 2, 3, 1
    row["actuator_ok"], row["sensor_ok"] = 1, 0
    row["trajectory"], row["latency_s"] = 2**63 + 9, np.inf
    row["missed_by"] = [0, 1, 0, 2, 0, 0, 0, 0, 5]
    return row


def message() -> Status:
    reported = status_message(record(), "stage", 9, True, GATEWAY)
    return msgspec.structs.replace(reported, software="0.1.0")


def test_every_field_of_version_0_1_is_in_the_record_as_it_was() -> None:
    found = {
        f"{name} {dtype[1:] if dtype == '|u1' else dtype}"
        if not shape
        else f"{name} {shape[0][0]}{dtype}"
        for name, dtype, *shape in STATUS.descr
    }
    assert set(LAYOUT.split(", ")) <= found


def test_every_field_of_version_0_1_is_in_the_message_as_it_was() -> None:
    now, then = msgpack.unpackb(encoding.encode(message())), msgpack.unpackb(PAYLOAD)
    gateway = {name: now["gateway"][name] for name in then["gateway"]}
    assert now["version"] > then["version"]  # fields have been added since
    same = {name: now[name] for name in then} | {"gateway": gateway}
    assert same | {"version": 1} == then


def test_infinite_latency_and_numbers_beyond_63_bits_stay_within_the_message() -> None:
    assert message().latency_s == 0.0
    assert message().trajectory == 9
    assert message().missed_by == {"page_fault": 1, "steal": 2, "suspended": 5}


def test_view_shows_the_status() -> None:
    window = view.RecentTelemetry(1.0, 1_000_000)
    console = Console(width=160, height=40, record=True, file=io.StringIO())
    console.print(view.screen(message(), window, 4, deque(), deque(), (160, 40)), height=40)
    text = console.export_text()
    for words in (
        "dehyst stage", "state running", "(preview)", "samples 7, missed 8",
        "telemetry lost here 4",
        "by cause: page_fault 1, steal 2, suspended 5", "wake-up p50 9 us, p99 10, max 12",
        "step p99 11 us", "I/O p99 12 us", "actuator ok, 15 errors", "sensor FAILED, 16 errors",
        "reach 22 to 23 um", "fifo 5", "commanded by me", "refused: old 1",
    ):  # fmt: skip
        assert words in text, words
