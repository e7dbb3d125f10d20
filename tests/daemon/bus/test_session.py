"""The bus over real zenoh sessions on loopback."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import free_port, wait_until

from dehyst.daemon.bus import topics
from dehyst.daemon.bus.session import Asked, Bus, BusError, NoAnswer
from dehyst.models.errors import BadInput


@pytest.fixture
def address() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def test_a_client_that_takes_nothing_for_3_s_is_ended_by_the_kernel(address: str) -> None:
    """The kernel ends the connection of a client that accepts no data for 3 s. The limit is read
    from the gateway's own sockets, so the machine's load does not matter."""
    with Bus.serve([address], []), Bus.connect([address]):
        port, limits = int(address.rpartition(":")[2]), []
        for name in os.listdir("/proc/self/fd"):
            if "socket:" not in os.path.realpath(f"/proc/self/fd/{name}"):
                continue
            with socket.socket(fileno=os.dup(int(name))) as one:
                here = one.getsockname() if one.family == socket.AF_INET else ()
                if here and here[1] == port:  # the listener, and the link to the client
                    limits.append(one.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT))
    assert len(limits) == 2
    assert set(limits) == {3000}


def test_publish_ask_and_see_who_is_there(address: str) -> None:
    got: deque[tuple[str, bytes]] = deque()
    with Bus.serve([address], []) as server:

        def answer(asked: Asked) -> None:
            for part in (b"one", b"two", asked.payload):
                asked.reply(part)
            asked.done()

        server.answer("lab/@v1/a/rpc/x", answer)
        server.answer("lab/@v1/a/rpc/no", lambda asked: (asked.refuse("not today"), asked.done()))
        server.listen("lab/@v1/a/pubsub/setpoint_$*/*", lambda k, p: got.append((k, p)))
        server.announce("lab/@v1/a/alive")  # last, because whoever sees it may ask
        with Bus.connect([address]) as client:
            wait_until(
                "it is there", lambda: client.alive("lab/@v1/*/alive") == ["lab/@v1/a/alive"]
            )
            # without `long`, an answer may be dropped if the link stays full
            reported = list(client.ask("lab/@v1/a/rpc/x", b"three", long=True))
            assert reported == [b"one", b"two", b"three"]
            with pytest.raises(BusError, match="not today"):
                list(client.ask("lab/@v1/a/rpc/no"))
            with pytest.raises(BusError, match="nobody answers"):
                list(client.ask("lab/@v1/b/rpc/x"))
            sender = client.sender("lab/@v1/a/pubsub/setpoint_um/7", topics.SETPOINT)
            wait_until("the subscriber is known", lambda: sender.put(b"x") or bool(got))
            assert got[0] == ("lab/@v1/a/pubsub/setpoint_um/7", b"x")
            server.close()
            wait_until("the token is gone", lambda: client.alive("lab/@v1/*/alive") == [])
            with pytest.raises(BusError):
                list(client.ask("lab/@v1/a/rpc/x"))


def test_closed_from_a_daemon_thread_it_leaves_no_thread_to_the_interpreters_end(
    address: str,
) -> None:
    """A closed session leaves no daemon thread: one that wakes while the interpreter ends aborts
    the program."""
    entered, leave, opened, end = (threading.Event() for _ in range(4))
    before = set(threading.enumerate())

    def store(*_: object) -> None:
        entered.set()
        leave.wait(30.0)

    def hear() -> None:
        with Bus.connect([address]) as client:
            client.listen("lab/heard", store)
            for number in range(8):
                client.listen(f"lab/{number}", store)
            opened.set()
            end.wait(30.0)

    with Bus.serve([address], []) as server:
        thread = threading.Thread(target=hear, daemon=True)
        thread.start()
        assert opened.wait(30.0)
        sender = server.sender("lab/heard", topics.EVENT)
        wait_until("it hears", lambda: sender.put(b"x") or entered.is_set())
        end.set()
        thread.join(0.3)
        assert thread.is_alive(), "closed while its callback runs"
        leave.set()
        thread.join(30.0)
        left = set(threading.enumerate()) - before
    assert not [one for one in left if one.daemon]


def test_an_answer_that_never_comes(address: str) -> None:
    held: list[Asked] = []
    with Bus.serve([address], []) as server, Bus.connect([address]) as client:
        server.answer("lab/@v1/a/rpc/x", held.append)
        wait_until("the queryable is known", lambda: asks(client, held))
        with pytest.raises(NoAnswer, match=r"within 0\.2 s"):
            list(client.ask("lab/@v1/a/rpc/x", timeout_s=0.2))
        for asked in held:
            asked.done()


def asks(client: Bus, held: list[Asked]) -> bool:
    try:
        list(client.ask("lab/@v1/a/rpc/x", timeout_s=0.1))
    except BusError:
        return bool(held)
    return True


def test_errors_in_words(address: str) -> None:
    with pytest.raises(BusError, match=r"no daemon reached at tcp/127.0.0.1:\d+: is it running"):
        Bus.connect([address], timeout_s=0.3)
    with Bus.serve([address], []), pytest.raises(BusError, match="cannot listen on"):
        Bus.serve([address], [])
    with pytest.raises(BadInput, match="'nonsense' is not an address"):
        Bus.connect(["nonsense"], timeout_s=0.3)


def test_a_payload_beyond_the_limit_does_not_arrive_and_the_next_does(address: str) -> None:
    got: deque[int] = deque()
    with Bus.serve([address], []) as server, Bus.connect([address]) as client:
        server.listen("lab/**", lambda k, p: got.append(len(p)))
        sender = client.sender("lab/x", topics.SETPOINT)
        wait_until("the subscriber is known", lambda: sender.put(b"x") or bool(got))
        sender.put(b"x" * 10_000_000)
        sender.put(b"x" * 1000)
        wait_until("the small one arrives", lambda: 1000 in got)
        assert max(got) == 1000


def test_listens_on_loopback_alone_and_sends_no_scouting(address: str) -> None:
    with Bus.serve([address], []):
        sockets = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
        port = f"{int(address.rsplit(':', 1)[1]):04X}"
        listening = [line.split()[1] for line in sockets.splitlines() if " 0A " in line]
        assert [a for a in listening if a.endswith(f":{port}")] == [f"0100007F:{port}"]
        mine = {p.readlink().name for p in Path("/proc/self/fd").iterdir() if p.is_symlink()}
        inodes = {m.removeprefix("socket:[").rstrip("]") for m in mine if m.startswith("socket:[")}
        for table in ("/proc/net/udp", "/proc/net/udp6"):
            for line in Path(table).read_text().splitlines()[1:]:
                assert line.split()[9] not in inodes, "a UDP socket is open"


CLOSES = """
import sys, threading
from dehyst.daemon.bus.session import Bus
bus = Bus.connect([sys.argv[1]])
with bus:
    bus.listen("lab/**", lambda k, p: None)
    raise RuntimeError("in the midst")
"""


def test_a_program_that_fails_ends_at_once(address: str) -> None:
    with Bus.serve([address], []):
        src = Path(__file__).resolve().parents[3] / "src"
        begun = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-c", CLOSES, address],
            env={"PYTHONPATH": str(src), "PATH": "/usr/bin:/bin"},
            stderr=subprocess.PIPE,
            timeout=30,
            check=False,
        )
    assert b"in the midst" in done.stderr
    assert done.returncode == 1
    assert time.monotonic() - begun < 30
    assert threading.active_count() < 20
