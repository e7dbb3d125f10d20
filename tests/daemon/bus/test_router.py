"""Controllers connected through a zenoh router, with the shipped configurations and the shipped
program."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.rigs import controllers
from tests.rigs.gateway_bench import (
    ROOT,
    Bench,
    follows,
    forged_setpoint,
    free_port,
    observer_only_hears,
    wait_until,
)

from dehyst.daemon.bus import encoding, topics
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.security import client_settings
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.finding import daemons
from dehyst.daemon.config import load_config, parse_config
from dehyst.daemon.main import main
from dehyst.models.errors import BadInput

EXAMPLES = ROOT / "docs" / "examples"


@contextmanager
def router(folder: Path, name: str, address: str) -> Iterator["subprocess.Popen[str]"]:
    """Run a router with a shipped configuration; only its address differs."""
    endpoints = f"listen/endpoints={json.dumps([address])}"
    command = [sys.executable, str(EXAMPLES / "router.py"), str(EXAMPLES / name), endpoints]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert "is up" in process.stdout.readline()
        yield process
    finally:
        process.terminate()
        process.wait(10.0)
        process.stdout.close()


def behind(folder: Path, name: str, address: str, auth: str = "") -> Bench:
    """Return a running loop and gateway that listen on nothing and connect only to the router."""
    folder.mkdir(exist_ok=True)
    bus = f'\nbus = {{listen = [], connect = ["{address}"]{auth}}} #'
    bench = Bench(folder, **{"\nbus = {": bus, '"bench"': f'"{name}"'})
    bench.port = int(address.rpartition(":")[2])
    bench.start_gateway()
    return bench


def wait_for(name: str, address: str, credentials: str = "") -> None:
    """Wait until a controller is visible through the router: a process takes time to start."""
    with Bus.connect([address], 20.0, client_settings(credentials)) as bus:
        wait_until(f"{name} is found", lambda: name in daemons(bus), 60.0)


def listening(pid: int) -> list[str]:
    """Return the local addresses on which a process listens."""
    inodes = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        inodes.add(str(fd.readlink()))
    lines = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
    rows = [line.split() for line in lines.splitlines()]
    return [r[1] for r in rows if r[3] == "0A" and f"socket:[{r[9]}]" in inodes]


def test_a_second_daemon_of_a_name_behind_the_same_router_is_refused(tmp_path: Path) -> None:
    address = f"tcp/127.0.0.1:{free_port()}"
    with router(tmp_path, "router.json5", address):
        first = behind(tmp_path / "a", "stage-01", address)
        try:
            wait_for("stage-01", address)
            assert first.gateway is not None
            text = first.path.read_text().replace("/a/run", "/b/run")
            (tmp_path / "b").mkdir()
            (tmp_path / "b" / "bench.toml").write_text(text)
            done = subprocess.run(
                [sys.executable, "-m", "dehyst.daemon.main", "gateway", "--config",
                 str(tmp_path / "b" / "bench.toml")],
                capture_output=True, text=True, timeout=60, check=False,
            )  # fmt: skip
            assert done.returncode == 2, done.stderr
            assert "a daemon named stage-01 is on the bus" in done.stderr
            assert f"process {first.gateway.pid} " in done.stderr
            first.kill_gateway()  # a restarted gateway is not refused because of itself
            first.start_gateway()
            wait_for("stage-01", address)
        finally:
            first.close()


def test_clients_find_and_command_controllers_through_a_router(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    address = f"tcp/127.0.0.1:{free_port()}"
    benches: list[Bench] = []
    try:
        with router(tmp_path, "router.json5", address):
            benches += [behind(tmp_path / n, n, address) for n in ("stage-01", "stage-02")]
            first = benches[0].gateway
            assert first is not None
            for name in ("stage-01", "stage-02"):
                wait_for(name, address)
            assert listening(first.pid) == []
            with pytest.raises(BusError, match="stage-01, stage-02; choose one: --name stage-01"):
                Client(connect=address)
            client = Client("stage-02", address)
            benches[1].clients.append(client)
            wait_until("the loop is seen", lambda: follows(client))
            stream = client.stream()
            assert client.send(3.0).ok
            targets: set[float] = set()

            def followed() -> bool:
                targets.update(stream.read(0.1)["target"].tolist())
                return 3.0 in targets

            wait_until("the set-point is followed", followed)

            def listed_as_running() -> bool:
                assert client.send(3.0).ok  # it becomes stale after a second
                capsys.readouterr()
                assert main(["watch", "--list", "--connect", address]) == 0
                out = capsys.readouterr().out.splitlines()
                assert [line.split()[0] for line in out] == ["stage-01", "stage-02"]
                return "running" in out[1]

            wait_until("the list shows it", listed_as_running)
        # without a router nobody is reached; the loop continues, and everything comes back
        run, before = stream.run, stream.next_seq
        with router(tmp_path, "router.json5", address):

            def again() -> bool:
                stream.read(0.1)
                return stream.next_seq > before + 200

            wait_until("telemetry comes back", again)
            assert stream.run == run
            assert stream.lost == 0
            assert client.send(4.0).ok
    finally:
        for bench in benches:
            bench.close()


@pytest.mark.timeout(300)  # ten processes start, which takes time on a busy machine
def test_nothing_is_lost_between_two_daemons_and_four_subscribers() -> None:
    """Every subscriber receives every sample, status and event, and every command is answered. A
    small form of the benchmark with 20 daemons and 50 subscribers (`dehyst run`, real loops on the
    simulated stage)."""
    result = controllers.run(2, 4, 4.0)
    assert result.samples > 4 * 100
    assert (result.lost, result.bad, result.overwritten) == (0, 0, 0)
    assert result.reported >= 3
    assert result.untold == 0
    assert result.put > 30
    assert (result.lost_commands, result.unanswered) == (0, 0)


class Lab:
    """The controller stage-01 connected through a secured router. Credentials are in keys/NAME."""

    def __init__(self, folder: Path, address: str) -> None:
        self.folder, self.address = folder, address
        self.keys = Keys("dehyst", "stage-01")
        auth = f', auth = {{credentials = "{folder}/keys/stage-01"}}'
        self.bench = behind(folder / "bench", "stage-01", address, auth)
        wait_for("stage-01", address, f"{folder}/keys/alice")

    def session(self, name: str) -> Bus:
        """Return a bare session with somebody's credentials."""
        return Bus.connect([self.address], security=client_settings(str(self.folder / name)))

    def client(self, name: str) -> Client:
        """Return a client with somebody's credentials."""
        client = Client("stage-01", self.address, credentials=str(self.folder / "keys" / name))
        self.bench.clients.append(client)
        return client


