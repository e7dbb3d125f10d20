"""External inputs as functions of bytes: each takes one input and only raises unexpected errors. A
documented refusal is caught here; an accepted input is checked."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from tests.fuzz import files, readers

from dehyst.daemon.bus import encoding, messages, security
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Chunk, HistoryRequest, Request, Setpoint
from dehyst.daemon.client.telemetry import TelemetryStream
from dehyst.daemon.config import parse_config
from dehyst.daemon.files import recordings
from dehyst.daemon.files.models import load_model
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.rings.records import TELEMETRY, LoopCommand, State
from dehyst.drivers.apt.codec import Decoder, encode_apt
from dehyst.drivers.mdt693b.codec import (
    Ack,
    Dialect,
    Mdt693bCodec,
    detect_dialect,
    late_replies,
)
from dehyst.drivers.mdt693b.replies import FORMS, form_of
from dehyst.models import modelfile
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.inverse.compensator import Compensator

NOW_NS = 1_000_000_000_000
REACH = (-5.0, 5.0)
FOLDER = files.FOLDER
COMMANDS = [*FORMS, "xvoltage=1.000", "xvoltage?", "ymin?", "XV10.0", "xr?", "XL?", "restore"]


@dataclass(frozen=True)
class Target:
    """run(data): True if the input was accepted. seeds: accepted inputs; words: for mutations."""

    run: Callable[[bytes], bool]
    seeds: tuple[bytes, ...]
    words: tuple[bytes, ...] = ()


def command(data: bytes) -> bool:
    """Handle a set-point, trajectory chunk or request for the loop, sent by the lease's holder."""
    lease = Lease(10**9, lambda: 7)
    lease.give(NOW_NS, 1, "fuzz", NOW_NS)
    gate = Admission("um", 10.0, 2.0, lease)
    gate.core.alive, gate.core.state, gate.core.reachable = True, State.READY, REACH
    gate.core.period_ns, gate.core.status_ns = 1_000_000, NOW_NS
    try:
        message = encoding.decode_command(data)
    except encoding.BadMessage:
        return False
    reply, records = gate.handle(NOW_NS, message, 65536)
    encoding.decode(messages.Reply, encoding.encode(reply))
    assert reply.ok or not records.size
    moves = records[np.isin(records["kind"], (LoopCommand.SETPOINT, LoopCommand.POINT))]
    assert np.all(np.isfinite(moves["value"]))
    if moves.size and not getattr(message, "allow_unreachable", False):
        assert REACH[0] - 1e-6 <= moves["value"].min() <= moves["value"].max() <= REACH[1] + 1e-6
    if isinstance(message, Chunk):
        assert np.all(np.diff(moves["offset_ns"]) > 0)
    return bool(reply.ok)


KINDS = (
    messages.Reply, messages.Status, messages.Event, messages.Rejection, messages.TelemetryBatch,
    HistoryRequest,
)  # fmt: skip


def answer(data: bytes) -> bool:
    """Decode a message as a client does; the first byte selects the expected kind."""
    if not data:
        return False
    try:
        message = encoding.decode(KINDS[data[0] % len(KINDS)], data[1:])
        if isinstance(message, messages.TelemetryBatch):
            assert encoding.samples(message).size == message.count
    except encoding.BadMessage:
        return False
    return True


