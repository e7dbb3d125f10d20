"""Programs other than browsers may use the page's WebSocket; a page of another site may not."""

import json
import re
import shutil
import socket
import subprocess
from collections.abc import Iterator

import pytest
from tests.rigs.gateway_bench import ROOT, Bench, started_bench, wait_until
from tests.rigs.page import PageProcess
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from dehyst.daemon.rings.records import State

pytestmark = pytest.mark.processes
EXAMPLE = ROOT / "docs" / "examples" / "websocket_client.mjs"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("bench")) as bench:
        yield bench


@pytest.fixture(scope="module")
def page(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    page = PageProcess(bench.address, log=tmp_path_factory.mktemp("page") / "page.txt")
    try:
        yield page
    finally:
        page.close()
        assert "Traceback" not in page.log.read_text()


def test_a_program_that_sends_no_origin_is_served(page: PageProcess) -> None:
    with connect(page.url.replace("http", "ws") + "/stream") as wire:
        first = json.loads(wire.recv(timeout=20.0))
    assert first["kind"] == "controllers"
    assert first["protocol"] == 1


@pytest.mark.parametrize("origin", ["http://example.org", "http://127.0.0.1:1", "null"])
def test_a_page_of_another_site_is_refused(page: PageProcess, origin: str) -> None:
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(page.url.replace("http", "ws") + "/stream", origin=origin),  # type: ignore[arg-type]
    ):
        pass
    assert refused.value.response.status_code == 403


def test_a_host_name_of_somebody_else_is_refused_without_origin_too(page: PageProcess) -> None:
    address = page.url.replace("http", "ws") + "/stream"
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(
            address.replace("127.0.0.1", "attacker.example"),
            sock=socket.create_connection(("127.0.0.1", page.port)),
        ),
    ):
        pass
    assert refused.value.response.status_code == 403


def node() -> list[str]:
    """Return the command line of a Node.js with WebSocket, or skip the test and give the reason."""
    found = shutil.which("node")
    if found is None:
        pytest.skip("Node.js is not installed")
    version = subprocess.run([found, "--version"], capture_output=True, text=True, check=True)
    major = int(re.findall(r"\d+", version.stdout)[0])
    if major < 20:
        pytest.skip(f"Node.js {major} has no WebSocket; 20 and later do")
    return [found] if major >= 22 else [found, "--experimental-websocket"]


def test_the_node_example_commands_and_reads(bench: Bench, page: PageProcess) -> None:
    begun = bench.loop.seq
    command = [*node(), str(EXAMPLE), page.url.replace("http", "ws") + "/stream"]
    done = subprocess.run(command, text=True, capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    place, unit, measured = re.findall(r"target (\S+) (\w+), measured (\S+)", done.stdout)[0]
    assert unit == "um"
    targets = bench.loop.samples(begun)["target"]
    assert (abs(targets - float(place)) < 1e-3).any()
    assert abs(float(measured) - float(place)) < 0.5


MOVES = """
const socket = new WebSocket(process.argv[1]);
socket.onopen = () => {
  socket.send(JSON.stringify({ask: "look", name: "bench", window_s: 10, width_px: 100}));
  socket.send(JSON.stringify({ask: "go", value: 6.5, seconds: 600}));
};
socket.onmessage = () => {};
"""


def test_a_program_that_is_killed_in_motion_leaves_the_stage_as_any_client_does(
    bench: Bench, page: PageProcess
) -> None:
    address = page.url.replace("http", "ws") + "/stream"
    program = subprocess.Popen(
        [*node(), "-e", MOVES, address], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        newest = lambda: bench.loop.samples(bench.loop.seq - 1)[-1]  # noqa: E731
        wait_until("it moves", lambda: abs(newest()["target"] - 6.5) < 1e-6)
    finally:
        program.kill()
        program.wait()
    wait_until("it lets go", lambda: bench.loop.state == State.READY)
    assert newest()["volts"] == pytest.approx(0.0, abs=0.1)
