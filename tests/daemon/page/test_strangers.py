"""Whatever a stranger does to the page's server, other users are still served. Addresses 127.0.0.x
stand for other people's computers."""

import asyncio
import base64
import json
import random
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from tests.rigs.gateway_bench import Bench, free_port, started_bench
from tests.rigs.page import Browser, PageProcess
from tests.rigs.processes import until
from websockets.exceptions import ConnectionClosed, InvalidStatus

from dehyst.daemon.main import main
from dehyst.daemon.page.doors import HEAD_S, MOST_OF_ONE
from dehyst.daemon.page.guesses import FREE
from dehyst.daemon.page.server import MOST_VISITS_OF_ONE, STALLED_S

PATIENCE_S = 30.0
RIGHT = ("alice", "correct horse")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("strangers")) as bench:
        yield bench


@pytest.fixture(scope="module")
def page(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    yield from served(bench, tmp_path_factory.mktemp("page"))


@pytest.fixture
def closed_page(bench: Bench, tmp_path: Path) -> Iterator[PageProcess]:
    """A page that requires passwords."""
    (tmp_path / "passwords").write_text("alice:correct horse\nbob:battery staple\n")
    (tmp_path / "passwords").chmod(0o600)
    given = ("--passwords", str(tmp_path / "passwords"), "--operators", "alice")
    yield from served(bench, tmp_path, *given, "--observers", "bob")


def served(bench: Bench, folder: Path, *given: str) -> Iterator[PageProcess]:
    """Serve a page that must end without a traceback, whatever was done to it."""
    page = PageProcess(bench.address, *given, log=folder / "page.txt")
    try:
        yield page
    finally:
        page.close()
        assert "Traceback" not in page.log.read_text()


def client(page: PageProcess, source: str) -> httpx.Client:
    """Return an HTTP client that connects from this source address."""
    transport = httpx.HTTPTransport(local_address=source)
    headers = {"origin": page.url}
    return httpx.Client(base_url=page.url, transport=transport, headers=headers, timeout=30.0)


def basic(name: str, password: str) -> dict[str, str]:
    return {"authorization": "Basic " + base64.b64encode(f"{name}:{password}".encode()).decode()}


def by_form(one: httpx.Client, number: int) -> int:
    return one.post("/login", json={"name": "alice", "password": str(number)}).status_code


def by_header(one: httpx.Client, number: int) -> int:
    return one.get("/metrics", headers=basic("alice", str(number))).status_code


def by_text_that_is_none(one: httpx.Client, number: int) -> int:
    return one.get("/me", headers={"authorization": b"Basic \xff%d" % number}).status_code


def by_token(one: httpx.Client, number: int) -> int:
    return one.get("/me", headers={"cookie": f"dehyst={number}"}).status_code


def by_socket(one: httpx.Client, number: int) -> int:
    upgrade = {
        "connection": "upgrade", "upgrade": "websocket", "sec-websocket-version": "13",
        "sec-websocket-key": "AAAAAAAAAAAAAAAAAAAAAA==",
    }  # fmt: skip
    answer = one.get("/stream", headers=upgrade | basic("alice", str(number)))
    return {403: 401}.get(answer.status_code, answer.status_code)


WAYS = (by_form, by_header, by_text_that_is_none, by_token, by_socket)


@pytest.mark.parametrize("way", WAYS)
def test_guesses_are_slow_whichever_way_and_nobody_else_waits(
    closed_page: PageProcess, way: Callable[[httpx.Client, int], int]
) -> None:
    with client(closed_page, "127.0.0.2") as guesser, client(closed_page, "127.0.0.3") as alice:
        began = time.monotonic()
        answers = [way(guesser, i) for i in range(120)]
        looked_at = answers.count(401)
        assert set(answers) == {401, 429}
        assert looked_at <= FREE + 1 + (time.monotonic() - began) / 10.0
        for other in WAYS:  # guesses by one method slow down all methods
            assert other(guesser, 1) == 429
        right = guesser.post("/login", json={"name": RIGHT[0], "password": RIGHT[1]})
        assert right.status_code == 429  # checking it would reveal whether the password is right
        assert 1 <= int(right.headers["retry-after"]) <= 10
        assert "127.0.0.2" in right.text
        assert alice.get("/metrics", auth=RIGHT).status_code == 200


def test_a_session_that_has_begun_waits_for_no_guesses(closed_page: PageProcess) -> None:
    cookie = log_in(closed_page)
    for number in range(20):
        by_header(closed_page.http, number)
    assert by_header(closed_page.http, 1) == 429
    assert closed_page.http.get("/me", headers={"cookie": f"dehyst={cookie}"}).status_code == 200


def log_in(page: PageProcess) -> str:
    answer = page.post(
        "/login", content=json.dumps(dict(zip(("name", "password"), RIGHT, strict=True)))
    )
    assert answer.status_code == 200
    page.http.cookies.clear()
    return answer.cookies["dehyst"]


def test_a_token_that_has_ended_is_taken_from_the_browser(closed_page: PageProcess) -> None:
    answer = closed_page.http.get("/me", headers={"cookie": "dehyst=of-yesterday"})
    assert answer.status_code == 401
    assert "dehyst=" in answer.headers["set-cookie"]
    assert "Max-Age=0" in answer.headers["set-cookie"]


def test_log_out_ends_what_the_log_in_opened(bench: Bench, closed_page: PageProcess) -> None:
    cookie = log_in(closed_page)
    browsers = [Browser(closed_page, cookie) for _ in range(2)]
    other = Browser(closed_page, log_in(closed_page))
    for browser in (*browsers, other):
        browser.look()
        browser.until("its status", lambda b=browser: b.said.get("status"))  # type: ignore[misc]
    browsers[0].ask("go", value=5.0, seconds=600.0)
    until(lambda: bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 5.0, PATIENCE_S, "there")
    headers = {"origin": closed_page.url, "cookie": f"dehyst={cookie}"}
    assert closed_page.http.post("/logout", headers=headers).status_code == 200
    for browser in browsers:
        with pytest.raises(ConnectionClosed):
            browser.until("it is ended", lambda: False, PATIENCE_S)
    until(lambda: bench.loop.state.name == "READY", PATIENCE_S, "nobody commands")
    other.ask("stop")
    other.until("the other session goes on", lambda: other.texts())
    for browser in (*browsers, other):
        browser.close()


HEADS = {
    "silent": b"",
    "half": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ",
    "one-letter": b"G",
    "body-never-comes": b"POST /upload/identify HTTP/1.1\r\nHost: localhost\r\n"
    b"Origin: http://localhost\r\nContent-Length: 1000\r\n\r\n",
}


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("source", ["127.0.0.1", "127.0.0.9"])
def test_500_connections_that_say_nothing_cost_nobody_anything(
    page: PageProcess, head: str, source: str
) -> None:
    with ExitStack() as held:
        many = []
        for _ in range(500):
            one = held.enter_context(socket.socket())
            if source != "127.0.0.1":  # bound ports are of those that other tests take as free
                one.bind((source, 0))
            one.connect(("127.0.0.1", page.port))
            one.sendall(HEADS[head])
            many.append(one)
        with client(page, "127.0.0.1") as somebody:
            assert [somebody.get("/me").status_code for _ in range(20)] == [200] * 20
        Browser(page).close()
        with client(page, "127.0.0.3") as another:
            assert another.get("/static/page.js").status_code == 200
        if head == "body-never-comes":
            return
        assert sum(is_open(one) for one in many) <= MOST_OF_ONE
        if head != "half" or source == "127.0.0.1":
            return
        until(lambda: not any(map(is_open, many)), 2 * HEAD_S + 10.0, "all are ended")


def test_a_body_of_which_nothing_comes_is_given_up(page: PageProcess) -> None:
    with socket.create_connection(("127.0.0.1", page.port)) as one:
        one.sendall(HEADS["body-never-comes"] + b"half")
        one.settimeout(STALLED_S + 10.0)
        assert b" 408 " in one.recv(1 << 16)


def test_silent_connections_before_tls_cost_nobody_anything(bench: Bench, tmp_path: Path) -> None:
    made = [str(tmp_path / "keys"), "--controller", "stage", "--host", "127.0.0.1"]
    assert main(["keys", *made, "--client", "alice"]) == 0
    folder = tmp_path / "keys" / "stage"
    given = "--certificate", str(folder / "certificate.pem"), "--key", str(folder / "key.pem")
    page = PageProcess(bench.address, *given, log=tmp_path / "page.txt", scheme="https")
    try:
        with ExitStack() as held:
            many = [
                held.enter_context(socket.create_connection(("127.0.0.1", page.port)))
                for _ in range(500)
            ]
            assert [page.http.get("/me").status_code for _ in range(5)] == [200] * 5
            with httpx.Client(base_url=page.url, verify=False, timeout=30.0) as afresh:
                assert afresh.get("/me").status_code == 200
            until(lambda: not any(map(is_open, many)), 2 * HEAD_S + 10.0, "all are ended")
    finally:
        page.close()
    assert "Traceback" not in page.log.read_text()


def is_open(one: socket.socket) -> bool:
    """Return whether the server has left this connection open."""
    one.setblocking(False)
    try:
        return one.recv(1 << 16) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def test_pages_that_are_deaf_leave_room_for_another_address(page: PageProcess) -> None:
    deaf = [Browser(page, source="127.0.0.5") for _ in range(MOST_VISITS_OF_ONE)]
    for _ in range(64 - MOST_VISITS_OF_ONE):
        with pytest.raises(InvalidStatus, match="503"):
            Browser(page, source="127.0.0.5")
    other = Browser(page, source="127.0.0.6")
    other.look()
    other.until("its status", lambda: other.said.get("status"))
    for browser in (*deaf, other):
        browser.close()


def test_who_answers_no_ping_is_ended(page: PageProcess) -> None:
    raw = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(4)]
    for one in raw:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.sendall(
            f"GET /stream HTTP/1.1\r\nHost: {page.host}\r\nOrigin: {page.url}\r\nUpgrade: websocket"
            "\r\nConnection: upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
            "AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        )
    held = f":{page.port:04X} "

    def served_ones() -> int:
        rows = Path("/proc/net/tcp").read_text().splitlines()[1:]
        return sum(held in row.split()[1] + " " and row.split()[3] == "01" for row in rows)

    until(lambda: served_ones() >= 4, PATIENCE_S, "they are served")
    until(lambda: served_ones() <= 1, 60.0, "they are ended")  # except the fixture's own
    for one in raw:
        one.close()


FRAMES: tuple[str | bytes, ...] = (
    b"", b"\x00" * 70, b"\xff" * 60_000, "", "null", "[" * 60_000, '{"x":' + "[" * 60_000,
    '{"ask":"go","value":' + "9" * 60_000 + ',"seconds":1}', '{"ask":"go","value":NaN,"seconds":1}',
    '{"ask":"look","name":"\\ud800","window_s":1,"width_px":100}', "x" * 65_000,
    '{"ask":"past","first_s":1e12,"end_s":1e12,"width_px":8192}', '{"ask":"stop","at_once":1}',
)  # fmt: skip


def test_a_wrong_frame_costs_its_sender_alone(page: PageProcess) -> None:
    watcher = Browser(page)
    watcher.look()
    watcher.until("its status", lambda: watcher.said.get("status"))
    for frame in FRAMES:
        browser = Browser(page)
        browser.look()
        browser.socket.send(frame)
        browser.until("words", browser.texts)
        browser.close()
    asks = random.Random(3)
    ends = (0.0, 1e-300, 1.0, 1e6, 1e12, time.monotonic(), time.monotonic() - 5.0)
    browser = Browser(page)
    browser.look()
    for _ in range(200):
        first_s, end_s = asks.choice(ends), asks.choice(ends)
        browser.ask("past", first_s=first_s, end_s=end_s, width_px=asks.choice((50, 8192)))
        window_s, width_px = asks.choice((0.1, 1.0, 3600.0)), asks.choice((50, 8192))
        browser.ask("look", name="bench", window_s=window_s, width_px=width_px)
    browser.ask("stop")
    browser.until("it goes on", lambda: any("stopped" in text for text in browser.texts()))
    browser.close()
    huge = Browser(page)
    huge.socket.send("y" * 200_000)
    with pytest.raises(ConnectionClosed):
        huge.until("it is ended", lambda: False)
    watcher.ask("stop")
    watcher.until("it goes on", watcher.texts)
    watcher.close()


def test_2000_questions_at_once_are_heard_in_turn(page: PageProcess) -> None:
    browser, other = Browser(page), Browser(page, source="127.0.0.6")
    for one in (browser, other):
        one.look()
        one.until("points", lambda o=one: o.frames)  # type: ignore[misc]
    newest_s = browser.frames[-1].first_s
    for _ in range(2000):
        browser.ask("past", first_s=max(0.0, newest_s - 1.0), end_s=newest_s + 1.0, width_px=500)
    began = len(other.frames)
    other.until("the other's plots go on", lambda: len(other.frames) > began + 10)
    browser.until("an answer", lambda: [f for f in browser.frames if f.magic == 0x32504844])
    for one in (browser, other):
        one.close()


def test_any_bytes_in_place_of_http_end_their_connection_alone(page: PageProcess) -> None:
    random.seed(7)
    head = f"POST /login HTTP/1.1\r\nHost: {page.host}\r\nOrigin: {page.url}\r\n".encode()
    texts = [
        b"\x16\x03\x01" * 40, b"GET /\r\n\r\n", b"\r\n" * 900, b"A" * 200_000,
        head + b"Transfer-Encoding: chunked\r\n\r\nZZ\r\n", head + b"Content-Length: x\r\n\r\n",
        head + b"Content-Length: 5\r\n\r\n{{{{{{{{",
        head + b'Content-Length: 9\r\n\r\n{"a": 1}\n',
        head + b'Content-Length: 17\r\n\r\n{"name":"\\ud800"}',
        head + b"Content-Length: 2\r\n\r\n{}GET",
        b"GET /%ff%00/..%2f HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET /stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
        b"Connection: upgrade\r\n\r\n",
        b"GET /me HTTP/1.1\r\nHost: \xff\xfe\r\nCookie: dehyst=\xff;;=;\r\n\r\n",
    ]  # fmt: skip
    texts += [random.randbytes(300) for _ in range(50)]
    for text in texts:
        with socket.create_connection(("127.0.0.1", page.port)) as one:
            one.settimeout(5.0)
            try:
                one.sendall(text)
                one.shutdown(socket.SHUT_WR)
                one.recv(1 << 16)
            except OSError:
                pass
    assert page.http.get("/me").status_code == 200


def test_more_requests_at_once_than_a_browser_makes_are_refused_to_that_address(
    page: PageProcess,
) -> None:
    async def ask() -> list[int]:
        transport = httpx.AsyncHTTPTransport(local_address="127.0.0.7")
        async with httpx.AsyncClient(base_url=page.url, transport=transport, timeout=60.0) as one:
            tasks = [one.get("/me") for _ in range(60)]
            return [answer.status_code for answer in await asyncio.gather(*tasks)]

    assert set(asyncio.run(ask())) <= {200, 503}
    assert page.http.get("/me").status_code == 200


def test_a_port_that_is_busy_is_said_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        assert main(["page", "--listen", f"127.0.0.1:{port}"]) == 2
    said = capsys.readouterr().err
    assert f"another program listens on port {port}" in said
    assert said.count("\n") == 1
    assert "http://" not in said


@pytest.mark.parametrize("port", ["80801", "0", "-1", "http", "", "9" * 5000, "²"])
def test_a_port_that_is_none_is_named(capsys: pytest.CaptureFixture[str], port: str) -> None:
    assert main(["page", "--listen", f"127.0.0.1:{port}"]) == 2
    said = capsys.readouterr().err
    assert f"{port[:20]!r} is not a port" in said
    assert said.count("\n") == 1


def test_a_host_that_is_not_here_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["page", "--listen", f"[::1%nowhere]:{free_port()}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
