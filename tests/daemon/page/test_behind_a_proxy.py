"""The page works under a path of a TLS reverse proxy. A real nginx and a real Caddy run with the
configurations of docs/examples; a real Chromium reaches the page through nginx."""

import json
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from tests.rigs.chromium import Chromium, needs_chromium
from tests.rigs.gateway_bench import Bench, free_port, started_bench
from tests.rigs.page import PageProcess
from tests.rigs.processes import until

from dehyst.daemon.bus.security import check_page, split_public_url
from dehyst.daemon.main import main
from dehyst.daemon.page.people import People, Public
from dehyst.models.errors import BadInput

EXAMPLES = Path(__file__).resolve().parents[3] / "docs" / "examples"
NGINX = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
CADDY = shutil.which("caddy")
PATIENCE_S = 30.0
AROUND = """
daemon off; pid {0}/pid; error_log {0}/error.txt; worker_processes 1; events {{}}
http {{
    access_log off; client_body_temp_path {0}/b; proxy_temp_path {0}/p; fastcgi_temp_path {0}/f;
    uwsgi_temp_path {0}/u; scgi_temp_path {0}/s;
    {1}
}}
"""


class Proxy:
    """A page and the proxy through which people reach it."""

    def __init__(self, page: PageProcess, port: int) -> None:
        self.page, self.port = page, port
        self.origin = f"https://lab.example:{port}"
        self.url = f"https://127.0.0.1:{port}/stage"

    def http(self, source: str) -> httpx.Client:
        """Return an HTTP client that connects from this source address."""
        headers = {"host": f"lab.example:{self.port}", "origin": self.origin}
        transport = httpx.HTTPTransport(local_address=source, verify=False)

        def name(request: httpx.Request) -> None:
            request.extensions["sni_hostname"] = "lab.example"  # the server name a browser sends

        return httpx.Client(
            base_url=self.url, transport=transport, headers=headers, timeout=20.0,
            event_hooks={"request": [name]},
        )  # fmt: skip


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("proxied")) as bench:
        yield bench


@pytest.fixture(scope="module", params=["nginx", "caddy"])
def proxy(
    request: pytest.FixtureRequest, bench: Bench, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Proxy]:
    folder = tmp_path_factory.mktemp(request.param)
    program = {"nginx": NGINX, "caddy": CADDY}[request.param]
    if program is None:
        pytest.skip(f"no {request.param} on this machine")
    keys = [str(folder / "keys"), "--controller", "lab", "--host", "lab.example"]
    assert main(["keys", *keys, "--client", "alice"]) == 0
    pem, key = (folder / "keys" / "lab" / name for name in ("certificate.pem", "key.pem"))
    (folder / "passwords").write_text("alice:correct horse\nbob:battery staple\n")
    (folder / "passwords").chmod(0o600)
    port = free_port()
    page = PageProcess(
        bench.address, "--public-url", f"https://lab.example:{port}/stage/", "--passwords",
        str(folder / "passwords"), "--operators", "alice", "--observers", "bob",
        log=folder / "page.txt",
    )  # fmt: skip
    if request.param == "nginx":
        text = (EXAMPLES / "nginx-page.conf").read_text()
        for old, new in (("listen 443 ssl", f"listen 127.0.0.1:{port} ssl"),
                         ("/etc/ssl/lab.example.pem", str(pem)),
                         ("/etc/ssl/private/lab.example.key", str(key)),
                         ("127.0.0.1:8080", page.host)):  # fmt: skip
            assert old in text
            text = text.replace(old, new)
        (folder / "conf").write_text(AROUND.format(folder, text))
        command = [program, "-p", str(folder), "-c", str(folder / "conf"), "-e", "stderr"]
    else:
        text = (EXAMPLES / "Caddyfile-page").read_text()
        assert "127.0.0.1:8080" in text
        text = text.replace("127.0.0.1:8080", page.host)
        text = text.replace(
            "lab.example {\n", f"lab.example:{port} {{\n\tbind 127.0.0.1\n\ttls {pem} {key}\n"
        )
        settings = "{\n\tadmin off\n\tauto_https disable_redirects\n\tstorage file_system "
        (folder / "Caddyfile").write_text(f"{settings}{folder}/state\n}}\n{text}")
        command = [program, "run", "--adapter", "caddyfile", "--config", str(folder / "Caddyfile")]
    with open(folder / "proxy.txt", "wb") as words:
        process = subprocess.Popen(
            command, stdout=words, stderr=words, env={"HOME": str(folder), "PATH": "/usr/bin"}
        )
    try:
        served = Proxy(page, port)
        until(lambda: answers(served), PATIENCE_S, f"{program} serves")
        yield served
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(20.0)
        page.close()


def answers(proxy: Proxy) -> bool:
    """Return whether the page is served through the proxy."""
    try:
        with proxy.http("127.0.0.1") as somebody:
            return somebody.get("/").status_code == 200
    except httpx.TransportError:
        return False