NAMES = ["stage-01", "stage-02", "alice", "bob", "carol"]


def certificates(folder: Path) -> None:
    """Make certificates with `dehyst keys`; those of others/alice come from another authority."""
    made = [x for name in NAMES for x in ("--client", name)]
    host = ["--controller", "router", "--host", "127.0.0.1"]
    assert main(["keys", str(folder / "keys"), *host, *made]) == 0
    assert main(["keys", str(folder / "others"), "--client", "alice"]) == 0


def passwords(folder: Path) -> None:
    """Write files of name:password lines; others/alice has another password."""
    lines = {name: f"{name}:the word of {name}\n" for name in NAMES}
    files = {f"keys/{name}": line for name, line in lines.items()}
    files |= {"keys/passwords": "".join(lines.values()), "others/alice": "alice:a mere guess\n"}
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        path.chmod(0o600)


@pytest.fixture(params=["certificates", "passwords"])
def lab(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Lab]:
    by_certificate = request.param == "certificates"
    (certificates if by_certificate else passwords)(tmp_path)
    address = f"{'tls' if by_certificate else 'tcp'}/127.0.0.1:{free_port()}"
    name = "router-secured.json5" if by_certificate else "router-passwords.json5"
    with router(tmp_path, name, address):
        lab = Lab(tmp_path, address)
        try:
            yield lab
        finally:
            lab.bench.close()


def test_a_router_that_asks_for_credentials_enforces_the_roles(lab: Lab) -> None:
    operator, observer = lab.client("alice"), lab.client("bob")
    stream, targets = observer_only_hears(operator, observer)
    forged = forged_setpoint(operator)
    batch = encoding.encode(encoding.batch(stream.read(20.0)[:1], 12345, "um", 0))
    others = operator.stream()
    with lab.session("keys/stage-02") as neighbour, lab.session("keys/carol") as nobody:
        heard: list[str] = []
        for bus in (observer.bus, neighbour, nobody):
            key = lab.keys.pubsub("setpoint_um", "1")
            bus.sender(key, topics.SETPOINT).put(encoding.encode(forged))
            bus.sender(lab.keys.pubsub("telemetry"), topics.TELEMETRY).put(batch)
        for bus in (neighbour, nobody):  # with credentials, but without a role here
            bus.listen(lab.keys.pubsub("telemetry"), lambda key, _: heard.append(key))
            assert daemons(bus) == []
            for method in ("status", "command"):
                with pytest.raises(BusError):
                    list(bus.ask(lab.keys.rpc(method), encoding.encode(forged), timeout_s=0.3))
        neighbour.announce("dehyst/@v1/stage-03/alive")
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            targets.update(others.read(0.1)["target"].tolist())
            assert others.run != 12345
        assert daemons(operator.bus) == ["stage-01"]
        assert heard == []
    assert 9.0 not in targets
    for name in ("others/alice", ""):
        with pytest.raises(BusError, match="credentials"):
            Bus.connect(
                [lab.address],
                timeout_s=0.5,
                security=client_settings(str(lab.folder / name)) if name else None,
            )


CONFIG = """
name = "x"
model = {file = "paper-eq11"}
actuator = {driver = "simulated"}
sensor = {driver = "simulated"}
limits = {min_v = 0.0, max_v = 10.0, slew_v_per_s = 100.0}
bus = {BUS}
"""


@pytest.mark.parametrize(
    ("bus", "says"),
    [
        ('listen = [], connect = ["tcp/10.0.0.1:7447"]', "on the network"),
        ('connect = ["tcp/router.lab:7447"]', "on the network"),
        ('connect = ["tls/10.0.0.1:7447"], auth = {credentials = "x"}', r"bus.listen = \[\]"),
        ('auth = {credentials = "x"}', "name them"),
        ('connect = ["tcp/[::1]:1"], auth = {passwords = "p", operators = ["a"]}', "distinguished"),
        ("listen = []", "nobody could reach"),
        ('listen = [], connect = ["tls/10.0.0.1:7447"], auth = {credentials = "x"}', ""),
        ('connect = ["tcp/127.0.0.1:7448"]', ""),
        ('listen = [], connect = ["tcp/localhost:7447"]', ""),
    ],
)
def test_no_way_through_a_router_without_credentials(bus: str, says: str, tmp_path: Path) -> None:
    text = CONFIG.replace("BUS", bus)
    if says:
        with pytest.raises(BadInput, match=says):
            parse_config(text)
    else:
        parse_config(text)
        (tmp_path / "c.toml").write_text(text)
        auth = load_config(tmp_path / "c.toml").bus.auth
        assert auth is None or auth.credentials == str(tmp_path / "x")