class _Bus:
    def listen(self, key: str, store: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Keep the stream's callback."""
        self.store = store
        return lambda: None


def stream(data: bytes) -> bool:
    """Read two consecutive telemetry messages, cut where the first two bytes say."""
    bus: Any = _Bus()
    found = TelemetryStream(bus, Keys("dehyst", "a"), lambda **_: np.zeros(0, TELEMETRY))
    cut = int.from_bytes(data[:2], "little")
    for part in (data[2 : 2 + cut], data[2 + cut :]):
        bus.store("", part)
    count = found.read().size + found.read().size
    assert found.lost >= 0
    return count > 0


def key(data: bytes) -> bool:
    """Parse a key expression."""
    keys = Keys("dehyst", "*")
    try:
        parsed = keys.parse(data.decode("utf-8", "replace"))
    except BadInput:
        return False
    assert len(parsed.name) <= 63
    return True


def mdt693b(data: bytes) -> bool:
    """Decode an amplifier's serial bytes in two pieces; three bytes set dialect, command, cut."""
    if len(data) < 4:
        return False
    dialect, words = list(Dialect)[data[0] % 2], COMMANDS[data[1] % len(COMMANDS)]
    form, data, cut = form_of(words), data[3:], data[2]
    codec = Mdt693bCodec(dialect)
    codec.send(words, bool(cut & 1) and form.pattern is not None and not form.blank)
    events = codec.receive(data[:cut]) + codec.receive(data[cut:]) + codec.silence()
    marks = data.count(b">") if dialect is Dialect.MODERN else data.count(b"*")
    assert sum(isinstance(e, Ack) for e in events) <= marks
    assert sum(isinstance(e, Ack) and not e.late for e in events) <= 1
    assert len(late_replies(dialect, data)) <= len(data)
    detect_dialect(data)
    return any(not isinstance(e, Ack) or not e.late for e in events)


def apt(data: bytes) -> bool:
    """Decode serial bytes of a strain-gauge reader: whole and in pieces give the same."""
    whole, pieces = Decoder(), Decoder()
    found = whole.feed(data)
    again = [m for i in range(0, len(data), 7) for m in pieces.feed(data[i : i + 7])]
    assert (found, whole.skipped) == (again, pieces.skipped)
    return bool(found)


_file, _tables = files.file, files.tables


def csv(data: bytes) -> bool:
    """Read a recording or trajectory as text."""
    return _tables(_file("a.csv", data))


def gz(data: bytes) -> bool:
    """Read the same, compressed."""
    return _tables(_file("a.csv.gz", data))


def npz(data: bytes) -> bool:
    """Read the same as numpy's archive."""
    return _tables(_file("a.npz", data))


def mcap(data: bytes) -> bool:
    """Read the same as MCAP."""
    return _tables(_file("a.mcap", data))


def model(data: bytes) -> bool:
    """Load a model file as the loop does: read, prepare, run one step."""
    try:
        found = load_model(_file("model.toml", data))
        modelfile.loads(modelfile.dumps(found))
    except BadInput:
        return False
    limits = found.validity.drive_min, found.validity.drive_max
    try:
        compensator = Compensator(found, 1e-3, *limits, 1e9, "auto", 0.02)
        state = compensator.init(limits[0])
        window = np.full(64, 1.0)
        compensator.step(state, window, 64, np.zeros(0))
    except (DehystError, ValueError, ArithmeticError):  # refused as in a reload
        return False
    drive = state.drive
    assert limits[0] - 1e-6 <= drive <= limits[1] + 1e-6 or np.isnan(drive)
    return True


def config(data: bytes) -> bool:
    """Parse a configuration."""
    try:
        parse_config(data.decode("utf-8", "replace"))
    except BadInput:
        return False
    return True


def passwords(data: bytes) -> bool:
    """Read a file of passwords, and one of credentials."""
    path = _file("passwords", data)
    path.chmod(0o600)
    found = 0
    for read in (security.names, lambda p: security.client_settings(str(p))):
        try:
            found += bool(read(path))
        except BadInput:
            continue
    return found > 0


@cache
def _messages() -> tuple[bytes, ...]:
    batch = encoding.batch(np.zeros(3, TELEMETRY), 5, "um", 0)
    offsets, values = np.arange(4, dtype="<i8") * 2_000_000, np.linspace(0, 1, 4).astype("<f8")
    common: dict[str, Any] = {"client": 1, "lease": 7, "sent_ns": NOW_NS}
    made = (
        Setpoint(**common, sequence=1, value=1.0, unit="um"),
        Setpoint(**common, sequence=9, value=99.0, unit="um", allow_unreachable=True),
        Chunk(
            **common, trajectory=3, index=0, unit="um", offset_ns=offsets.tobytes(),
            value=values.tobytes(), last=True,
        ),
        *(Request(**common, action=a) for a in ("acquire", "take-over", "stop", "clear", "renew")),
        messages.Reply(ok=True, lease=7),
        messages.Event(time_ns=1, wall_ns=2, level=2, code="x", text="y"),
        messages.Rejection(time_ns=1, client=1, code="late", text="y", count=3),
        batch,
        HistoryRequest(seconds=3.0),
    )  # fmt: skip
    return tuple(encoding.encode(m) for m in made)


TEXT = (
    b"# made by: hand\nt_s,u_v,y_um,target_um\n0,1,2,1\n0.001,1.5,,2\n0.002,nan,2.5,3\n",
    b"t_s,target_um\n0,1\n1e-3,2\n",
    b"\xef\xbb\xbft_s,u_v\r\n0,1\r\n1,2\r\n",
)
CASES = (
    b'{"number": 1, "name": "a", "time_ns": 1, "wall_ns": 2, "figure": "x", "low": 0.0, '
    b'"high": 1.0, "slew": 1.0, "rate_hz": 1000.0, "later_s": 1.0, "leads": {"a": 1.0}}',
    b'{"failed": true, "verdict": "unknown", "says": "x", "unit": "um", "noise": 0.1}',
    b'{"state": "offered", "wall_ns": 1}',
    b'{"stage": "P-885"}',
)
CONFIG = b"""name = "stage-1"
run_dir = "/tmp/x"
model = {file = "m.toml"}
loop = {rate_hz = 200.0, priority = 10, engine = "python"}
actuator = {driver = "mdt693b", gain = 1.5, settings = {port = "auto"}}
sensor = {driver = "ksg101", scale = 2.0, zero = 1}
limits = {min_v = 0.0, max_v = 100.0, slew_v_per_s = 2000.0}
safe = {voltage_v = 1.0, on_stop = "hold"}
setpoint = {origin = 3.0, stale_s = 1.0}
inverse = {mode = "preview", preview_s = 0.1}
bus = {listen = ["tcp/127.0.0.1:7447"], connect = ["tcp/[::1]:1"]}
telemetry = {batch_s = 0.1}
watch = {keep = 3}
"""


def _archive(name: str) -> bytes:
    columns = {"t_s": np.arange(3.0), "u_v": np.ones(3), "y_um": np.arange(3.0)}
    path = FOLDER / name
    recordings.write_recording(path, columns["t_s"], {k: columns[k] for k in ("u_v", "y_um")})
    return path.read_bytes()


def targets() -> dict[str, Target]:
    """Return all targets by name."""
    readers.load_libraries()
    plain = _messages()
    numbers = (b"nan", b"inf", b"-1", b"1e400", b"1e-400", b"0x10", b"9" * 30, b"[", b'"')
    toml = (
        *numbers,
        b"[[",
        b"]]",
        b"=",
        b"{",
        b"}",
        b"'''",
        b"\n",
        b"true",
        b"[a.b]",
        b"1979-05-27",
    )
    replies = (
        b"*", b"!", b">", b"\r", b"[  1.00]\r", b"[ 100]\r", b"xvoltage=1.000\r",
        b"CMD_NOT_DEFINED",
    )  # fmt: skip
    units = [
        encode_apt("tsg_get_reading", source=0x50, destination=1, chan=1, reading=-5, smoothed=7),
        encode_apt("pz_get_maxtravel", source=0x50, destination=1, chan=1, travel_100nm=200),
        encode_apt(
            "hw_get_info", source=0x50, destination=1, serial_number=59000001, model=b"KSG101",
            type=1, firmware=b"1234", notes=b"x", hardware_version=1, modification=2, channels=1,
        ),
    ]  # fmt: skip
    long = b"".join(len(m).to_bytes(2, "little") + m + m for m in plain[11:12])
    models = tuple(
        resources.files("dehyst.models").joinpath(f"{name}.toml").read_bytes()
        for name in modelfile.SHIPPED
    )
    keys = (b"dehyst/@v1/a/pubsub/telemetry/daemon", b"dehyst/@v1/a/alive", b"dehyst/@v1/b/rpc/x")
    binary = (b"\xc0", b"\xcb\x7f\xf8" + bytes(6), b"\xcf" + b"\xff" * 8, b"\xdd\xff\xff\xff\xff")
    return {
        "command": Target(command, plain[:8], binary),
        "answer": Target(
            answer,
            tuple(bytes([i]) + m for i, m in zip((0, 2, 3, 4, 5), plain[8:], strict=True)),
            binary,
        ),
        "stream": Target(stream, (long,), binary),
        "key": Target(key, keys, (b"/", b"*", b"**", b"@v1", b"$*", b"?", b"#")),
        "mdt693b": Target(
            mdt693b, tuple(bytes([i, i, 9]) + r for i, r in enumerate(replies)), replies
        ),
        "apt": Target(apt, (*units, b"".join(units)), (b"\x01\x50", b"\x81\x50", *units)),
        "csv": Target(csv, TEXT, (*numbers, b",", b"\n", b"#", b"t_s", b"u_v", b"y_um", b"\0")),
        "csv.gz": Target(gz, (_archive("seed.csv.gz"),)),
        "mcap": Target(mcap, (_archive("seed.mcap"),), (b"\x89MCAP0\r\n", b"t_s", b"null")),
        "npz": Target(npz, (_archive("seed.npz"),), (b"'<f8'", b"'|O'", b"PK", b"(3,)")),
        "text": Target(
            files.text,
            files.TEXTS,
            (*numbers, b";", b"\t", b",", b"\n", b"\r", b" ", b"(s)", b"ms"),
        ),
        "npy": Target(files.npy, files.npy_seeds(), (b"'<f8'", b"'|O'", b"(30, 3)", b"\n")),
        **{
            kind[1:]: Target(readers.reader_of(kind), readers.seeds_of(kind), readers.WORDS[kind])
            for kind in readers.SEEDS
        },
        "unfinished": Target(files.unfinished, files.grown_seeds(), (b"\0" * 64, b"\x93NUMPY")),
        "case": Target(files.case, CASES, (*numbers, b"null", b"{}", b"[]", b'"')),
        "model": Target(model, models, toml),
        "config": Target(config, (CONFIG,), toml),
        "passwords": Target(
            passwords, (b"alice:correct horse\nbob:battery staple\n", b"a:b\n"), (b":", b"\n")
        ),
    }


def clean_up() -> None:
    """Remove the files of this process."""
    files.clean_up()