def test_all_that_the_page_needs_is_below_its_path(proxy: Proxy) -> None:
    with proxy.http("127.0.0.1") as somebody:
        bare = somebody.get(proxy.url)
        assert bare.headers["location"].endswith("/stage/")
        text = somebody.get("/").text
        assert 'src="/' not in text
        assert 'href="/' not in text
        assert somebody.get("/static/page.js").status_code == 200
        assert somebody.get("/me").status_code == 401
        answer = somebody.post("/login", json={"name": "alice", "password": "correct horse"})
        assert answer.status_code == 200
        cookie = answer.headers["set-cookie"]
        assert "Path=/stage/;" in cookie
        assert "Secure" in cookie
        me = somebody.get("/me", params={"at": proxy.origin}).json()
        assert (me["name"], me["problem"]) == ("alice", "")


def test_a_proxy_may_leave_the_path(proxy: Proxy) -> None:
    assert proxy.page.http.get("/stage/static/page.js").status_code == 200
    assert proxy.page.http.get("/stage/me").status_code == 401
    assert proxy.page.http.get("/stages/me").status_code == 404


def test_guesses_are_slowed_by_the_address_behind_the_proxy(proxy: Proxy) -> None:
    with proxy.http("127.0.0.2") as guesser, proxy.http("127.0.0.3") as bob:
        wrong = [
            guesser.post("/login", json={"name": "bob", "password": str(i)}).status_code
            for i in range(30)
        ]
        assert 429 in wrong
        assert bob.get("/metrics", auth=("bob", "battery staple")).status_code == 200


def test_another_origin_is_refused_through_the_proxy(proxy: Proxy) -> None:
    with proxy.http("127.0.0.4") as somebody:
        refused = somebody.post("/login", headers={"origin": "https://evil.example"}, json={})
        assert refused.status_code == 403
        assert "public_url" in refused.text


@needs_chromium
def test_a_browser_commands_through_the_proxy(proxy: Proxy, bench: Bench) -> None:
    window = Chromium(
        1280, 1200, "--ignore-certificate-errors",
        "--host-resolver-rules=MAP lab.example 127.0.0.1",
    )  # fmt: skip
    try:
        window.chrome.get(f"{proxy.origin}/stage/")
        window.until("the form", lambda: not window.ask("document.getElementById('login').hidden"))
        window.write("login-name", "alice")
        window.write("login-password", "correct horse")
        window.chrome.find_element("css selector", "#login button").click()
        window.until("it is connected", lambda: window.text("link") == "connected")
        window.write("target", "5")
        window.click("go")
        until(lambda: bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 5.0, PATIENCE_S, "")
        window.until("points", lambda: window.ask("dehystPage.plots.x.length") > 10)
        window.click("leave")
        window.until("the form", lambda: not window.ask("document.getElementById('login').hidden"))
        until(lambda: bench.loop.state.name == "READY", PATIENCE_S, "nobody commands")
        wrong = [text for text in window.complaints() if "401" not in text]
        assert wrong == []
    finally:
        window.close()


def test_without_a_public_url_a_refusal_says_what_to_configure(
    bench: Bench, tmp_path: Path
) -> None:
    page = PageProcess(bench.address, log=tmp_path / "page.txt")
    try:
        refused = page.http.get("/", headers={"host": "lab.example"})
        assert refused.status_code == 403
        assert "page.public_url" in refused.text
        assert "'lab.example'" in refused.text
        me = page.http.get("/me", params={"at": "https://lab.example"}).json()
        assert "page.public_url" in me["problem"]
        refused = page.post("/login", origin="https://lab.example", content=json.dumps({}))
        assert refused.status_code == 403
        assert "--public-url" in refused.text
    finally:
        page.close()


@pytest.mark.parametrize(
    ("url", "origin", "path"),
    [
        ("https://lab.example/stage/", "https://lab.example", "/stage"),
        ("https://LAB.example:443", "https://lab.example", ""),
        ("https://lab.example:8443/a/b", "https://lab.example:8443", "/a/b"),
        ("http://[::1]:8080/", "http://[::1]:8080", ""),
    ],
)
def test_a_public_url(url: str, origin: str, path: str) -> None:
    assert split_public_url(url) == (origin, path)


@pytest.mark.parametrize(
    "url",
    ["lab.example", "ftp://lab.example/", "https://", "https://a:b@lab.example/", "https://x/?a",
     "https://x/#a", "https://x:99999/", "https://x/\n", "https://x//y", "https://x/%2e",
     "h" * 9999],
)  # fmt: skip
def test_what_is_no_public_url(url: str) -> None:
    with pytest.raises(BadInput, match="is not the address of a page"):
        split_public_url(url)


def test_a_public_url_opens_nothing_to_the_network() -> None:
    here = ("127.0.0.1:8080", "", "")
    with pytest.raises(BadInput, match="could move the stage"):
        check_page(*here, "", "https://lab.example/")
    with pytest.raises(BadInput, match="in the clear"):
        check_page(*here, "passwords", "http://lab.example/")
    check_page(*here, "passwords", "https://lab.example/")
    check_page(*here, "", "http://localhost:8000/stage/")


def test_its_own_origin_alone_is_the_public_one(tmp_path: Path) -> None:
    public = Public.of("https://lab.example/stage/")
    assert public.called({"origin": "https://lab.example"})
    for origin in ("https://lab.example.evil", "http://lab.example", "null", "", "https://lab"):
        assert not public.called({"origin": origin})
    assert not Public().called({"origin": ""})
    assert People("").knows_host("localhost")
