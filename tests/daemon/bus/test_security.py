"""Roles and authentication, tried by a second session against a real gateway."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import (
    Bench,
    follows,
    forged_setpoint,
    observer_only_hears,
    wait_until,
)

from dehyst.daemon.bus import encoding, topics
from dehyst.daemon.bus.security import check_open, client_settings, is_loopback, server_settings
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.config import parse_config
from dehyst.daemon.main import main
from dehyst.models.errors import BadInput

ROLES = 'operators = ["alice"], observers = ["bob"]'


class Secured:
    """A bench with authentication; credentials(name) is what a client of that name holds."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.folder, self.kind = folder, kind
        if kind == "password":
            (folder / "passwords").write_text("alice:correct horse\nbob:battery staple\n")
            (folder / "passwords").chmod(0o600)
            auth = f'auth = {{passwords = "passwords", {ROLES}}}'
            self.bench = Bench(folder, **{"\nbus = {": f"\nbus = {{{auth}, "})
            for line in ("alice:correct horse", "bob:battery staple", "eve:whatever it is"):
                path = folder / line.partition(":")[0]
                path.write_text(line)
                path.chmod(0o600)
            self.address = self.bench.address
        else:
            keys = str(folder / "keys")
            made = [keys, "--controller", "stage", "--host", "127.0.0.1", "--host", "localhost"]
            assert main(["keys", *made, "--client", "alice", "--client", "bob"]) == 0
            assert main(["keys", str(folder / "others"), "--client", "eve"]) == 0
            auth = f'auth = {{certificates = "keys/stage", {ROLES}}}'
            replaced = {"\nbus = {": f"\nbus = {{{auth}, ", '"tcp/': '"tls/'}
            self.bench = Bench(folder, **replaced)
            self.address = self.bench.address.replace("tcp/", "tls/")
        self.bench.start_gateway()

    def credentials(self, name: str) -> str:
        if self.kind == "password":
            return str(self.folder / name)
        return str(self.folder / ("others" if name == "eve" else "keys") / name)

    def client(self, name: str) -> Client:
        client = Client("bench", self.address, credentials=self.credentials(name))
        self.bench.clients.append(client)
        return client


@pytest.fixture(scope="module", params=["password", "certificate"])
def bench_of_kind(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[Secured]:
    """The bench that `secured` returns."""
    secured = Secured(tmp_path_factory.mktemp(request.param), request.param)
    try:
        yield secured
    finally:
        secured.bench.close()


@pytest.fixture
def secured(bench_of_kind: Secured) -> Secured:
    """A running bench that nobody commands; the clients of the previous test are closed."""
    clients = bench_of_kind.bench.clients
    while clients:
        clients.pop().close()
    with Client(
        "bench", bench_of_kind.address, credentials=bench_of_kind.credentials("bob")
    ) as bob:
        wait_until("the loop is seen", lambda: follows(bob))
        wait_until("nobody commands", lambda: bob.status().gateway.lease_client == 0)
    return bench_of_kind


def test_operator_commands_observer_sees_nobody_else_connects(secured: Secured) -> None:
    operator, observer = secured.client("alice"), secured.client("bob")
    overheard: list[bytes] = []
    observer.bus.listen(observer.keys.setpoints(), lambda _, payload: overheard.append(payload))
    stream, targets = observer_only_hears(operator, observer)
    assert observer.config().name == "bench"
    assert overheard == []  # set-points contain the number of the lease and go only to the daemon
    # the observer sends set-points and telemetry nevertheless, as if it had overheard them
    forged = forged_setpoint(operator)
    key = observer.keys.pubsub("setpoint_um", "1")
    observer.bus.sender(key, topics.SETPOINT).put(encoding.encode(forged))
    other = operator.stream()
    fake = observer.keys.pubsub("telemetry")
    batch = encoding.batch(stream.read(20.0)[:1], 12345, "um", 0)
    observer.bus.sender(fake, topics.TELEMETRY).put(encoding.encode(batch))
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        targets.update(other.read(0.1)["target"].tolist())
        assert other.run != 12345
    assert 9.0 not in targets

    with pytest.raises(BusError, match="credentials"):
        secured.client("eve")
    with pytest.raises(BusError, match="credentials"):
        Bus.connect([secured.address], timeout_s=0.5)


def test_a_command_sent_again_under_the_same_lease_is_refused(secured: Secured) -> None:
    operator = secured.client("alice")
    wait_until("the loop is seen", lambda: follows(operator))
    operator.send(3.0)
    again = operator._setpoint(2.0, False)
    assert operator._ask(again).ok
    assert operator._ask(again).code == "old"
    with pytest.raises(Refusal):
        operator.send(30.0)


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.9.9.9:7447", True),
        ("tls/[::1]:7447", True),
        ("tcp/localhost:7447", True),
        ("unixsock-stream//run/x", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/10.0.0.1:7447", False),
        ("tcp/stage.lab:7447", False),
        ("udp/224.0.0.1:7447", False),
        ("tcp/127.0.0.1.evil.example:7447", False),
    ],
)
def test_beyond_loopback_authentication_is_required(endpoint: str, local: bool) -> None:
    assert is_loopback(endpoint) == local
    check_open([endpoint], authenticated=True)
    text = f"""
name = "x"
model = {{file = "paper-eq11"}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 10.0, slew_v_per_s = 100.0}}
bus = {{listen = ["{endpoint}"]}}
"""
    if local:
        parse_config(text)
    else:
        with pytest.raises(BadInput, match="anybody could move the stage"):
            parse_config(text)
        with pytest.raises(BadInput, match="anybody"):
            Bus.serve([endpoint], [])


