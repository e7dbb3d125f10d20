"""The page's server against a real daemon on the simulated stage, queried as a browser would."""

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from tests.rigs.axes_bench import AxesBench
from tests.rigs.gateway_bench import Bench, renewed, started_bench, wait_until
from tests.rigs.page import Browser, PageProcess
from tests.rigs.stage_model import kept_model
from websockets.exceptions import InvalidStatus

from dehyst.daemon.main import main
from dehyst.daemon.rings.records import LoopCommand, State
from dehyst.models.hysteresis.forward import simulate_hysteresis


@pytest.fixture
def page(bench: Bench, tmp_path: Path) -> Iterator[PageProcess]:
    page = PageProcess(bench.address, log=tmp_path / "page.txt")
    try:
        yield page
    finally:
        page.close()


@pytest.fixture(scope="module")
def page_of_module(
    bench_of_module: Bench, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[PageProcess]:
    """The page that `shared_page` returns."""
    page = PageProcess(bench_of_module.address, log=tmp_path_factory.mktemp("page") / "page.txt")
    try:
        yield page
    finally:
        page.close()


@pytest.fixture
def shared_page(page_of_module: PageProcess, shared: Bench) -> PageProcess:
    """The page for tests that end neither bench nor page."""
    return page_of_module


@pytest.fixture(scope="module")
def still_bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """One bench for all tests that neither move nor end anything."""
    with started_bench(tmp_path_factory.mktemp("still")) as bench:
        yield bench


@pytest.fixture(scope="module")
def still_page(
    still_bench: Bench, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[PageProcess]:
    log = tmp_path_factory.mktemp("page") / "page.txt"
    page = PageProcess(still_bench.address, log=log)
    try:
        yield page
    finally:
        page.close()


def looking(page: PageProcess, cookie: str = "") -> Browser:
    """Return a browser that has found the controller and receives its status."""
    browser = Browser(page, cookie)
    browser.until("it is found", lambda: "bench" in browser.said["controllers"]["names"]
                  if "controllers" in browser.said else False)  # fmt: skip
    browser.look()
    browser.until(
        "its status", lambda: "status" in browser.said and browser.said["status"]["status"]
    )
    return browser


def followed(bench: Bench, um: float) -> bool:
    """Return whether the newest sample of the loop's own record has this target."""
    return bool(bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == um)


def test_what_is_drawn_is_what_the_loop_recorded(shared: Bench, shared_page: PageProcess) -> None:
    browser = looking(shared_page)
    browser.ask("go", value=4.0, seconds=2.0)
    browser.until("four seconds", lambda: len(browser.frames) > 40)
    browser.close()
    samples = shared.loop.samples()
    first, *rest = browser.frames
    assert first.anew
    assert not any(frame.anew for frame in rest)
    length_ns = round(first.bucket_s * 1e9)
    assert length_ns == 8_000_000  # 10 s on 1000 pixels
    where = samples["scheduled_ns"] // length_ns
    checked = 0
    for frame in browser.frames:
        numbers = round(frame.first_s / frame.bucket_s) + frame.offsets
        for i, number in enumerate(numbers):
            inside = samples[where == number]
            assert inside.size
            assert frame.least[1, i] == np.float32(inside["measured"].min())
            assert frame.largest[5, i] == np.float32(inside["volts"].max())
            checked += 1
    assert checked > 300
    wall_s = first.first_s + first.offset_s
    assert abs(wall_s - time.time()) < 120.0


def test_a_set_point_is_kept_and_a_stop_stops(shared: Bench, shared_page: PageProcess) -> None:
    browser = looking(shared_page)
    browser.ask("go", value=5.0, seconds=60.0)
    wait_until("the stage is there", lambda: followed(shared, 5.0))
    begun, begun_s = shared.loop.seq, time.time()
    wait_until("three times the stale time", lambda: shared.loop.seq > begun + 600)
    assert followed(shared, 5.0)
    browser.until("it is said", lambda: any("going to 5 um" in text for text in browser.texts()))
    label = browser.until(
        "who commands", lambda: browser.said["status"]["status"]["gateway"]["lease_label"]
    )
    assert "on the page, 127.0.0.1" in label
    browser.ask("stop")
    wait_until("it holds, then is ready", lambda: shared.loop.state in (State.HOLDING, State.READY))
    begun = shared.loop.seq
    wait_until("it stays so", lambda: shared.loop.seq > begun + 300)
    assert shared.loop.state is State.READY

    def reported() -> bool:  # events of earlier tests are older
        return any(e["code"] == "holding" and e["wall_s"] > begun_s for e in browser.events())

    browser.until("the event", reported)
    browser.close()


def test_the_motion_ends_with_its_browser(shared: Bench, shared_page: PageProcess) -> None:
    browser = looking(shared_page)
    browser.ask("go", value=5.5, seconds=3600.0)
    wait_until("the stage is there", lambda: followed(shared, 5.5))
    browser.close()
    wait_until("nobody commands", lambda: shared.loop.state is State.READY, 20.0)


def test_a_stage_that_stands_outside_its_reach_is_held_there(
    still_bench: Bench, still_page: PageProcess
) -> None:
    browser = looking(still_page)
    status = browser.said["status"]
    assert status["measured"] < status["status"]["reach_min"] - 1.0  # as after a start
    before = still_bench.loop.samples(still_bench.loop.seq - 1)[-1]["volts"]
    browser.ask("hold", seconds=1.0)
    browser.until("held", lambda: any("holding the present voltage" in t for t in browser.texts()))
    assert not any("cannot be reached" in text for text in browser.texts())
    assert still_bench.loop.samples(still_bench.loop.seq - 1)[-1]["volts"] == before
    browser.ask("stop")
    browser.close()


def test_who_commands_already_is_named_and_can_be_taken_over_from(
    shared: Bench, shared_page: PageProcess
) -> None:
    browser, other = looking(shared_page), shared.client("the other one")
    other.send(3.0)
    with renewed(other):
        browser.ask("go", value=6.0, seconds=5.0)
        browser.until(
            "refused", lambda: any("the other one commands" in t for t in browser.texts())
        )
    browser.ask("go", value=6.0, seconds=5.0, take_over=True)
    wait_until("the stage is there", lambda: followed(shared, 6.0))
    browser.close()


NONSENSE = (
    '{"ask": "go", "value": 1e999, "seconds": 1}',
    '{"ask": "go", "value": "4", "seconds": 1}',
    '{"ask": "go", "value": 4, "seconds": -1}',
    '{"ask": "go", "value": 4}',
    '{"ask": "fly"}',
    '{"ask": "stop", "more": 1}',
    '{"ask": "play", "job": "0123"}',
    "[[[[",
    "",
)


def test_what_is_not_understood_is_said_and_nothing_else_happens(
    still_bench: Bench, still_page: PageProcess
) -> None:
    browser, begun = looking(still_page), still_bench.loop.commands.size
    for number, text in enumerate(NONSENSE, 1):
        browser.socket.send(text)
        browser.until("it is said", lambda n=number: len(browser.texts()) == n)  # type: ignore[misc]
    assert set(still_bench.loop.commands["kind"][begun:]) <= {LoopCommand.TRUST}
    browser.ask("stop")  # the connection still works
    browser.until("stopped", lambda: "stopped" in browser.texts()[-1])
    browser.close()


def test_a_stranger_gets_nothing(still_page: PageProcess) -> None:
    assert still_page.http.get("/me", headers={"host": "evil.example"}).status_code == 403
    assert still_page.post("/login", origin="http://evil.example", content="{}").status_code == 403
    assert still_page.http.post("/login", content="{}").status_code == 403  # no origin at all
    with pytest.raises(InvalidStatus, match="403"):
        Browser(still_page, origin="http://evil.example")
    assert still_page.http.get("/static/../server.py").status_code == 404
    assert still_page.http.get("/static/%2e%2e/server.py").status_code == 404
    for path in ("/", "/static/page.js", "/me", "/nothing"):
        policy = still_page.http.get(path).headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy


HERE = 'controller="bench"'


def exposed(page: PageProcess) -> dict[str, float]:
    """Return the metrics that Prometheus reads, by name."""
    lines = page.http.get("/metrics").text.splitlines()
    return {k: float(v) for k, _, v in (x.rpartition(" ") for x in lines if x[0] != "#")}


def test_metrics_are_what_the_daemon_says(shared: Bench, shared_page: PageProcess) -> None:
    client = shared.client()
    wait_until("it is heard", lambda: exposed(shared_page).get(f"dehyst_up{{{HERE}}}") == 1.0)
    running = f'dehyst_state{{{HERE},dehyst_state="running"}}'
    error = f'dehyst_error{{{HERE},stat="rms",unit="um"}}'
    found: dict[str, float] = {}

    def running_with_error() -> bool:
        client.send(4.0)  # it becomes stale after a second
        found.clear()
        found.update(exposed(shared_page))
        # "running" is heard before the first samples that have both a target and a measurement
        return found[running] == 1.0 and error in found

    wait_until("it runs and its error is known", running_with_error)
    status = client.status()
    states = {k: v for k, v in found.items() if k.startswith("dehyst_state{")}
    assert sum(states.values()) == 1.0
    assert found[f'dehyst_device_ok{{{HERE},device="actuator"}}'] == 1.0
    assert found[f"dehyst_deadlines_missed_total{{{HERE}}}"] <= status.missed
    assert 0 < found[f'dehyst_wakeup_seconds{{{HERE},quantile="0.5"}}'] < 10.0
    assert 0 < found[error] < 10.0


def test_a_killed_gateway_and_a_killed_page_come_back(bench: Bench, page: PageProcess) -> None:
    browser = looking(page)
    wait_until("it is heard", lambda: exposed(page).get(f"dehyst_up{{{HERE}}}") == 1.0)
    bench.kill_gateway()
    browser.until("silence is reported", lambda: browser.said["status"]["silent_s"] > 2.0)
    wait_until("it is missed", lambda: exposed(page)[f"dehyst_up{{{HERE}}}"] == 0.0)
    bench.start_gateway()
    browser.until("it speaks again", lambda: browser.said["status"]["silent_s"] < 1.0)
    frames = len(browser.frames)
    browser.until("it is drawn again", lambda: len(browser.frames) > frames + 5)
    browser.ask("go", value=4.0, seconds=5.0)
    wait_until("it commands again", lambda: followed(bench, 4.0))
    page.kill()
    page.start()
    again = looking(page)
    frame = again.until("the past is there", lambda: again.frames)[0]
    assert frame.offsets[-1] * frame.bucket_s > 2.0
    again.close()
    assert page.kill(signal.SIGTERM) == 0


def test_it_waits_for_a_daemon_that_is_not_there_yet(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    page = PageProcess(bench.address, log=tmp_path / "page.txt")
    try:
        browser = Browser(page)
        said = browser.until("what is missing", lambda: browser.said.get("controllers"))
        assert said["names"] == []
        browser.until(
            "words",
            lambda: any("no daemon reached" in p for p in browser.said["controllers"]["problems"]),
        )
        bench.start_gateway()
        browser.until("it is found", lambda: browser.said["controllers"]["names"] == ["bench"])
        browser.close()
    finally:
        page.close()
        bench.close()


def test_one_page_for_two_controllers(shared: Bench, tmp_path: Path) -> None:
    (tmp_path / "second").mkdir()
    second = Bench(tmp_path / "second", **{'name = "bench"': 'name = "other"'})
    page = PageProcess(f"{shared.address},{second.address}", log=tmp_path / "page.txt")
    try:
        second.start_gateway()
        browser = looking(page)
        browser.until("both", lambda: browser.said["controllers"]["names"] == ["bench", "other"])
        browser.look("other")
        browser.until("the other's status", lambda: browser.said["status"]["name"] == "other")
        browser.ask("go", value=6.0, seconds=5.0)
        wait_until("it goes", lambda: followed(second, 6.0))
        assert shared.loop.state is State.READY
        browser.close()
    finally:
        page.close()
        second.close()


def test_a_preview_is_played_where_it_was_made(shared: Bench, tmp_path: Path) -> None:
    (tmp_path / "second").mkdir()
    second = Bench(tmp_path / "second", **{'name = "bench"': 'name = "other"'})
    page = PageProcess(f"{shared.address},{second.address}", log=tmp_path / "page.txt")
    try:
        second.start_gateway()
        browser = looking(page)
        browser.until("both", lambda: browser.said["controllers"]["names"] == ["bench", "other"])
        rows = "".join(f"{t / 100},{4 + t / 100}\n" for t in range(100))
        job: dict[str, str] = {}

        def taken() -> bool:  # accepted once the model is known
            asked = page.post(
                "/upload/trajectory?controller=bench&file=a.csv", content=f"t_s,target_um\n{rows}"
            )
            job.update(asked.json())
            return asked.status_code == 200

        wait_until("the model is known", taken)

        def done() -> bool:
            job.update(page.http.get(f"/job/{job['number']}").json())
            return job["state"] in ("done", "failed")

        browser.until("it is checked", done, 240.0)
        assert job["controller"] == "bench"
        browser.look("other")
        browser.until("the other's status", lambda: browser.said["status"]["name"] == "other")
        browser.ask("play", job=job["number"])
        browser.until("refused", lambda: any("was checked for bench" in t for t in browser.texts()))
        assert second.loop.state is State.READY
        browser.look("bench")
        browser.ask("play", job=job["number"])
        browser.until("played", lambda: any("played to the end" in t for t in browser.texts()))
        browser.close()
    finally:
        page.close()
        second.close()


def test_with_passwords_nothing_without_one_and_an_observer_cannot_command(
    shared: Bench, tmp_path: Path
) -> None:
    (tmp_path / "passwords").write_text("alice:correct horse\nbob:battery staple\n")
    (tmp_path / "passwords").chmod(0o600)
    given = (
        "--passwords",
        str(tmp_path / "passwords"),
        "--operators",
        "alice",
        "--observers",
        "bob",
    )
    page = PageProcess(shared.address, *given, log=tmp_path / "page.txt")
    begun = shared.loop.commands.size
    try:
        for path in ("/me", "/metrics", "/job/1"):
            assert page.http.get(path).status_code == 401, path
        assert page.post("/upload/identify", content=b"x").status_code == 401
        with pytest.raises(InvalidStatus, match="403"):
            Browser(page)
        wrong = page.post("/login", content=json.dumps({"name": "bob", "password": "guess"}))
        assert wrong.status_code == 401
        assert page.http.get("/metrics", auth=("bob", "battery staple")).status_code == 200
        cookie = log_in(page, "bob", "battery staple")
        observer = looking(page, cookie)
        for ask in ({"ask": "stop"}, {"ask": "go", "value": 4, "seconds": 1},
                    {"ask": "hold", "seconds": 1}, {"ask": "play", "job": "1"},
                    {"ask": "decide", "action": "accept", "offer": "1"}):  # fmt: skip
            reported = len(observer.texts())
            observer.socket.send(json.dumps(ask))
            observer.until("refused", lambda n=reported: len(observer.texts()) > n)  # type: ignore[misc]
            assert "observer may view" in observer.texts()[-1]
        later = shared.loop.commands["kind"][begun:]
        assert set(later) <= {LoopCommand.TRUST}  # sent by the mismatch watch, not by the page
        page.http.cookies.set("dehyst", cookie)
        refused = page.post("/upload/identify", content=b"x")
        page.http.cookies.clear()
        assert refused.status_code == 403
        operator = looking(page, log_in(page, "alice", "correct horse"))
        operator.ask("go", value=4.0, seconds=5.0)
        wait_until("the operator commands", lambda: followed(shared, 4.0))
        label = operator.until(
            "who commands", lambda: operator.said["status"]["status"]["gateway"]["lease_label"]
        )
        assert label.startswith("alice on the page")
        operator.close()
        observer.close()
    finally:
        page.close()


def log_in(page: PageProcess, name: str, password: str) -> str:
    """Log in; return the session's cookie."""
    answer = page.post("/login", content=json.dumps({"name": name, "password": password}))
    assert answer.status_code == 200
    said = answer.headers["set-cookie"].lower()
    assert "httponly" in said
    assert "samesite=strict" in said
    assert ("secure" in said) == (page.scheme == "https")
    page.http.cookies.clear()
    return answer.cookies["dehyst"]


def test_over_tls(still_bench: Bench, tmp_path: Path) -> None:
    made = [str(tmp_path / "keys"), "--controller", "stage", "--host", "127.0.0.1"]
    assert main(["keys", *made, "--client", "alice"]) == 0
    folder = tmp_path / "keys" / "stage"
    (tmp_path / "passwords").write_text("alice:correct horse\n")
    (tmp_path / "passwords").chmod(0o600)
    page = PageProcess(
        still_bench.address, "--certificate", str(folder / "certificate.pem"),
        "--key", str(folder / "key.pem"), "--passwords", str(tmp_path / "passwords"),
        "--operators", "alice", log=tmp_path / "page.txt", scheme="https",
    )  # fmt: skip
    try:
        assert log_in(page, "alice", "correct horse")
        assert "max-age" in page.http.get("/").headers["strict-transport-security"]
        with pytest.raises(httpx.TransportError):
            httpx.get(f"http://{page.host}/")
    finally:
        page.close()


def test_a_trajectory_is_looked_at_before_it_is_played(shared_page: PageProcess) -> None:
    browser = looking(shared_page)
    browser.until("the model", lambda: browser.said.get("model", {}).get("model"))

    def looked_at(low: float, high: float, hz: float) -> dict:
        t_s = np.arange(0.0, 2.0, 0.005)
        um = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(2 * np.pi * hz * t_s)
        rows = "".join(f"{t:.3f},{y:.6f}\n" for t, y in zip(t_s, um, strict=True))
        asked = shared_page.post(
            "/upload/trajectory?controller=bench&file=<b>way</b>.csv",
            content="t_s,target_um\n" + rows,
        )
        assert asked.status_code == 200, asked.text
        number, job = asked.json()["number"], {}

        def done() -> bool:
            job.update(shared_page.http.get(f"/job/{number}").json())
            return job["state"] in ("done", "failed")

        browser.until("it is looked at", done, 240.0)
        return job

    fits = looked_at(3.0, 7.0, 1.0)
    assert fits["state"] == "done", fits["text"]
    assert "<" not in fits["file"]
    found = fits["result"]
    assert (found["points"], found["outside"], found["too_fast"]) == (400, 0.0, 0.0)
    # 2 um at 1 Hz on a stage of about 0.1 um/V, at most 9 to 12 V/um
    assert 2 * np.pi * 2 * 8 < found["fastest"] < 2 * np.pi * 2 * 14
    browser.ask("play", job=fits["number"])
    browser.until("played", lambda: any("played to the end" in t for t in browser.texts()))
    high = looked_at(5.0, 30.0, 1.0)
    share = high["result"]["outside"]
    reach = browser.said["status"]["status"]["reach_max"]
    # of a cosine between 5 and 30 um, the share arccos(1 - 2 (reach - 5) / 25) / pi is in reach
    assert share == pytest.approx(1 - np.arccos(1 - 2 * (reach - 5) / 25) / np.pi, abs=0.02)
    browser.ask("play", job=high["number"])
    browser.until("refused", lambda: any("leaves the reach" in t for t in browser.texts()))
    browser.close()


def test_a_file_that_is_none_is_said_in_one_line(
    still_bench: Bench, still_page: PageProcess
) -> None:
    wait_until(
        "the model is known",
        lambda: (
            still_page.post("/upload/trajectory?controller=bench", content=b"").status_code == 200
        ),
    )
    asked = still_page.post(
        "/upload/identify?controller=bench&file=../../x.csv", content=b"no\nnumbers\n"
    )
    number = asked.json()["number"]
    wait_until("said", lambda: still_page.http.get(f"/job/{number}").json()["state"] == "failed")
    said = still_page.http.get(f"/job/{number}").json()
    assert "x.csv" in said["text"]
    assert "/tmp" not in said["text"]
    assert still_page.http.get(f"/job/{number}/report").status_code == 404
    assert still_page.post("/upload/paint", content=b"x").status_code == 404


def test_a_dropped_recording_is_identified_beside_a_look_at_a_trajectory(
    still_page: PageProcess,
) -> None:
    t_s = np.arange(0.0, 40.0, 0.02)
    drive = 75.0 - 75.0 * np.cos(2 * np.pi * 0.2 * t_s) * np.exp(-t_s / 40.0)
    drive *= np.minimum(1.0, t_s / 5.0)
    noise = 0.005 * np.random.default_rng(3).normal(size=t_s.size)
    um = simulate_hysteresis(kept_model().hysteresis, drive, 0.02) + noise
    rows = "".join(f"{t:.2f},{u:.5f},{y:.5f}\n" for t, u, y in zip(t_s, drive, um, strict=True))
    asked = still_page.post("/upload/identify?file=run.csv", content="t_s,u_v,y_um\n" + rows)
    number = asked.json()["number"]

    def state(of: str) -> str:
        return str(still_page.http.get(f"/job/{of}").json()["state"])

    wait_until("it works", lambda: state(number) == "working")
    wait_until(
        "the model is known",
        lambda: (
            still_page.post("/upload/trajectory?controller=bench", content=b"").status_code == 200
        ),
    )
    wait_until("done", lambda: state(number) in ("done", "failed"), 280.0)
    job = still_page.http.get(f"/job/{number}").json()
    assert job["state"] == "done", job["text"]
    assert "rms" in job["result"]["said"]
    assert "hysteresis" in still_page.http.get(f"/job/{number}/model").text
    report = still_page.http.get(f"/job/{number}/report")
    assert report.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
    assert "<html" in report.text


def test_all_axes_of_a_controller_their_path_and_one_stop(tmp_path: Path) -> None:
    axes = AxesBench(tmp_path, "xy")
    page: PageProcess | None = None
    try:
        axes.start_gateway()
        group = axes.group()
        page = PageProcess(axes.address, log=tmp_path / "page.txt")
        browser = Browser(page)
        names = ["stage-1-x", "stage-1-y"]
        browser.until("they are found", lambda: browser.said.get("controllers"))
        browser.until("both", lambda: browser.said["controllers"]["names"] == names)
        browser.look("stage-1-x")
        said = browser.until("all axes", lambda: browser.said.get("axes"))
        assert (said["controller"], said["anew"]) == ("stage-1", True)
        assert [one["axis"] for one in said["axes"]] == ["x", "y"]
        group.send({"x": 3.0, "y": 6.0})
        way: dict[int, list[float | None]] = {}

        def arrived() -> bool:
            for one in browser.heard:
                if one["kind"] == "axes":
                    targets = zip(*(axis["way"][0] for axis in one["axes"]), strict=True)
                    way.update(dict(zip(one["number"], targets, strict=True)))
            return (3.0, 6.0) in way.values()

        browser.until("the path comes there", arrived)
        assert list(way) == sorted(way)  # each point once, in order
        before = {axis: loop.commands.size for axis, loop in axes.loops.items()}
        browser.ask("stop")
        browser.until("stopped", lambda: "stopped" in browser.said.get("said", {}).get("text", ""))
        for axis, loop in axes.loops.items():
            wait_until(f"{axis} is stopped", lambda one=loop, n=before[axis]: one.commands.size > n)
            assert LoopCommand.STOP_MOTION in loop.commands["kind"][before[axis] :]
        group.close()  # the group commanded until now
        for axis, value in (("x", 4.0), ("y", 5.5)):
            browser.ask("go", name=f"stage-1-{axis}", value=value, seconds=60)
        targets = lambda: [one["target"] for one in browser.said["axes"]["axes"]]  # noqa: E731
        browser.until("both are there", lambda: targets() == [4.0, 5.5])
        browser.ask("hold", seconds=60, everywhere=True)
        browser.ask("go", name="stage-9-x", value=4.0, seconds=60)
        browser.until("no such axis", lambda: "stage-9-x is not an axis" in str(browser.texts()))
        # a trajectory of both axes is checked for each axis and played on the same samples
        t_s = np.arange(0.0, 1.0, 0.01)
        circle = [4.0 + np.sin(2 * np.pi * t_s), 4.5 + np.cos(2 * np.pi * t_s)]
        rows = "\n".join(f"{t:.3f},{x:.6f},{y:.6f}" for t, x, y in zip(t_s, *circle, strict=True))
        asked = page.post(
            "/upload/trajectory?controller=stage-1-x&file=circle.csv",
            content=f"t_s,target_x_um,target_y_um\n{rows}\n",
        )
        number = asked.json()["number"]
        look = lambda: page.http.get(f"/job/{number}").json()  # noqa: E731
        browser.until("looked at", lambda: look()["state"] in ("done", "failed"), 200.0)
        assert look()["state"] == "done", look()["text"]
        assert list(look()["result"]["axes"]) == ["x", "y"]
        points = lambda: [  # noqa: E731
            int((loop.commands["kind"] == LoopCommand.POINT).sum()) for loop in axes.loops.values()
        ]
        assert points() == [0, 0]
        browser.ask("play", job=number)  # the page's own set-points end
        browser.until("it was played", lambda: "played to the end" in str(browser.texts()))
        assert points() == [100, 100]
        browser.close()
    finally:
        if page is not None:
            page.close()
        axes.close()