def test_what_does_not_fit_is_refused_with_the_reason(tmp_path: Path) -> None:
    from dehyst.daemon.bus.keys import Keys

    keys, listen = [Keys("dehyst", "a")], ["tcp/10.0.0.1:7447"]
    passwords = tmp_path / "passwords"
    passwords.write_text("alice:longer than eight\n")
    passwords.chmod(0o644)

    def refused(says: str, **change: object) -> None:
        fields: dict = {
            "operators": ["alice"], "observers": [], "passwords": str(passwords), "certificates": ""
        }  # fmt: skip
        with pytest.raises(BadInput, match=says):
            server_settings("a", keys, listen, **(fields | change))

    refused("chmod 600")
    passwords.chmod(0o600)
    refused("no password", observers=["bob"])
    refused("twice", observers=["alice"])
    refused("name the operators", operators=[])
    refused("either", certificates="x")
    refused("either", passwords="")
    refused("cannot be read", passwords=str(tmp_path / "none"))
    refused("tls/HOST", passwords="", certificates=str(tmp_path))
    passwords.write_text("alice:short\n")
    refused("8 characters")
    passwords.write_bytes(b"alice:\xff\xff\xff\xff\xff\xff\xff\xff\n")
    refused("not UTF-8")
    path = tmp_path / "two"
    path.write_text("a:b\nc:d\n")
    path.chmod(0o600)
    with pytest.raises(BadInput, match="one line"):
        client_settings(str(path))
    assert client_settings("") == {}


def test_keys_are_private_and_never_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "keys"
    assert main(["keys", str(folder), "--client", "alice"]) == 0
    for path in folder.rglob("key.pem"):
        assert path.stat().st_mode & 0o777 == 0o600
    before = (folder / "alice" / "key.pem").read_bytes()
    assert main(["keys", str(folder), "--client", "alice"]) == 2
    assert "has a key already" in capsys.readouterr().err
    assert (folder / "alice" / "key.pem").read_bytes() == before
    assert main(["keys", str(folder), "--client", "bob"]) == 0
    assert (folder / "bob" / "ca.pem").read_bytes() == (folder / "alice" / "ca.pem").read_bytes()
    for bad in (["--client", "../x"], ["--client", "authority"], [], ["--controller", "a"]):
        assert main(["keys", str(folder), *bad]) == 2


def test_the_commands_take_credentials(
    secured: Secured, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    for name, code in (("alice", 0), ("bob", 2), ("eve", 2)):
        arguments = ["send", "3", "--connect", secured.address]
        assert main([*arguments, "--credentials", secured.credentials(name)]) == code
        said = capsys.readouterr().err
        assert code == 0 or ("credentials" in said and said.count("\n") == 1)
